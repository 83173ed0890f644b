"""Drives for programs: axes that are enabled, homed, moved and stopped, in SI units.

A thread of the C library exchanges the axes in every bus cycle (`ecat_axis.h`). The program says
what it wants, and waits for it.
"""

from __future__ import annotations

import ctypes
import math
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from enum import IntEnum
from typing import TYPE_CHECKING, Any, Protocol, Self, TypeVar

from ecatd.base.errors import (
    EcatError,
    NoAnswerError,
    SdoAbortError,
    StateError,
    UnreachableError,
    UsageError,
)
from ecatd.base.timeouts import Timeout
from ecatd.etg.drives import AXES
from ecatd.shm.contract import Errno

from .arguments import seconds, text, whole
from .axis_status import AxisStatus, status_of
from .axis_structs import TEXT, Axis, State
from .connection import ERRORS, text_of
from .structs import QUICK, WAITING

if TYPE_CHECKING:
    from .requests import Request

V = TypeVar("V")

_HOMING_METHOD, _HOMING_METHODS = 0x6098, 0x60E3
_MAX_TORQUE = 6
"""Place of 0x6072 among the objects of an axis."""
_LEASE = 0.2
"""Seconds without an exchange after which the axes stop as their safe outputs say."""
_CYCLE_PATIENCE = 1.0
_WATCH = 0.1


class Bus(Protocol):
    """What axes need of a client besides."""

    @property
    def name(self) -> str:
        """Name of the bus."""

    @property
    def cycle_time(self) -> float:
        """Base cycle in seconds."""

    def sdo_upload(self, slave: int, index: int, subindex: int = 0) -> Request:
        """Starts to read an object."""

    def sdo_download(self, slave: int, index: int, subindex: int, data: bytes) -> Request:
        """Starts to write an object."""


class _Goal(IntEnum):
    """`ecat_axes_goal`."""

    ENABLED = 1
    OFF = 2
    WELL = 3
    HOMED = 4
    REACHED = 5
    STOPPED = 6

    @property
    def text(self) -> str:
        """As a condition."""
        return _GOALS[self - 1]


_GOALS = ("enabled", "switched off", "without a fault", "homed", "at its target", "standing still")


class DriveError(StateError):
    """An axis does not do what it shall; the message has its name, state, statusword and error."""

    name = "drive"


class Drive:
    """An axis; `Client.drive` makes it, and `Drives` several.

    ```python
    with Client("ecat0") as bus, bus.drive("x") as axis:
        axis.enable()
        axis.home()
        axis.move_to(1.5, speed=0.5)
    ```

    Methods that end with the movement raise `DriveError` if the axis stops before.

    Attributes:
        name: Name or position of its slave, as given.
        slave: Position of its slave.
        linear: Whether positions are in m, not in rad.
        torque_unit: `N.m` or `N`; empty: 1 is the rated torque.
    """

    def __init__(self, group: Drives, number: int, name: str) -> None:
        self._group, self._number = group, number
        self.name = name
        raw = ctypes.cast(group.address_of(number), ctypes.POINTER(Axis)).contents
        self._raw = raw
        self.slave = int(raw.slave)
        self.linear = bool(raw.linear)
        self.torque_unit = ("", "N.m", "N")[raw.torque_unit]

    # --- settings ---------------------------------------------------------------------------------

    def limit(
        self,
        *,
        position: tuple[float, float] | None = None,
        speed: float | None = None,
        torque: float | None = None,
        following_error: float | None = None,
    ) -> None:
        """Limits what is sent to the drive; only before the group begins.

        Args:
            position: Lowest and highest target, in rad or m.
            speed: Largest speed, in rad/s or m/s.
            torque: Largest torque, in N·m or N.
            following_error: Distance of position and target beyond which the axis is stopped.

        Raises:
            UsageError: The axes move already, or a limit is no number.
        """
        self._group.check_not_begun()
        settings = self._raw.drive.settings
        if position is not None:
            low, high = _ends(position)
            settings.low, settings.high = low, high
        if torque is not None and self._raw.signals[_MAX_TORQUE] < 0:
            raise UsageError(
                f"axis {self.name}: 0x6072 (max torque) is not in its process data, so its torque "
                "can only be limited in the drive: add it to its pdos, or to its [[slave.startup]]"
            )
        for name, key, value in (
            ("speed", "max_speed", speed),
            ("torque", "max_torque", torque),
            ("following_error", "max_following_error", following_error),
        ):
            if value is not None:
                setattr(settings, key, _positive(name, value))

    def units(
        self,
        *,
        position: float | None = None,
        velocity: float | None = None,
        torque: float | None = None,
    ) -> None:
        """Says what 1 means in the process data, where the bus has no unit.

        Args:
            position: rad or m for one increment of 0x6064; also that of `velocity`, unless it is
                given.
            velocity: rad/s or m/s for 1 in 0x606C.
            torque: N·m or N for 1 in 0x6077, 1/1000 of the rated torque.
        """
        self._group.check_not_begun()
        settings = self._raw.drive.settings
        if position is not None:
            if settings.position_scale != 0:
                raise UsageError(
                    f"axis {self.name}: the bus has a unit of its position already: correct it in "
                    "the configuration of ecatd, with [[signal]]"
                )
            settings.position_scale = settings.velocity_scale = _scale(position)
        if velocity is not None:
            settings.velocity_scale = _scale(velocity)
        if torque is not None:
            settings.torque_scale = _scale(torque)

    # --- what it does ---------------------------------------------------------------------------

    @property
    def status(self) -> AxisStatus:
        """What it did in the last cycle."""
        return status_of(self._group.state(self._number))

    @property
    def position(self) -> float:
        """Its position in rad or m."""
        return float(self._group.state(self._number).view.position)

    def check(self) -> None:
        """Checks that it is in operation, as it was asked to be.

        Raises:
            DriveError: It has stopped; the message says why.
            EcatError: The bus, or the claim, was lost.
        """
        self._group.check([self])

    def explain(self) -> str:
        """A sentence: state, statusword and error in words, and why it is not in operation."""
        return self._group.explain(self._number)

    # --- what it shall do -------------------------------------------------------------------------

    def enable(self, timeout: float = 5.0) -> None:
        """Takes it into operation, where it stands, and waits for that.

        Raises:
            DriveError: It has a fault (see `reset`), or another reason.
            NoAnswerError: It did not get there in time.
        """
        self._group.enable([self], timeout)

    def disable(self, timeout: float = 10.0) -> None:
        """Takes it out of operation, as its object 0x605C says, and waits for that."""
        self._group.disable([self], timeout)

    def reset(self, timeout: float = 5.0) -> None:
        """Resets a fault.

        Raises:
            DriveError: The fault is still there.
        """
        self._group.reset([self], timeout)

    def home(self, method: int | None = None, timeout: float = 60.0) -> None:
        """Homes it, and waits for the end.

        Args:
            method: Homing method, object 0x6098, by CiA 402 or of the vendor (negative). Without
                it, the drive uses the one that it has.
            timeout: Seconds.

        Raises:
            DriveError: Homing has failed, or the drive does not have the method.
        """
        self._group.home([self], None if method is None else [method], timeout)

    def move_to(
        self,
        position: float,
        *,
        speed: float | None = None,
        acceleration: float | None = None,
        timeout: float | None = None,
        wait: bool = True,
    ) -> None:
        """Moves it to a position, and waits for that.

        Args:
            position: In rad or m.
            speed: Largest speed on the way; by default 1 rad/s, or 0.1 m/s.
            acceleration: By default 10 rad/s², or 1 m/s².
            timeout: Seconds; by default what the way takes, and 5 more.
            wait: Whether to wait; else `wait_reached` does.
        """
        self._group.move_to([self], [position], speed, acceleration, timeout, wait=wait)

    def move_by(self, distance: float, **options: float | None) -> None:
        """Moves it by a distance from where it is; the options are those of `move_to`."""
        self.move_to(self.position + _number(distance), **options)  # type: ignore[arg-type]

    def run(self, speed: float) -> None:
        """Turns it at a speed, until something else is asked for (mode CSV or PV)."""
        self._group.run([self], [speed])

    def push(self, torque: float) -> None:
        """Applies a torque, until something else is asked for (mode CST or PT)."""
        self._group.push([self], [torque])

    def stop(self, timeout: float = 10.0) -> None:
        """Stops it by its quick stop, object 0x605A, and waits until it stands."""
        self._group.stop([self], timeout)

    def wait_reached(self, timeout: float = 60.0) -> None:
        """Waits until it has reached its target."""
        self._group.wait_reached([self], timeout)

    # --- with -------------------------------------------------------------------------------------

    def __enter__(self) -> Self:
        self._group.begin()
        return self

    def __exit__(self, *_: object) -> None:
        self._group.close()


class Drives:
    """Axes that start and stop together; `Client.drives` makes it.

    ```python
    with bus.drives("x", "y") as axes:
        axes.enable()
        axes.move_to(None, [1.0, 2.0], speed=0.5)  # both arrive at the same time
    ```

    Args:
        bus: The client; SDOs go through it.
        names: Names or positions of the slaves; "NAME/2" is the second axis of a drive.
        lease: Seconds without an exchange, for example while the process is stopped, after which
            the axes stop as their safe outputs say.
        together: Whether all stop when one of them stops by itself.

    Raises:
        UnreachableError: No daemon serves the bus.
        StateError: There is no such slave, or it is no drive.
    """

    def __init__(
        self,
        bus: Bus,
        names: Iterable[str | int],
        *,
        lease: float = _LEASE,
        together: bool = True,
    ) -> None:
        self._address: int | None = None
        self._bus = bus
        self._lease, self._together = seconds("lease", lease), together
        self._begun = False
        pointer = ctypes.c_void_p()
        code = WAITING.ecat_axes_open(ctypes.byref(pointer), bus.name.encode())
        self._address = pointer.value
        self._check(code)
        self.axes: list[Drive] = []
        for name in names:
            slave, axis = _place(name)
            number = self._check(WAITING.ecat_axes_add(self._address, slave.encode(), axis))
            self.axes.append(Drive(self, number, str(name)))

    def __del__(self) -> None:  # a program that has forgotten its axes must not leave them turning
        self.close()

    def __getitem__(self, number: int) -> Drive:
        return self.axes[number]

    def __iter__(self) -> Iterator[Drive]:
        return iter(self.axes)

    def __len__(self) -> int:
        return len(self.axes)

    def __enter__(self) -> Self:
        self.begin()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def begin(self) -> None:
        """Claims the outputs of all axes, and begins to exchange them.

        Raises:
            OwnedError: Another client owns one of them.
            UsageError: A setting is wrong, or the position of an axis has no unit.
        """
        if self._begun:
            return
        self._check(WAITING.ecat_axes_start(self._address, self._lease, self._together))
        self._begun = True
        self._next()

    def observe(self) -> None:
        """Begins to look only; another program may move the axes meanwhile."""
        self._check(WAITING.ecat_axes_observe(self._address))
        self._next()

    def close(self) -> None:
        """Gives the axes back: their outputs go to their safe values, which stop them."""
        address, self._address = self._address, None
        if address is not None:
            WAITING.ecat_axes_close(address)

    # --- for its axes -----------------------------------------------------------------------------

    def address_of(self, number: int) -> int:
        """Where the C library has an axis."""
        return int(QUICK.ecat_axes_axis(self._open, number))

    def check_not_begun(self) -> None:
        """Refuses changes of settings while the axes move."""
        if self._begun:
            raise UsageError("the axes move already: set this before `with`")

    def state(self, number: int) -> State:
        """The last cycle of an axis."""
        state = State()
        QUICK.ecat_axes_state(self._open, number, ctypes.byref(state))
        return state

    def check(self, axes: Sequence[Drive] | None = None) -> None:
        """See `Drive.check`."""
        self._look()
        for axis in self._chosen(axes):
            order = self.state(axis._number).order
            if order.waits or order.trip:
                raise DriveError(f"{axis.explain()}")

    def explain(self, number: int) -> str:
        """A sentence about an axis."""
        buffer = ctypes.create_string_buffer(TEXT)
        QUICK.ecat_axes_explain(self._open, number, buffer)
        return text_of(buffer.value)

    # --- what they shall do -----------------------------------------------------------------------

    def enable(self, axes: Sequence[Drive] | None = None, timeout: float = 5.0) -> None:
        """See `Drive.enable`."""
        try:
            self._do(axes, _Goal.ENABLED, timeout, "enable")
        except BaseException:
            with suppress(EcatError):  # it must not take effect later
                self._call("disable", self._chosen(axes), 0.0)
            raise

    def disable(self, axes: Sequence[Drive] | None = None, timeout: float = 10.0) -> None:
        """See `Drive.disable`."""
        self._do(axes, _Goal.OFF, timeout, "disable")

    def reset(self, axes: Sequence[Drive] | None = None, timeout: float = 5.0) -> None:
        """See `Drive.reset`."""
        self._do(axes, _Goal.WELL, timeout, "reset")

    def home(
        self,
        axes: Sequence[Drive] | None = None,
        methods: Sequence[int] | None = None,
        timeout: float = 60.0,
    ) -> None:
        """See `Drive.home`; all axes home at the same time."""
        chosen = self._chosen(axes)
        for axis in chosen:
            if not axis.status.enabled:
                raise DriveError(f"{axis.explain()}: enable it first")
        if methods is not None:
            for axis, method in _pairs(chosen, methods, "homing methods"):
                self._set_method(axis, method)
        try:
            self._do(chosen, _Goal.HOMED, timeout, "home")
        except BaseException:
            with suppress(EcatError):  # the first error counts
                self._call("leave_home", chosen, 0.0)
            raise
        self._do(chosen, _Goal.ENABLED, timeout, "leave_home")

    def move_to(
        self,
        axes: Sequence[Drive] | None,
        positions: Sequence[float],
        speed: float | Sequence[float] | None = None,
        acceleration: float | Sequence[float] | None = None,
        timeout: float | None = None,
        *,
        wait: bool = True,
    ) -> None:
        """See `Drive.move_to`; several axes arrive together: those with a shorter way go slower.

        Args:
            axes: Which; None: all.
            positions: A position for each, in rad or m.
            speed: Largest speed, of all or of each.
            acceleration: Of all, or of each.
            timeout: See `Drive.move_to`.
            wait: See `Drive.move_to`.
        """
        chosen = self._chosen(axes)
        goals = [goal for _, goal in _pairs(chosen, positions, "positions")]
        speeds = [
            _positive("speed", value)
            for value in _of_each(chosen, speed, "speeds", "approach_speed")
        ]
        rates = [
            _positive("acceleration", value)
            for value in _of_each(chosen, acceleration, "accelerations", "approach_acceleration")
        ]
        ways = [abs(_number(goal) - axis.position) for axis, goal in _pairs(chosen, goals, "")]
        self._call("move", chosen, _doubles(goals), _doubles(speeds), _doubles(rates), 0.0)
        if wait:
            rows = zip(ways, speeds, rates, strict=True)
            usual = 5.0 + max(way / most + 2 * most / rate for way, most, rate in rows)
            self.wait_reached(chosen, usual if timeout is None else timeout)

    def run(self, axes: Sequence[Drive] | None, speeds: Sequence[float]) -> None:
        """See `Drive.run`."""
        chosen = self._chosen(axes)
        _pairs(chosen, speeds, "speeds")
        self._call("run", chosen, _doubles(speeds))

    def follow(
        self, axes: Sequence[Drive] | None, positions: Sequence[float], interval: float = 0.0
    ) -> None:
        """Follows positions that the program sends again and again, as a controller does.

        The axes approach the first position. Returns at once.

        Args:
            axes: Which; None: all.
            positions: A position for each, in rad or m.
            interval: Seconds from one call to the next. The axes get straight lines between the
                positions, one interval late; 0: each position goes out at once.
        """
        chosen = self._chosen(axes)
        _pairs(chosen, positions, "positions")
        self._call("follow", chosen, _doubles(positions), seconds("interval", interval))

    def push(self, axes: Sequence[Drive] | None, torques: Sequence[float]) -> None:
        """See `Drive.push`."""
        chosen = self._chosen(axes)
        _pairs(chosen, torques, "torques")
        self._call("push", chosen, _doubles(torques))

    def stop(self, axes: Sequence[Drive] | None = None, timeout: float = 10.0) -> None:
        """See `Drive.stop`."""
        self._do(axes, _Goal.STOPPED, timeout, "stop")

    def wait_reached(self, axes: Sequence[Drive] | None = None, timeout: float = 60.0) -> None:
        """See `Drive.wait_reached`."""
        self._await(self._chosen(axes), _Goal.REACHED, timeout)

    def reached(self, axes: Sequence[Drive] | None = None) -> bool:
        """Whether they have reached their targets, without waiting.

        Raises:
            DriveError: One of them has stopped.
        """
        which = sum(1 << axis._number for axis in self._chosen(axes))
        code = QUICK.ecat_axes_poll(self._open, which, _Goal.REACHED)
        return code != Errno.EBUSY and self._check(code) == 0

    @property
    def cycle(self) -> int:
        """Number of the bus cycle of the last exchange."""
        return int(self.state(0).cycle)

    @property
    def cycle_time(self) -> float:
        """Seconds of a bus cycle."""
        return self._bus.cycle_time

    def wait(self, timeout: float = _CYCLE_PATIENCE) -> None:
        """Waits for the next cycle, for programs that look at each.

        Raises:
            UnreachableError: There are no cycles.
        """
        self._next(timeout)
        self._look()

    # --- the rest ---------------------------------------------------------------------------------

    @property
    def _open(self) -> int:
        if self._address is None:
            raise UsageError("the axes were closed")
        return self._address

    def _chosen(self, axes: Sequence[Drive] | None) -> Sequence[Drive]:
        chosen = self.axes if axes is None else axes
        if len({axis._number for axis in chosen}) != len(chosen) or not chosen:
            raise UsageError("the axes must be different ones, and at least one")
        return chosen

    def _check(self, code: int) -> int:
        if code < 0:
            said = text_of(QUICK.ecat_axes_error(self._address))
            raise DriveError(said) if code == Errno.ESTATE else ERRORS.get(code, EcatError)(said)
        return code

    def _call(self, what: str, axes: Sequence[Drive], *arguments: Any) -> None:
        if not self._begun:
            raise UsageError("the axes do not move yet: use them in a `with`")
        which = sum(1 << axis._number for axis in axes)
        self._check(getattr(WAITING, f"ecat_axes_{what}")(self._open, which, *arguments))

    def _do(self, axes: Sequence[Drive] | None, goal: _Goal, timeout: float, what: str) -> None:
        """Begins something, and waits until it is done. Python must see Ctrl-C meanwhile."""
        chosen = self._chosen(axes)
        self._call(what, chosen, 0.0)
        self._await(chosen, goal, timeout)

    def _await(self, axes: Sequence[Drive], goal: _Goal, timeout: float) -> None:
        end = time.monotonic() + seconds("timeout", timeout)
        which = sum(1 << axis._number for axis in axes)
        while (code := QUICK.ecat_axes_poll(self._open, which, goal)) == Errno.EBUSY:
            if time.monotonic() > end:
                self._look()
                said = "; ".join(axis.explain() for axis in axes)
                raise NoAnswerError(f"{said}: not {goal.text} within {Timeout(timeout)}")
            self._next()
        self._check(code)

    def _next(self, timeout: float = _CYCLE_PATIENCE) -> None:
        end = time.monotonic() + timeout
        while WAITING.ecat_axes_wait(self._open, min(_WATCH, timeout)) != 0:
            if time.monotonic() > end:
                said = text_of(QUICK.ecat_axes_error(self._open))
                raise UnreachableError(f"{said}; there was no cycle for {Timeout(timeout)}")

    def _look(self) -> None:
        """Raises what the last exchange has failed with."""
        code = self.state(0).code
        if code < 0:
            self._check(code)

    def _set_method(self, axis: Drive, method: int) -> None:
        """Sets the homing method, after a look into the list of those that the drive has."""
        number = whole("method", method)
        if not -128 <= number <= 127:
            raise UsageError(f"a homing method is from -128 to 127, not {number}")
        offset = 0x800 * (int(axis._raw.number) - 1)
        known = self._methods(axis.slave, offset)
        if known is not None and number not in known:
            listed = ", ".join(map(str, known))
            raise DriveError(
                f"axis {axis.name}: it has no homing method {number}; it has {listed} (object "
                f"0x{_HOMING_METHODS + offset:04X})"
            )
        data = number.to_bytes(1, "little", signed=True)
        self._bus.sdo_download(axis.slave, _HOMING_METHOD + offset, 0, data).result()

    def _methods(self, slave: int, offset: int) -> list[int] | None:
        """The homing methods that a drive says it has; None: it does not say."""
        index = _HOMING_METHODS + offset
        try:
            count = self._bus.sdo_upload(slave, index, 0).result()[0]
            found = [
                self._bus.sdo_upload(slave, index, sub).result() for sub in range(1, count + 1)
            ]
        except SdoAbortError:
            return None
        # CiA 402-2 has INTEGER16 since version 4, INTEGER8 before.
        return [int.from_bytes(data, "little", signed=True) for data in found]


def _place(name: str | int) -> tuple[str, int]:
    if isinstance(name, int):
        return str(whole("slave", name)), 1
    text("slave", name)
    slave, slash, axis = name.rpartition("/")
    if slash and axis.isdecimal():
        if not 1 <= int(axis) <= AXES:
            raise UsageError(f"an axis of a drive is 1 to {AXES}, not {axis}")
        return slave, int(axis)
    return name, 1


def _pairs(axes: Sequence[Drive], values: Sequence[V], what: str) -> list[tuple[Drive, V]]:
    if len(values) != len(axes):
        raise UsageError(f"{len(values)} {what} for {len(axes)} axes")
    return list(zip(axes, values, strict=True))


def _of_each(
    axes: Sequence[Drive], value: float | Sequence[float] | None, what: str, setting: str
) -> Sequence[float]:
    """A value for each axis: one for all, one each, or the usual ones."""
    if value is None:
        return [float(getattr(axis._raw.drive.settings, setting)) for axis in axes]
    if isinstance(value, Sequence):
        return [item for _, item in _pairs(axes, value, what)]
    return [value] * len(axes)


def _doubles(values: Sequence[float]) -> ctypes.Array[ctypes.c_double]:
    return (ctypes.c_double * len(values))(*map(_number, values))


def _ends(position: tuple[float, float]) -> tuple[float, float]:
    """The lowest and the highest position.

    Raises:
        UsageError: They are not.
    """
    try:
        low, high = map(_number, position)
    except TypeError:
        low, high = 0.0, -1.0
    if low >= high:
        raise UsageError(f"position must be the lowest and the highest one, not {position!r}")
    return low, high


def _scale(value: float) -> float:
    number = _number(value)
    if number == 0:
        raise UsageError("a scale cannot be 0")
    return number


def _number(value: float) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError) as error:
        raise UsageError(f"{value!r} is no number") from error
    if not math.isfinite(number):
        raise UsageError(f"{value} is no finite number")
    return number


def _positive(name: str, value: float) -> float:
    number = _number(value)
    if number <= 0:
        raise UsageError(f"{name} must be positive, not {number:g}")
    return number

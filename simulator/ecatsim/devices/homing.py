"""Homing (CiA 402-2): finds a reference and gives it the position of the home offset 0x607C.

| method | reference |
|---|---|
| 1, 2 | first index pulse inside the negative or the positive limit switch |
| 3 to 14 | index pulse beside an edge of the home switch |
| 17 to 30 | the switch edge itself, as with the method that is 16 less |
| 33, 34 | next index pulse in negative or positive direction |
| 35, 37 | the position at the start |
| negative | a mechanical stop, as the manufacturer defines them (`HardStop`) |
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, auto

from .axis import HOME, NEGATIVE_LIMIT, POSITIVE_LIMIT, Axis
from .modes import BIT_12, BIT_13, HALT, NEW_SET_POINT, TARGET_REACHED, Operation, Values
from .positioning import Trapezoid

Address = tuple[int, int]

_WITHOUT_INDEX = 16  # methods 17 to 30 are 1 to 14 without the index pulse
_LIMITS = {1: -1, 2: 1}  # method: direction of the limit switch
_AT_LIMITS_REVERSE = range(7, 15)
_HOME = {
    # method: first direction, edge of the switch (-1 the left one), direction across the edge
    3: (1, -1, -1),
    4: (1, -1, 1),
    5: (-1, 1, 1),
    6: (-1, 1, -1),
    7: (1, -1, -1),
    8: (1, -1, 1),
    9: (1, 1, -1),
    10: (1, 1, 1),
    11: (-1, 1, 1),
    12: (-1, 1, -1),
    13: (-1, -1, 1),
    14: (-1, -1, -1),
}
_INDEX = {33: -1, 34: 1}
_HERE = (35, 37)
STANDARD_METHODS = (*range(1, 15), *range(17, 31), 33, 34, 35, 37)


@dataclass(frozen=True, slots=True)
class HardStop:
    """A method of a manufacturer: the axis runs against a mechanical stop.

    Attributes:
        direction: Direction of the stop, -1 or 1.
        index: Whether the reference is the next index pulse on the way back, not the stop.
        distance: Object with the distance from the stop to the reference, or None.
    """

    direction: int
    index: bool = False
    distance: Address | None = None


EPOS4_METHODS: Mapping[int, HardStop] = {
    -1: HardStop(1, index=True),
    -2: HardStop(-1, index=True),
    -3: HardStop(1),
    -4: HardStop(-1),
}
"""Current threshold (maxon, EPOS4 Firmware Specification 2026-07, rel13740, p. 3-35 and 3-36)."""


@dataclass(frozen=True, slots=True)
class HomingOptions:
    """What a drive can home by.

    Attributes:
        methods: Those that it lists (0x60E3).
        hard_stops: The methods of the manufacturer that are simulated.
        threshold: Object with the current or torque that tells a stop.
        in_milliampere: Whether the threshold is a current in mA, not a torque in 1/1000 of 0x6076.
        position: Object with the position of the reference.
        move: Object with a distance that the axis moves away from the reference, so that the
            position is that of the place where it ends; None: it does not.
        listed: Whether the drive has the object 0x60E3.
    """

    methods: tuple[int, ...] = (*STANDARD_METHODS, *EPOS4_METHODS)
    hard_stops: Mapping[int, HardStop] = field(default_factory=lambda: EPOS4_METHODS)
    threshold: Address = (0x30B2, 0)
    in_milliampere: bool = True
    position: Address = (0x607C, 0)
    move: Address | None = None
    listed: bool = True


class _Phase(Enum):
    """The phase of homing."""

    IDLE = auto()  # not started, or interrupted
    TO_SWITCH = auto()
    BEFORE_EDGE = auto()  # to the side of the edge from which it is crossed
    TO_EDGE = auto()
    TO_STOP = auto()
    TO_INDEX = auto()
    STOPPING = auto()  # the reference is found
    LEAVING = auto()  # moves away from the reference
    DONE = auto()
    FAILED = auto()


class Homing(Operation):
    """Homing (6). Bit 4 of the control word starts it with its rising edge and must stay set."""

    def __init__(self, objects: Values, axis: Axis, options: HomingOptions) -> None:
        super().__init__(objects, axis)
        self._options = options
        self._phase = _Phase.IDLE
        self._started = False
        self._first = 0  # direction of the search for a switch or a stop
        self._switch = 0  # bit of the searched switch in the digital inputs
        self._reverses = False  # whether a limit switch turns the search around
        self._edge = 0.0  # in machine coordinates
        self._across = 0  # direction in which the edge is crossed, or the index pulse searched
        self._with_index = False
        self._distance: Address | None = None
        self._last = 0.0
        self._motion = Trapezoid(0.0, 0.0)
        self._end = 0.0

    def start(self) -> None:
        """Brakes to standstill and waits for the start by bit 4."""
        super().start()
        self._phase, self._started = _Phase.IDLE, False

    def resume(self) -> None:
        """Returns to the idle phase: after a halt, the master must start homing again."""
        self.start()

    def command(self, word: int, elapsed: float) -> None:
        """Moves as the phase and the method require."""
        wanted = bool(word & NEW_SET_POINT)
        if wanted and not self._started:
            self._begin()
        elif not wanted and self._moving:
            self._phase = _Phase.IDLE
        self._started = wanted
        self._advance()
        if self._phase is _Phase.LEAVING:
            self._leave(elapsed)
        else:
            self._ramp(self._speed(), self._objects[0x609A, 0], elapsed)
            # Limit switches do not hold the axis here: homing searches for them.
            self._axis.command_speed(self._reference, guarded=False)
        self._last = self._axis.machine

    def status(self, word: int, elapsed: float) -> int:
        """Returns bits 13, 12 and 10 of the status word: error, attained, target reached."""
        still = TARGET_REACHED * self._stands
        if word & HALT or self._phase is _Phase.IDLE:
            return still
        if self._phase is _Phase.FAILED:
            return BIT_13 | still
        if self._phase is _Phase.DONE:
            return BIT_12 | TARGET_REACHED
        return BIT_12 if self._phase in (_Phase.STOPPING, _Phase.LEAVING) else 0

    @property
    def _stands(self) -> bool:
        return abs(self._axis.speed) <= self._objects[0x606F, 0]

    @property
    def _moving(self) -> bool:
        still = (_Phase.IDLE, _Phase.STOPPING, _Phase.LEAVING, _Phase.DONE, _Phase.FAILED)
        return self._phase not in still

    def _begin(self) -> None:
        axis, method = self._axis, self._objects[0x6098, 0]
        self._last, self._across, self._distance = axis.machine, 0, None
        self._phase = _Phase.FAILED  # if the method is unknown, or the axis has no such switch
        base = method - _WITHOUT_INDEX if method in range(17, 31) else method
        self._with_index = base == method
        if method not in self._options.methods:
            return
        if stop := self._options.hard_stops.get(method):
            self._first, self._across = stop.direction, -stop.direction
            self._with_index, self._distance = stop.index, stop.distance
            self._phase = _Phase.TO_STOP
        elif method in _HERE:
            self._found(axis.machine)
        elif method in _INDEX:
            self._across, self._phase = _INDEX[method], _Phase.TO_INDEX
        elif base in _LIMITS:
            self._search_limit(_LIMITS[base])
        elif base in _HOME:
            self._search_home(*_HOME[base], reverses=base in _AT_LIMITS_REVERSE)

    def _search_limit(self, direction: int) -> None:
        switches = self._axis.switches
        turns = switches.negative if direction < 0 else switches.positive
        if turns is not None:
            self._edge, self._reverses = turns * self._axis.encoder, False
            self._search(NEGATIVE_LIMIT if direction < 0 else POSITIVE_LIMIT, direction, -direction)

    def _search_home(self, first: int, side: int, across: int, *, reverses: bool) -> None:
        home = self._axis.home
        if home is not None:
            self._edge, self._reverses = home[side > 0], reverses
            self._search(HOME, first, across)

    def _search(self, switch: int, first: int, across: int) -> None:
        self._switch, self._first, self._across = switch, first, across
        active = self._axis.inputs & switch
        self._phase = _Phase.BEFORE_EDGE if active else _Phase.TO_SWITCH

    def _advance(self) -> None:
        axis = self._axis
        if self._phase is _Phase.TO_SWITCH:
            if axis.inputs & self._switch:
                self._phase = _Phase.BEFORE_EDGE
            elif axis.inputs & (POSITIVE_LIMIT if self._first > 0 else NEGATIVE_LIMIT):
                self._first = -self._first
                self._phase = _Phase.TO_SWITCH if self._reverses else _Phase.FAILED
                self._reverses = False
        beyond = (axis.machine - self._edge) * self._across
        if self._phase is _Phase.BEFORE_EDGE and beyond < 0:
            self._phase = _Phase.TO_EDGE
        elif self._phase is _Phase.TO_EDGE and beyond >= 0:
            self._reach(self._edge)
        elif self._phase is _Phase.TO_STOP and self._pushes:
            distance = self._objects[self._distance] if self._distance else 0
            self._reach(axis.machine + self._across * distance)
        if self._phase is _Phase.TO_INDEX:
            index = self._index_passed()
            if index is not None:
                self._found(index)
        if self._phase is _Phase.STOPPING and self._reference == 0.0 and self._stands:
            self._attain()

    @property
    def _pushes(self) -> bool:
        """Whether the motor pushes against a stop."""
        motor, threshold = self._axis.motor, self._objects[self._options.threshold]
        rated = 1000 if self._options.in_milliampere else 1000 / motor.data.rated_current
        return self._stands and abs(motor.current) * rated >= threshold

    def _reach(self, reference: float) -> None:
        """At a switch or a stop: this is the reference, or the index pulse that follows."""
        if self._with_index:
            self._phase, self._last = _Phase.TO_INDEX, reference
        else:
            self._found(reference)

    def _index_passed(self) -> float | None:
        """Returns the first index pulse between the last position and this one, or None."""
        here, last = self._axis.machine, self._last
        if (here - last) * self._across < 0:
            return None  # it still brakes
        pulse = self._axis.pulse(last, self._across)
        return pulse if min(last, here) <= pulse <= max(last, here) else None

    def _found(self, reference: float) -> None:
        move = self._objects[self._options.move] if self._options.move else 0
        self._end = reference + (self._across or 1) * move
        self._axis.shift = self._objects[self._options.position] - self._end
        self._phase = _Phase.STOPPING

    def _attain(self) -> None:
        if self._options.move and self._objects[self._options.move]:
            self._motion = Trapezoid(self._axis.position, 0.0)
            self._phase = _Phase.LEAVING
        else:
            self._phase, self._axis.homed = _Phase.DONE, True

    def _leave(self, elapsed: float) -> None:
        """Moves to the place where the reference is said to be."""
        objects, motion, end = self._objects, self._motion, self._end + self._axis.shift
        ramp = objects[0x609A, 0]
        motion.step(end, objects[0x6099, 2], ramp, ramp, elapsed)
        self._axis.command_position(motion.position, motion.speed)
        near = abs(self._axis.position - end) <= objects[0x6067, 0]
        if motion.position == end and near and self._stands:
            self._phase, self._axis.homed, self._reference = _Phase.DONE, True, 0.0

    def _speed(self) -> float:
        """Returns the target speed of the phase."""
        search, zero = self._objects[0x6099, 1], self._objects[0x6099, 2]
        if self._phase in (_Phase.TO_SWITCH, _Phase.TO_STOP):
            return self._first * search
        if self._phase is _Phase.BEFORE_EDGE:
            return -self._across * search
        if self._phase in (_Phase.TO_EDGE, _Phase.TO_INDEX):
            return self._across * zero
        return 0.0

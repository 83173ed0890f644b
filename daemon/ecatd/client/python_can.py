"""The plug-in for python-can: `can.Bus(interface="ecatd", channel="ecat0/6")`.

python-can finds it by its entry point (`can.interface` in pyproject.toml), so nothing of ecatd
imports this module.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Any

from can import (
    BusABC,
    BusState,
    CanInitializationError,
    CanOperationError,
    CanProtocol,
    CanTimeoutError,
    Message,
)
from can.typechecking import AutoDetectedConfig

from ecatd.base.errors import BusyError, EcatError, LeaseError, NoAnswerError, UnreachableError
from ecatd.base.timeouts import Timeout
from ecatd.shm.contract import CanKind, CanState
from ecatd.shm.files import buses

from .arguments import refuse, seconds
from .can import CanChannel, CanFrame, Range, frame, wall_clock
from .can_errors import error_frame
from .client import Client

_LOOK = 0.1
"""Seconds until a thread that receives notices that the bus was shut down."""
_PAUSE = 0.05
"""Seconds between two looks for a daemon that has gone."""
_FLUSH = 1.0
"""Seconds that frames have to be sent when the bus is shut down."""

_STATES = {
    CanState.ACTIVE: BusState.ACTIVE,
    CanState.WARNING: BusState.ACTIVE,
    CanState.PASSIVE: BusState.PASSIVE,
}


class EcatdBus(BusABC):
    """A CAN bus behind an EtherCAT terminal, by the daemon ecatd.

    Any number of buses of any number of programs can be open on one channel. Each sees the frames
    that the others have sent. A frame comes back with `receive_own_messages` when the terminal has
    confirmed that it was sent. Time stamps are those of the EtherCAT cycle.

    Any thread may send or receive: those that send take turns, and so do those that receive.

    Only `shutdown`, or the end of a `with` without an exception, ends it in order. Otherwise the
    program counts as lost, and the safe frames are sent.

    Args:
        channel: Bus and terminal, such as `ecat0/6` or `ecat0/gripper`; without a slash, the
            terminal on `ecat0`.
        can_filters: Filters of python-can.
        receive_own_messages: Whether frames of this bus are received, too, when they were sent.
        reserve: Identifiers, or pairs of the first and the last one, that no other program can send
            meanwhile.
        lease: Seconds without `send` after which this program counts as lost, and the safe frames
            of the channel are sent; 0: only the end or the stop of its process counts.
        bitrate: The bit rate that the channel must have; None: any. The configuration of ecatd sets
            it.
        fd: Must be false: terminals have no CAN FD.
        **kwargs: Arguments of `can.BusABC`.

    Raises:
        CanInitializationError: The daemon does not run, or has no such channel, or it has another
            bit rate.
    """

    def __init__(
        self,
        channel: Any,
        can_filters: Any = None,
        receive_own_messages: bool = False,
        reserve: Iterable[int | Range] = (),
        lease: float = 0,
        bitrate: int | None = None,
        fd: bool = False,
        **kwargs: Any,
    ) -> None:
        if fd:
            raise CanInitializationError("EtherCAT terminals have no CAN FD: leave fd out")
        name = str(channel)
        bus, _, slave = name.rpartition("/")
        self._receive_own = receive_own_messages
        self._reserve = tuple(reserve)
        try:
            self._lease = seconds("lease", lease)
            if self._lease < 0:
                raise refuse("lease", "a number of seconds, or 0", lease)
        except EcatError as error:
            raise CanInitializationError(str(error)) from error
        self._news: deque[CanFrame] = deque()
        self._claimed = False
        self._sending, self._receiving = threading.Lock(), threading.Lock()
        # Each claim gives this bus another number as a sender, and each daemon counts anew. Frames
        # with an earlier number may still come.
        self._numbers: set[tuple[int, int]] = set()
        try:
            # Two clients: one thread can wait for frames while another one sends.
            self._reader, self._writer = Client(bus or "ecat0"), Client(bus or "ecat0")
            place = int(slave) if slave.isdecimal() else slave
            self._in: CanChannel = self._reader.can(place)
            self._out: CanChannel = self._writer.can(place)
            there = self._in.info.bit_rate
            if bitrate not in (None, there):
                raise CanInitializationError(
                    f"{name} has a bit rate of {there}, not {bitrate}: leave bitrate out, or "
                    "change bit_rate of its [slave.can] in the configuration of ecatd"
                )
            if self._reserve:
                self._claim()
        except EcatError as error:
            hint = "" if bus else f": channel '{name}' has no bus, as in 'ecat0/6'"
            raise CanInitializationError(f"{error}{hint}") from error
        self.channel_info = f"ecatd: slave {self._in.info.slave} of bus {self._reader.name}"
        self._channel = name
        self._can_protocol = CanProtocol.CAN_20
        super().__init__(channel=channel, can_filters=can_filters, **kwargs)

    # --- receiving --------------------------------------------------------------------------------

    def _recv_internal(self, timeout: float | None) -> tuple[Message | None, bool]:
        with self._receiving:
            return self._receive(timeout)

    def _receive(self, timeout: float | None) -> tuple[Message | None, bool]:
        end = None if timeout is None else time.monotonic() + timeout
        while True:
            if self._is_shutdown:
                raise CanOperationError("this bus was shut down")
            while self._news:
                if (message := self._message(self._news.popleft())) is not None:
                    return message, False
            try:
                self._news.extend(self._in.read())
                if self._news:
                    continue
                left = _LOOK if end is None else end - time.monotonic()
                if left <= 0:
                    return None, False
                self._in.wait(min(left, _LOOK))
            except NoAnswerError:
                continue
            except UnreachableError:  # reading goes on as soon as the daemon is back
                if end is not None and time.monotonic() + _PAUSE > end:
                    return None, False
                time.sleep(_PAUSE)
            except EcatError as error:
                raise CanOperationError(str(error)) from error

    def _message(self, found: CanFrame) -> Message | None:
        own = (self._reader.instance, found.sender) in self._numbers
        if found.kind in (CanKind.RECEIVED, CanKind.SENT):
            if own and not self._receive_own:
                return None
            return Message(
                timestamp=wall_clock(found.time_ns),
                arbitration_id=found.identifier,
                is_extended_id=found.extended,
                is_remote_frame=found.remote,
                dlc=found.length,
                data=found.data,
                channel=self._channel,
                is_rx=not own,
            )
        if found.kind == CanKind.UNSENT and not own:
            return None
        identifier, data = error_frame(found)
        return Message(
            timestamp=wall_clock(found.time_ns),
            arbitration_id=identifier,
            is_extended_id=False,
            is_error_frame=True,
            dlc=8,
            data=data,
            channel=self._channel,
        )

    # --- sending ----------------------------------------------------------------------------------

    def _claim(self) -> None:
        self._out.claim(self._lease, self._reserve)
        self._numbers.add((self._writer.instance, self._out.sender))
        self._claimed = True

    def send(self, msg: Message, timeout: float | None = None) -> None:
        """Puts a frame into the queue of this bus.

        Args:
            msg: A frame of CAN 2.0. Nothing happens with an error frame: terminals cannot send it.
            timeout: Seconds to wait for room in the queue; None: as long as the CAN bus works.

        Raises:
            CanOperationError: There is no room, and the CAN controller is bus-off or has stopped;
                another program has reserved the identifier; or the daemon has ended. If this
                program had lost its place, the next call gets another.
            CanTimeoutError: There was no room in time.
        """
        if msg.is_error_frame:  # python-can's bridge would end by an error
            return
        if msg.is_fd:
            raise CanOperationError("EtherCAT terminals have no CAN FD: send a frame of CAN 2.0")
        end = None if timeout is None else time.monotonic() + timeout
        with self._sending:
            self._put(msg, timeout, end)

    def _put(self, msg: Message, timeout: float | None, end: float | None) -> None:
        if self._is_shutdown:
            raise CanOperationError("this bus was shut down")
        try:
            one = frame(
                msg.arbitration_id,
                b"" if msg.is_remote_frame else bytes(msg.data),
                msg.is_extended_id,
                msg.is_remote_frame,
                msg.dlc,
            )
            if not self._claimed:
                self._claim()
            while True:
                try:
                    self._out.send_all([one])
                except BusyError as error:
                    if end is None and self._out.info.state not in _STATES:
                        raise CanOperationError(str(error)) from error
                    if end is not None and time.monotonic() >= end:
                        patience = Timeout(timeout or 0, "timeout")
                        raise CanTimeoutError(f"{error}; no room in {patience}") from error
                    self._writer.wait(1, 1.0)
                else:
                    return
        except EcatError as error:
            if isinstance(error, (LeaseError, UnreachableError)):
                self._claimed = False
            raise CanOperationError(str(error)) from error

    def flush_tx_buffer(self) -> None:
        """Waits until the frames of this bus were sent, a second at most.

        Raises:
            CanOperationError: Some still wait.
        """
        with self._sending:
            if not self._claimed:
                return
            try:
                self._out.flush(_FLUSH)
            except EcatError as error:
                raise CanOperationError(str(error)) from error

    def shutdown(self) -> None:
        """Sends what waits, for a second at most, and gives the place of this bus back."""
        self._end(in_order=True)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._end(in_order=kind is None)

    def __del__(self) -> None:
        if not self._is_shutdown:
            self._end(in_order=False)

    def _end(self, *, in_order: bool) -> None:
        """Ends this bus; unless in order, the daemon sends the safe frames."""
        if self._is_shutdown:
            return
        super().shutdown()
        if not hasattr(self, "_out"):  # the constructor has failed
            return
        with self._sending:
            if self._claimed and in_order and not self._writer.closed:
                with suppress(EcatError):  # then the daemon drops what still waits
                    self._out.flush(_FLUSH)
                    self._out.release()
            self._writer.close()
        with self._receiving:  # a thread that receives ends within `_LOOK`
            self._reader.close()

    # --- state ------------------------------------------------------------------------------------

    @property
    def state(self) -> BusState:
        """State of the CAN controller in the terminal; `ERROR` also without a daemon."""
        try:
            return _STATES.get(self._out.info.state, BusState.ERROR)
        except EcatError:
            return BusState.ERROR

    @state.setter
    def state(self, new_state: BusState) -> None:
        raise NotImplementedError("the terminal decides about the state of its CAN controller")

    @staticmethod
    def _detect_available_configs() -> Sequence[AutoDetectedConfig]:
        found: list[AutoDetectedConfig] = []
        for bus in buses():
            try:
                with Client(bus) as client:
                    found += [
                        {"interface": "ecatd", "channel": f"{bus}/{slave}"}
                        for slave in client.can_terminals()
                    ]
            except EcatError:
                continue
        return found

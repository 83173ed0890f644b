"""`ecatctl can bridge`: the frames of a CAN terminal on a CAN interface of Linux, and back.

`python -m can.bridge` could do it as well, but one of its directions ends, and the program goes on
without it, when a frame cannot be sent: after a restart of the daemon, for an identifier that
somebody has reserved, or while the interface is down.
"""

from __future__ import annotations

import errno
import socket
import struct
import sys
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from pathlib import Path

from ecatd.base.errors import (
    BusyError,
    EcatError,
    LeaseError,
    NoAnswerError,
    OwnedError,
    StateError,
    UnreachableError,
    UsageError,
)
from ecatd.client import Client
from ecatd.client.can import CanFrame, frame
from ecatd.client.can_errors import error_frame
from ecatd.shm.contract import CanKind, CanState

_FRAME = struct.Struct("=IB3x8s")
"""`struct can_frame`: identifier with flags, length, data."""
_EXTENDED, _REMOTE, _ERROR = socket.CAN_EFF_FLAG, socket.CAN_RTR_FLAG, socket.CAN_ERR_FLAG
_SO_RXQ_OVFL = 40
"""Has the kernel say with each frame how many it had no room for."""
_ROOM = 1 << 20
_SWING = 0.5
"""Seconds between two looks whether it is over."""
_FULL = 0.1
"""Seconds that an interface without room is waited for."""
_FULL_ERRORS = (errno.ENOBUFS, errno.EAGAIN)
_FLUSH = 1.0
"""Seconds that frames have to be sent at the end."""


def open_interface(name: str) -> socket.socket:
    """Opens a CAN interface of Linux.

    Raises:
        StateError: The kernel has no CAN.
        UsageError: There is no such interface.
    """
    try:
        there = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    except OSError as error:
        raise StateError(
            f"the kernel of this machine has no CAN sockets ({error.strerror}): try "
            "'modprobe can-raw'"
        ) from error
    try:
        there.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
        there.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _ROOM)
        there.bind((name,))
    except OSError as error:
        there.close()
        raise UsageError(
            f"'{name}' is no CAN interface ({error.strerror}). `ip -brief link show type can` and "
            f"`type vcan` show which there are; 'ip link add {name} type vcan' and "
            f"'ip link set {name} up' make a virtual one"
        ) from error
    return there


def is_virtual(name: str) -> bool:
    """Whether frames on an interface stay in this machine."""
    return "virtual" in Path("/sys/class/net", name).resolve().parts


class Bridge:
    """Carries frames in both directions, until it is over.

    A thread of its own carries those of the interface. Nothing ends the bridge but a failure that
    will not pass: frames that cannot be carried meanwhile are dropped, counted and told.

    Args:
        bus: Name of the bus.
        slave: Position of the terminal.
        there: Socket of the interface.
        name: Name of the interface.
        errors: Whether error frames may be sent on it. A real CAN bus must get none.
        tell: Is called with each sentence that the user should read.
    """

    def __init__(
        self,
        bus: str,
        slave: int,
        there: socket.socket,
        name: str,
        errors: bool,
        tell: Callable[[str], None],
    ) -> None:
        self._there, self._name, self._errors, self._tell = there, name, errors, tell
        # Python's own time-outs would ask the kernel twice for each frame.
        for option in (socket.SO_RCVTIMEO, socket.SO_SNDTIMEO):
            there.setsockopt(socket.SOL_SOCKET, option, struct.pack("@ll", 0, int(_SWING * 1e6)))
        # A client belongs to one thread.
        self._reader, self._writer = Client(bus), Client(bus)
        self._in, self._out = self._reader.can(slave), self._writer.can(slave)
        self._own: set[tuple[int, int]] = set()
        self._claimed = False
        self._claim()
        self._over = threading.Event()
        self._failure: Exception | None = None
        self._lost: deque[tuple[str, int]] = deque()
        self._told = 0.0
        self._overflowed = self._missed = 0

    def run(self, is_over: Callable[[], bool]) -> None:
        """Carries frames until a signal has come; then those that wait are sent, in a second.

        Raises:
            EcatError: It cannot go on.
        """
        inwards = threading.Thread(target=self._carry_inwards)
        inwards.start()
        try:
            while not is_over() and self._failure is None:
                self._carry_outwards()
                self._tell_losses(_SWING)
        finally:
            self._over.set()
            inwards.join()
            self._tell_losses(0)
            self._end()
        if self._failure is not None:
            raise self._failure

    def _end(self) -> None:
        try:
            if self._claimed:
                self._out.flush(_FLUSH)
                self._out.release()
        except EcatError as error:
            self._tell(f"at the end: {error}")
        self._writer.close()
        self._reader.close()

    def _drop(self, count: int, why: str) -> None:
        self._lost.append((why, count))

    def _tell_losses(self, interval: float) -> None:
        if self._lost and time.monotonic() >= self._told + interval:
            self._told = time.monotonic()
            counts: Counter[str] = Counter()
            while self._lost:
                why, count = self._lost.popleft()
                counts[why] += count
            for why, count in counts.items():
                self._tell(f"{count} frame{'s' if count != 1 else ''} dropped: {why}")

    # --- from the terminal to the interface -------------------------------------------------------

    def _carry_outwards(self) -> None:
        try:
            self._in.wait(_SWING)
            found = self._in.read()
            missed = self._in.info.missed
        except NoAnswerError:
            return
        except UnreachableError:  # reading goes on as soon as the daemon is back
            time.sleep(_SWING)
            return
        if missed != self._missed:
            self._drop(missed - self._missed, "this program was too slow to read them")
            self._missed = missed
        instance = self._reader.instance
        frames = [self._packed(one, (instance, one.sender) in self._own) for one in found]
        self._put([one for one in frames if one is not None])

    def _packed(self, found: CanFrame, own: bool) -> bytes | None:
        if found.kind in (CanKind.RECEIVED, CanKind.SENT):
            if own:  # it came from the interface
                return None
            word = found.identifier | _EXTENDED * found.extended | _REMOTE * found.remote
            return _FRAME.pack(word, found.length, found.data)
        if not self._errors or (found.kind == CanKind.UNSENT and not own):
            return None
        identifier, data = error_frame(found)
        return _FRAME.pack(identifier | _ERROR, len(data), data)

    def _put(self, frames: list[bytes]) -> None:
        end = time.monotonic() + _FULL
        while frames:
            try:
                self._there.send(frames[0])
            except OSError as error:
                if error.errno in _FULL_ERRORS and time.monotonic() < end:
                    time.sleep(0.001)
                    continue
                self._drop(len(frames), f"{self._name} takes none ({error.strerror})")
                self._check(error)
                return
            del frames[0]

    def _check(self, error: OSError) -> None:
        """Ends the bridge where the interface does not come back."""
        if error.errno not in (*_FULL_ERRORS, errno.ENETDOWN):
            self._failure = StateError(f"{self._name} is gone: {error.strerror}")

    # --- from the interface to the terminal -------------------------------------------------------

    def _carry_inwards(self) -> None:
        while not self._over.is_set():
            try:
                data, told, *_ = self._there.recvmsg(_FRAME.size, 64)
            except OSError as error:  # EAGAIN: nothing came
                self._check(error)
                if self._failure is not None:
                    return
                continue
            try:
                self._take(data, told)
            except (EcatError, OSError) as error:
                self._failure = error
                return

    def _take(self, data: bytes, told: list[tuple[int, int, bytes]]) -> None:
        for level, kind, value in told:
            if (level, kind) == (socket.SOL_SOCKET, _SO_RXQ_OVFL):
                count = int.from_bytes(value[:4], sys.byteorder)
                if count != self._overflowed:
                    why = f"{self._name} is faster than the CAN bus"
                    self._drop(count - self._overflowed, why)
                self._overflowed = count
        word, length, content = _FRAME.unpack(data)
        remote, extended = bool(word & _REMOTE), bool(word & _EXTENDED)
        identifier = word & (socket.CAN_EFF_MASK if extended else socket.CAN_SFF_MASK)
        length = min(length, 8)
        self._send(frame(identifier, b"" if remote else content[:length], extended, remote, length))

    def _send(self, one: CanFrame) -> None:
        try:
            while not (self._over.is_set() or self._is_queued(one)):
                if (state := self._out.info.state) in (CanState.BUS_OFF, CanState.STOPPED):
                    word = state.name.lower().replace("_", "-")
                    self._drop_all(f"the CAN controller is {word}")
                    break
                self._writer.wait(1, _SWING)
        except OwnedError as error:
            self._drop(1, str(error))
        except (LeaseError, UnreachableError, NoAnswerError) as error:
            # What waits is old, and the safe frames of the channel were sent meanwhile.
            self._claimed = False
            self._drop_all(str(error))

    def _is_queued(self, one: CanFrame) -> bool:
        if not self._claimed:
            self._claim()
        try:
            self._out.send_all([one])
        except BusyError:
            return False
        return True

    def _claim(self) -> None:
        self._out.claim()
        self._own.add((self._writer.instance, self._out.sender))
        self._claimed = True

    def _drop_all(self, why: str) -> None:
        """Drops the frame at hand, and those that wait in the socket."""
        count = 1
        try:
            while self._there.recv(_FRAME.size, socket.MSG_DONTWAIT):
                count += 1
        except OSError:
            self._drop(count, why)

"""CAN behind a terminal, for programs: frames that are received, and frames that are sent."""

from __future__ import annotations

import ctypes
import struct
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from ecatd.base.errors import UnreachableError, UsageError
from ecatd.shm.contract import CAN_EXTENDED, CAN_ID, CAN_REMOTE, CanKind, CanState

from .arguments import seconds
from .connection import Connection
from .structs import CAN_FRAME, QUICK, WAITING, CanFrameStruct, CanInfoStruct, CanRangeStruct

_ROOM = 512
"""Frames that are read in one call."""

_FRAME = struct.Struct(CAN_FRAME)

Range = tuple[int, int]


class CanFrame(NamedTuple):
    """A frame of a CAN channel, or another of its records.

    Attributes:
        identifier: Its identifier.
        data: Its bytes, 0 to 8; of a remote frame none.
        extended: The identifier has 29 bits.
        remote: It is a remote frame.
        length: Bytes of data; of a remote frame those that it asks for.
        kind: What it is: a frame that was received or sent, or news of the controller.
        sender: The client that has sent it, as `CanChannel.sender` says; 0: another node, or ecatd.
        safe: ecatd has sent it, since the client that sends else has ended.
        cycle: Cycle in which the terminal delivered it, or said that it was sent.
        time_ns: CLOCK_MONOTONIC of this cycle, in ns.
        number: Number of a frame of a client, as `CanChannel.send` returns it.
    """

    identifier: int
    data: bytes = b""
    extended: bool = False
    remote: bool = False
    length: int = 0
    kind: CanKind = CanKind.RECEIVED
    sender: int = 0
    safe: bool = False
    cycle: int = 0
    time_ns: int = 0
    number: int = 0

    @property
    def state(self) -> tuple[CanState, int, int]:
        """What a record of the kind `STATE` says: the state, and the counters of errors.

        The first counter is that for sending, the second that for receiving; 255 stands for more.
        """
        state, sending, receiving = self.data[:3]
        return CanState(state), sending, receiving


@dataclass(frozen=True, slots=True)
class CanInfo:
    """What is known about a CAN channel.

    Attributes:
        slave: Position of the terminal.
        bit_rate: Bits in a second.
        identifier_bits: 11, or 29 for both kinds of frames.
        receive_queue: Frames that the terminal delivers in one batch, at most.
        send_queue: Frames that it takes in one batch, at most.
        state: State of the CAN controller.
        send_errors: Its error counter for sending.
        receive_errors: Its error counter for receiving.
        reserved: Ranges of identifiers that clients have reserved.
        safe_active: Safe frames that are being sent.
        received: Frames of other nodes since the start of the daemon, as all that follow.
        sent: Frames that were sent.
        safe: Safe frames among them.
        unsent: Frames that the terminal had taken and lost.
        dropped: Frames that still waited when their sender ended.
        refused: Frames that were malformed, or reserved by another client.
        overflows: How often the terminal has lost frames that it received.
        bus_offs: How often the controller has gone bus-off.
        restarts: How often the terminal has begun anew.
        missed: Records that this client has read too late.
        waiting: Frames in the queue of this client.
        own_sent: Frames of this client that were sent, since it claimed the channel.
        own_refused: Frames of these that were refused.
        own_unsent: Frames of these that the terminal has lost.
    """

    slave: int
    bit_rate: int
    identifier_bits: int
    receive_queue: int
    send_queue: int
    state: CanState
    send_errors: int
    receive_errors: int
    reserved: int
    safe_active: int
    received: int
    sent: int
    safe: int
    unsent: int
    dropped: int
    refused: int
    overflows: int
    bus_offs: int
    restarts: int
    missed: int
    waiting: int
    own_sent: int
    own_refused: int
    own_unsent: int


class CanChannel:
    """A CAN bus behind a terminal; `Client.can` makes it.

    ```python
    with Client("ecat0") as bus:
        can = bus.can(6)
        can.claim()
        can.send(0x605, bytes.fromhex("40 00 10 00 00 00 00 00"))
        can.wait(1.0)
        for frame in can.read():
            print(f"{frame.identifier:03X} {frame.data.hex(' ')}")
    ```

    It belongs to the thread of its client. Programs that use python-can open the channel with
    `can.Bus(interface="ecatd", channel="ecat0/6")`.
    """

    def __init__(self, connection: Connection, slave: int) -> None:
        self._connection = connection
        self._channel = connection.check(QUICK.ecat_can_find(connection.address, slave))
        self._frames = (CanFrameStruct * _ROOM)()
        self._view = memoryview(self._frames).cast("B")
        connection.check(QUICK.ecat_can_listen(connection.address, self._channel))

    @property
    def info(self) -> CanInfo:
        """State and counters.

        Raises:
            UnreachableError: The daemon has ended.
        """
        raw = CanInfoStruct()
        code = QUICK.ecat_can(self._connection.address, self._channel, ctypes.byref(raw))
        self._connection.check_live(code)
        found = {name: getattr(raw, name) for name, *_ in raw._fields_}
        return CanInfo(**found | {"state": CanState(raw.state)})

    # --- reading ----------------------------------------------------------------------------------

    def read(self, until_cycle: int = 0) -> list[CanFrame]:
        """The frames and other records since the last call, 512 at most.

        The first call returns those since this object was made. Frames of all clients are among
        them, when they were sent.

        Args:
            until_cycle: Leave records of later cycles to the next call; 0: take all.

        Raises:
            UnreachableError: The daemon has ended. Once it is back, reading goes on.
        """
        connection = self._connection
        count = QUICK.ecat_can_read(
            connection.address, self._channel, self._frames, _ROOM, until_cycle
        )
        connection.check_live(count)
        return [
            CanFrame(
                word & CAN_ID,
                b"" if word & CAN_REMOTE else data[:length],
                bool(word & CAN_EXTENDED),
                bool(word & CAN_REMOTE),
                length,
                CanKind(kind),
                sender,
                bool(safe),
                cycle,
                time_ns,
                number,
            )
            for word, length, kind, _own, safe, data, cycle, time_ns, sender, number in (
                _FRAME.iter_unpack(self._view[: count * _FRAME.size])
            )
        ]

    def wait(self, timeout: float = 1.0) -> None:
        """Waits until there is something to read.

        Raises:
            NoAnswerError: Nothing came in time.
            UnreachableError: The daemon has ended.
        """
        self._connection.wait(WAITING.ecat_can_wait, "CAN frame", timeout, self._channel)

    # --- sending ----------------------------------------------------------------------------------

    def claim(self, lease: float = 0, reserve: Iterable[int | Range] = ()) -> None:
        """Makes this client a sender of the channel.

        Any number of clients can send on a channel. When this client ends without `release`, its
        frames that wait are dropped, and the safe frames of the configuration are sent.

        Args:
            lease: Seconds without a sample, a commit, `send` or `read` after which it counts as
                ended; 0: only the end or the stop of the process counts, and this client can own
                no outputs.
            reserve: Identifiers, or ranges of them, that nobody else can send meanwhile, 8 at most;
                those up to 0x7FF have 11 bits, others, and those with `CAN_EXTENDED`, 29.

        Raises:
            OwnedError: Another client has reserved one of them.
            UsageError: An argument is out of range.
        """
        ranges = [_range(item) for item in reserve]
        lease = seconds("lease", lease)
        array = (CanRangeStruct * len(ranges))(*ranges)
        try:
            self._claim(lease, array)
        except UnreachableError:  # only now is it known, and another daemon may be there already
            self._claim(lease, array)

    def _claim(self, lease: float, ranges: ctypes.Array[CanRangeStruct]) -> None:
        with self._connection.waiting() as address:
            code = WAITING.ecat_can_claim(
                address, self._channel, lease, ctypes.addressof(ranges), len(ranges)
            )
        self._connection.check_live(code)

    def release(self) -> None:
        """Ends sending in order. Frames that wait are dropped: call `flush` before."""
        with self._connection.waiting() as address:
            code = WAITING.ecat_can_release(address, self._channel)
        self._connection.check_live(code)

    @property
    def sender(self) -> int:
        """What `CanFrame.sender` of frames of this client is; 0: it sends none."""
        return int(QUICK.ecat_can_sender(self._connection.address))

    def send(
        self,
        identifier: int,
        data: bytes = b"",
        *,
        extended: bool | None = None,
        remote: bool = False,
        length: int | None = None,
    ) -> int:
        """Puts a frame into the queue of this client, and returns its number.

        The same number is in the record that says that it was sent.

        Args:
            identifier: Its identifier.
            data: At most 8 bytes.
            extended: The identifier has 29 bits; None: if it is larger than 0x7FF.
            remote: A remote frame.
            length: Bytes that a remote frame asks for; None: 0.

        Raises:
            BusyError: 256 frames of this client wait already.
            OwnedError: Another client has reserved the identifier.
            LeaseError: This client no longer sends: its lease or the daemon has ended.
            UsageError: An argument is out of range.
        """
        return self.send_all([frame(identifier, data, extended, remote, length)])

    def send_all(self, frames: Sequence[CanFrame]) -> int:
        """Puts frames into the queue, as many as there is room for; see `send`.

        Returns:
            The number of the last one. If there is not room for all, it is that of the last one
            that is in the queue.

        Raises:
            EcatError: As `send`, if there is no room for the first one, or it is refused.
        """
        array = (CanFrameStruct * len(frames))()
        for to, one in zip(array, frames, strict=True):
            to.id = one.identifier | CAN_EXTENDED * one.extended | CAN_REMOTE * one.remote
            to.length = one.length if one.remote else len(one.data)
            to.data[: len(one.data)] = one.data
        number = ctypes.c_uint32()
        connection = self._connection
        code = QUICK.ecat_can_send(
            connection.address, self._channel, array, len(frames), ctypes.byref(number)
        )
        connection.check_live(code)
        return number.value

    def flush(self, timeout: float = 1.0) -> None:
        """Waits until all frames of this client were sent, refused, or lost by the terminal.

        It waits also while the cycle stands still.

        Raises:
            NoAnswerError: Some still wait.
            LeaseError: As `send`.
        """
        self._connection.wait(WAITING.ecat_can_flush, "end of the frames", timeout, self._channel)


def frame(
    identifier: int,
    data: bytes = b"",
    extended: bool | None = None,
    remote: bool = False,
    length: int | None = None,
) -> CanFrame:
    """A frame to be sent; the arguments are those of `CanChannel.send`.

    Raises:
        UsageError: An argument is out of range.
    """
    wide = identifier > 0x7FF if extended is None else extended
    if not 0 <= identifier <= (CAN_ID if wide else 0x7FF):
        bits = 29 if wide else 11
        raise UsageError(f"0x{identifier:X} is no identifier of {bits} bits")
    if len(data) > 8 or not 0 <= (length or 0) <= 8:
        raise UsageError(
            f"a CAN frame has at most 8 bytes of data, not {max(len(data), length or 0)}"
        )
    if remote and data:
        raise UsageError("a remote frame has no data")
    size = (length or 0) if remote else len(data)
    return CanFrame(identifier, bytes(data), wide, remote, size)


def _range(item: int | Range) -> CanRangeStruct:
    if isinstance(item, int):
        first = last = item
    elif isinstance(item, tuple | list) and len(item) == 2 and all(type(n) is int for n in item):
        first, last = item
    else:
        raise UsageError(f"{item!r} is no identifier, nor a pair of the first and the last one")
    if not 0 <= first <= CAN_EXTENDED | CAN_ID or not 0 <= last <= CAN_EXTENDED | CAN_ID:
        raise UsageError(f"{item!r} is out of range: identifiers go from 0 to 0x{CAN_ID:X}")
    if last & CAN_ID > 0x7FF:
        first, last = first | CAN_EXTENDED, last | CAN_EXTENDED
    return CanRangeStruct(first, last)


_STEP_NS = 1_000_000
"""How far the two clocks may part before the times of frames follow."""
_epoch_ns = 0  # CLOCK_REALTIME less CLOCK_MONOTONIC


def wall_clock(time_ns: int) -> float:
    """A time of CLOCK_MONOTONIC in ns as seconds since 1970; equal times stay equal."""
    global _epoch_ns
    now = time.time_ns() - time.monotonic_ns()
    if abs(now - _epoch_ns) > _STEP_NS:
        _epoch_ns = now
    return (_epoch_ns + time_ns) / 1e9

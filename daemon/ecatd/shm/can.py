"""The CAN channels of a bus, from its shared memory: states, counters, and who sends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ecatd.base.errors import EcatError

from . import contract as shm
from .contract import CAN_COUNTERS, CanState
from .reader import Reader, opened


@dataclass(frozen=True, slots=True)
class CanSender:
    """A client that sends on a channel.

    Attributes:
        slot: Its slot.
        program: Its name, as it says itself; empty if this user may not know it.
        pid: Its process ID, as it says itself; 0 if this user may not know it.
        waiting: Frames in its queue; None if this user may not know it.
        taken: Frames that were taken out of its queue.
        sent: Frames of these that were sent.
        refused: Frames of these that were malformed, or reserved by another client.
        unsent: Frames of these that the terminal has lost.
        ranges: Identifiers that it has reserved, as pairs of words of the shared memory.
    """

    slot: int
    program: str
    pid: int
    waiting: int | None
    taken: int
    sent: int
    refused: int
    unsent: int
    ranges: tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class CanChannelContents:
    """A channel.

    Attributes:
        slave: Position of the terminal.
        name: Its name.
        bit_rate: Bits in a second.
        identifier_bits: 11 or 29.
        receive_queue: Frames in a batch that is received, at most.
        send_queue: Frames in a batch that is sent, at most.
        state: State of the CAN controller.
        send_errors: Its error counter for sending.
        receive_errors: Its error counter for receiving.
        safe_active: Safe frames that are being sent.
        counters: The counters of `CAN_COUNTERS`, by name.
        senders: Clients that send.
    """

    slave: int
    name: str
    bit_rate: int
    identifier_bits: int
    receive_queue: int
    send_queue: int
    state: CanState
    send_errors: int
    receive_errors: int
    safe_active: int
    counters: dict[str, int]
    senders: tuple[CanSender, ...]


def read_can(bus: str) -> list[CanChannelContents]:
    """The CAN channels of a bus on this machine; asks nobody.

    Args:
        bus: Name of the bus.

    Raises:
        EcatError: No daemon serves the bus, this user may not read it, or the shared memory is of
            another version or damaged.
    """
    with opened(bus) as shared:
        head = shared.header()
        channels = shared.table(head, "can")
        senders = shared.table(head, "can_senders")
        slaves = shared.table(head, "slaves") if channels else []
        return [
            _channel(row, slaves, _senders(shared, head, senders[number :: head.can_count], number))
            for number, row in enumerate(channels)
        ]


def _channel(row: Any, slaves: list[Any], senders: tuple[CanSender, ...]) -> CanChannelContents:
    name = shm.printable(slaves[row.slave].name) if row.slave < len(slaves) else ""
    return CanChannelContents(
        row.slave,
        name,
        row.bit_rate,
        row.identifier_bits,
        row.receive_queue,
        row.send_queue,
        CanState(row.state),
        row.send_errors,
        row.receive_errors,
        row.safe_active,
        {counter.name: getattr(row, counter.name) for counter in CAN_COUNTERS},
        senders,
    )


def _senders(shared: Reader, head: Any, rows: list[Any], channel: int) -> tuple[CanSender, ...]:
    """The clients that send on a channel; `rows` has one for each slot."""
    active = [(slot, row) for slot, row in enumerate(rows) if row.generation]
    if not active:
        return ()
    said: dict[int, tuple[str, int, int | None]] = {}
    try:
        with shared.slots(head) as out:
            for slot, row in active:
                who, queue = out.slot(slot), out.can(slot, channel)
                if who is not None and who.generation == row.generation:
                    waiting = None if queue is None else (queue.written - row.taken) % (1 << 32)
                    said[slot] = (shm.printable(who.program), who.pid, waiting)
    except EcatError:
        pass  # only members of the group may know who they are
    return tuple(
        CanSender(
            slot,
            *said.get(slot, ("", 0, None)),
            row.taken,
            row.sent,
            row.refused,
            row.unsent,
            tuple((item.first, item.last) for item in row.ranges[: row.range_count]),
        )
        for slot, row in active
    )

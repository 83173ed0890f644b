"""CAN behind a terminal: the keys of `[slave.can]` and `[[slave.can.safe]]`, and how they are read.

What depends on the terminal and on the cycle time is checked when the bus is known, see
`resolve/can.py`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Annotated

from ecatd.base.toml_file import Key, Table, accepts, integer, number, one_of, show
from ecatd.etg.can_terminals import (
    DATA_MAX,
    EXTENDED_MAX,
    STANDARD_MAX,
    TERMINALS,
    Mode,
)

from .placed import Placed, read

FULL = "full"
"""As many frames as the bus can have, without data."""

LOST, ENDED = "lost", "ended"

BIT_RATE_MIN, BIT_RATE_MAX = 5, 1000
_QUEUE_MAX = 255
_FRAMES_MAX = 100_000
_RANGES_MAX = 64
_SAFE_MAX = 32
_RANGE = re.compile(r"\s*(0[xX][0-9a-fA-F]+|[0-9]+)(?:\s*-\s*(0[xX][0-9a-fA-F]+|[0-9]+))?\s*")

Range = tuple[int, int]


def _parse_range(text: str) -> Range | None:
    """Two identifiers, both included; None if the text is no range."""
    match = _RANGE.fullmatch(text)
    if match is None:
        return None
    first = int(match[1], 0)
    last = int(match[2], 0) if match[2] else first
    return (first, last) if first <= last <= EXTENDED_MAX else None


def _range(row: Table, key: Key) -> str:
    value = row.data[key]
    if type(value) is int and 0 <= value <= EXTENDED_MAX:
        return f"0x{value:03X}"
    found = _parse_range(value) if isinstance(value, str) else None
    if found is None:
        row.fail(
            key,
            f"is {show(value)}, but must be an identifier such as 0x181, or a range of them such "
            f'as "0x180-0x1FF", up to 0x{EXTENDED_MAX:X}',
        )
    first, last = found
    return f"0x{first:03X}" if first == last else f"0x{first:03X}-0x{last:03X}"


@accepts(f'identifiers such as `0x181`, ranges such as `"0x180-0x1FF"`; at most {_RANGES_MAX}')
def _ranges(table: Table, key: Key) -> list[str]:
    found = table.array(key, _range, 'a list such as [0x181, "0x200-0x27F"]')
    if len(found) > _RANGES_MAX:
        table.fail(key, f"has {len(found)} ranges, but can have {_RANGES_MAX}: join some of them")
    return found


@accepts(f"at most {DATA_MAX} bytes")
def _data(table: Table, key: Key) -> str:
    text = table.text(key)
    try:
        data = bytes.fromhex(text)
    except ValueError:
        table.fail(key, f'must be hexadecimal bytes such as "01 00", not {table.show(key)}')
    if len(data) > DATA_MAX:
        table.fail(key, f"has {len(data)} bytes, but a CAN frame has at most {DATA_MAX}")
    return text


@accepts("11 or 29")
def _identifiers(table: Table, key: Key) -> int:
    value = table.data[key]
    if type(value) is not int or value not in (11, 29):
        table.fail(key, f"is {show(value)}, but must be 11 or 29")
    return value


@accepts(f'`"{FULL}"`, or 1 to {_FRAMES_MAX}')
def _frames(table: Table, key: Key) -> str | int:
    if table.data[key] == FULL:
        return FULL
    if type(table.data[key]) is not int:
        table.fail(key, f'must be "{FULL}" or a whole number, not {table.show(key)}')
    return table.integer(key, 1, _FRAMES_MAX)


@dataclass(slots=True)
class CanSafeConfig(Placed):
    """`[[slave.can.safe]]`: one table for each frame that ecatd sends when a sender is gone.

    When a client that has sent on this CAN bus dies, hangs or loses its lease, its waiting frames
    are dropped, and ecatd sends [these frames](can.md#safe-frames) in their order. It sends them,
    too, when it stops.

    Attributes:
        id: Identifier, such as `0x000` for NMT.
        extended: The identifier has 29 bit. Default: `true` if `id` is larger than 0x7FF.
        remote: A remote frame; it has no data.
        data: Its bytes, such as `"01 00"`.
        period_ms: Time after which it is sent again, until a sender that counts is there again; 0:
            it is sent once.
        identifiers: The senders that count: those that have sent one of these identifiers. Default:
            all senders.
        when: `"lost"`: when a sender dies, hangs or loses its lease; `"ended"`: also when it ends
            in order.
    """

    id: Annotated[int, integer(0, EXTENDED_MAX)]
    extended: Annotated[bool | None, Table.boolean] = None
    remote: Annotated[bool, Table.boolean] = False
    data: Annotated[str, _data] = ""
    period_ms: Annotated[int, integer(0, 60_000)] = 0
    identifiers: Annotated[list[str], _ranges] = field(default_factory=list)
    when: Annotated[str, one_of((LOST, ENDED))] = LOST

    @property
    def is_extended(self) -> bool:
        """Whether the identifier has 29 bit."""
        return self.id > STANDARD_MAX if self.extended is None else self.extended

    @property
    def senders(self) -> tuple[Range, ...]:
        """`identifiers` as numbers; none: all senders."""
        return ranges(self.identifiers)


def _safe(table: Table, key: Key) -> list[CanSafeConfig]:
    rows = table.tables(key)
    if len(rows) > _SAFE_MAX:
        rows[_SAFE_MAX].fail(None, f"is one too many: there can be {_SAFE_MAX} safe frames")
    found = []
    for row in rows:
        safe = read(CanSafeConfig, row)
        if safe.id > STANDARD_MAX and safe.extended is False:
            row.fail(
                "id", f"0x{safe.id:X} needs 29 bit: leave extended out, or correct one of them"
            )
        if safe.remote and safe.data:
            row.fail("data", "a remote frame has no data: leave one of them out")
        found.append(safe)
    return found


@dataclass(slots=True)
class SlaveCanConfig(Placed):
    """`[slave.can]`: the [CAN bus](can.md) behind a terminal.

    It says what ecatd writes to the terminal when that starts or comes back, and lets clients send
    and receive CAN frames. Its outputs belong to ecatd then. Without this table, they are process
    data like others.

    Attributes:
        bit_rate: Bit rate in kbit/s; the terminal can have only some.
        layout: The [terminal](can.md#terminals) like which the slave behaves, such as `"el6751"`.
            Default: by vendor ID and product code.
        identifiers: Most bits of an identifier. 29 carries those of 11 bit, too. Default: 29 where
            the terminal can, 11 in a fast mode.
        mode: How frames go through the [process data](can.md#queues): `"buffered"`: in batches that
            are acknowledged; `"fast"`, `"optimized"`: without, for identifiers of 11 bit and
            without filters.
        sample_point: Where the terminal samples a bit, in percent; refused if it is elsewhere.
            Default: any.
        frames_per_second: Frames a second, each way, for which the [queues](can.md#queues) must be
            long enough; `"full"`: as many as the bus can have. Default: as many as the bus can
            have, as far as the terminal can.
        receive_queue: Most received frames in a batch. Default: computed from `frames_per_second`
            and the cycle time.
        send_queue: Most frames to be sent in a batch. Default: as `receive_queue`.
        filters: Identifiers that the terminal receives; none: all.
        flags: Flags of the terminal that choose identifiers and mode (object 0x8000:20). Default:
            those that are known; needed for a fast mode.
        bus_off_restart_ms: Time after which a terminal that is [bus-off](can.md#bus-off) is
            started anew, if it does not take part again by itself; 0: never.
        safe: Frames that ecatd sends when a sender is gone.
    """

    bit_rate: Annotated[int, integer(BIT_RATE_MIN, BIT_RATE_MAX)]
    layout: Annotated[str | None, one_of(item.key for item in TERMINALS)] = None
    identifiers: Annotated[int | None, _identifiers] = None
    mode: Annotated[str, one_of(Mode)] = Mode.BUFFERED.value
    sample_point: Annotated[float | None, number(50, 95)] = None
    frames_per_second: Annotated[str | int | None, _frames] = None
    receive_queue: Annotated[int | None, integer(1, _QUEUE_MAX)] = None
    send_queue: Annotated[int | None, integer(1, _QUEUE_MAX)] = None
    filters: Annotated[list[str], _ranges] = field(default_factory=list)
    flags: Annotated[int | None, integer(0, 0xFFFF)] = None
    bus_off_restart_ms: Annotated[int, integer(0, 3_600_000)] = 1000
    safe: Annotated[list[CanSafeConfig], _safe] = field(default_factory=list)


def ranges(texts: list[str]) -> tuple[Range, ...]:
    """Ranges of identifiers as numbers."""
    found = map(_parse_range, texts)
    return tuple(item for item in found if item is not None)


def read_slave_can(row: Table, key: Key) -> SlaveCanConfig:
    """Reads `[slave.can]`."""
    table = row.table(key)
    config = read(SlaveCanConfig, table)
    if config.mode != Mode.BUFFERED:
        if config.identifiers == 29:
            table.fail(
                "identifiers",
                f'mode = "{config.mode}" has identifiers of 11 bit only: leave this out, or write '
                f'mode = "{Mode.BUFFERED}"',
            )
        if config.filters:
            table.fail(
                "filters",
                f'mode = "{config.mode}" has no filters: leave them out, or write '
                f'mode = "{Mode.BUFFERED}"',
            )
    if config.identifiers == 11 or config.mode != Mode.BUFFERED:
        for safe in config.safe:
            if safe.is_extended:
                safe.table.fail(
                    "id",
                    f"0x{safe.id:X} has 29 bit, but identifiers have 11 bit here: correct one of "
                    "them",
                )
        for first, last in ranges(config.filters):
            if last > STANDARD_MAX:
                table.fail(
                    "filters",
                    f"0x{first:X} to 0x{last:X} is beyond 0x{STANDARD_MAX:X}, the largest "
                    "identifier of 11 bit: correct the range, or write identifiers = 29",
                )
    return config

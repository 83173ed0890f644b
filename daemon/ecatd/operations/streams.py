"""Streams of values: the operation that opens one, and what is published."""

from __future__ import annotations

from .operation import Map, Operation


class StreamSignal(Map):
    """An entry of a stream.

    Attributes:
        name: SLAVE/ENTRY.
        slave: Position of the slave.
        address: Its address, as `0x6041:00`.
        unit: Unit of its values; may be empty.
    """

    name: str
    slave: int
    address: str
    unit: str


class Stream(Map):
    """A stream that was opened.

    Attributes:
        key: The key under which its rows are published.
        rate: Rows a second.
        cycles: Cycles of each row.
        signals: Its entries.
    """

    key: str
    rate: float
    cycles: int
    signals: list[StreamSignal]


class StreamRow(Map):
    """A row of a stream.

    Attributes:
        cycle: Number of its last cycle.
        values: For each of the signals its minimum, mean and maximum in the cycles of the row, and
            the number of cycles in which it was valid. The first three are None if that is 0.
    """

    cycle: int
    values: list[list[float | None]]


class PdoValue(Map):
    """A value of the process data.

    Attributes:
        raw: The value as it is in the frame.
        value: The physical value.
        unit: Its unit; may be empty.
        name: Name of the entry; may be empty.
        cycle: Number of the cycle.
    """

    raw: float
    value: float
    unit: str
    name: str
    cycle: int


class OpenStream(Operation[Stream]):
    """Opens a stream of entries; it ends 5 s after the last reader has left.

    Readers with the same pattern and rate share a stream.

    Attributes:
        pattern: SLAVE/ENTRY with `*` and `?`, percent-encoded: `4%2F*`.
        hz: Rows a second.
    """

    op = "stream"
    key = "ro/stream"
    pattern: str = "*"
    hz: float = 10.0

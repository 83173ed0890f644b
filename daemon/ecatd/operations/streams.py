"""Streams of values: the operation that opens one, and what is published."""

from __future__ import annotations

from .operation import Map, Operation


class StreamSignal(Map):
    """An entry of a stream."""

    name: str  #: SLAVE/ENTRY.
    slave: int  #: Position of the slave.
    address: str  #: Its address, as `0x6041:00`.
    unit: str  #: Unit of its values; may be empty.


class Stream(Map):
    """A stream that was opened."""

    key: str  #: The key under which its rows are published.
    rate: float  #: Rows a second.
    cycles: int  #: Cycles of each row.
    signals: list[StreamSignal]  #: Its entries.


class StreamRow(Map):
    """A row of a stream."""

    cycle: int  #: Number of its last cycle.
    #: For each of the signals its minimum, mean and maximum in the cycles of the row, and the
    #: number of cycles in which it was valid. The first three are None if that is 0.
    values: list[list[float | None]]


class PdoValue(Map):
    """A value of the process data."""

    raw: float  #: The value as it is in the frame.
    value: float  #: The physical value.
    unit: str  #: Its unit; may be empty.
    name: str  #: Name of the entry; may be empty.
    cycle: int  #: Number of the cycle.


class OpenStream(Operation[Stream]):
    """Opens a stream of entries; it ends 5 s after the last reader has left.

    Readers with the same pattern and rate share a stream.
    """

    op = "stream"
    key = "ro/stream"
    pattern: str = "*"  #: SLAVE/ENTRY with `*` and `?`, percent-encoded: `4%2F*`.
    hz: float = 10.0  #: Rows a second.

"""Traces: the value of each of some entries in every cycle."""

from __future__ import annotations

from ecatd.etg.datatypes import is_real, is_signed

from .fields import COUNT_MAX, Count
from .operation import Map, Operation

TYPES = {
    "int8": "b", "int16": "h", "int32": "i", "int64": "q",
    "uint8": "B", "uint16": "H", "uint32": "I", "uint64": "Q",
    "float32": "f", "float64": "d",
}  # fmt: skip
"""The types of values in columns, with their letters in `struct` and `array`."""


def column_type(data_type: int, bit_length: int) -> str:
    """The type of the values of an entry in a column, such as `uint16`: the least that has them."""
    if is_real(data_type):
        return "float32" if bit_length == 32 else "float64"
    bits = next(bits for bits in (8, 16, 32, 64) if bit_length <= bits)
    return f"{'int' if is_signed(data_type) else 'uint'}{bits}"


class TraceSignal(Map):
    """An entry of a trace."""

    name: str  #: SLAVE/ENTRY.
    slave: int  #: Position of the slave.
    address: str  #: Its address, as `0x6041:00`.
    output: bool  #: Whether it is an output.
    #: The type of its values in batches: `int8` to `int64`, `uint8` to `uint64`, `float32` or
    #: `float64`.
    type: str
    scale: float  #: Physical value = value * scale + offset.
    offset: float  #: See `scale`.
    unit: str  #: Unit of the physical value; may be empty.


class Trace(Map):
    """A trace that was opened."""

    key: str  #: The key under which its batches are published.
    cycle_time_us: int  #: The base cycle.
    signals: list[TraceSignal]  #: Its entries.


class TraceBatch(Map):
    """Some cycles of a trace, one after the other. All numbers in bytes are little endian."""

    #: Their numbers, 8 bytes each. A number is missing if no frame of its cycle was sent.
    cycles: bytes
    times_ns: bytes  #: CLOCK_MONOTONIC when the values came, in ns: 8 bytes each.
    clock_ns: int  #: These times plus this are Unix time.
    columns: list[bytes]  #: For each entry of the trace its values, as its type says.
    #: Where the value of an entry is an older one, since its slave did not take part: the place of
    #: the entry in the trace, and the places of such cycles in the batch.
    invalid: list[list[int]]
    #: Number of the last cycle of the batch before; 0 for the first batch. If this is another cycle
    #: than the last one that you have, batches were lost on the way.
    after: int
    lost: bool  #: Whether cycles in between are lost, since the gateway got no processor for long.


class History(Map):
    """A part of what was before a trace was opened."""

    signals: list[TraceSignal]  #: The entries, as in [Trace](#trace).
    #: Number of the first cycle that the answer can have: `begin` of the request, or a greater one,
    #: if the daemon keeps no older ones.
    begin: int
    #: Cycles, as in a trace; `after` is that of the part before, if somebody has just read it.
    batch: TraceBatch
    next: int  #: Where the next request goes on: behind the last cycle of the batch.
    more: bool  #: Whether there are more cycles before `end`.


class OpenTrace(Operation[Trace]):
    """Opens a trace of entries; it ends 5 s after the last reader has left.

    Readers with the same patterns share a trace.
    """

    op = "trace"
    key = "ro/trace"
    #: SLAVE/ENTRY with `*` and `?`, percent-encoded: `4%2F*`. Several stand in lines (`%0A`).
    patterns: str = "*"


class ReadHistory(Operation[History]):
    """Asks for the values of entries in cycles of the last seconds.

    The daemon has them as long as it keeps the frames (`flight_recorder.memory_mb`). An answer has
    some hundred cycles; ask again with `begin` = `next` while there are `more`. To have all cycles
    up to now and from now on: open a trace, wait for its first batch, and ask for the cycles before
    its first one.
    """

    op = "history"
    key = "ro/history"
    patterns: str = "*"  #: As in `ro/trace`.
    begin: Count = 0  #: Number of the first cycle; 0 for the oldest that is kept.
    end: Count = COUNT_MAX  #: Number of the cycle behind the last one; by default all there are.

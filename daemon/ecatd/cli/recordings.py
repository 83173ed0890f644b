"""Files of `ecatctl record`: CSV, MCAP (Foxglove, PlotJuggler) and Parquet (pandas, Polars).

A disk may become full at any time, so a file of each kind is whole after each error. A CSV file is
cut behind its last whole row. MCAP and Parquet files need an end, so room is kept for it (`_Room`).
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
import stat
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from typing import Any, NamedTuple, Protocol

from ecatd.base.errors import StateError, UsageError
from ecatd.base.recording_file import (
    EXTRAS,
    NUMBER,
    SCHEMA,
    TIME,
    UTC,
    cell_text,
    column_title,
    iso_utc,
)
from ecatd.base.version import VERSION

Cell = float | int | None
"""A value; None if it cannot be trusted."""

_ROWS = 5000
"""Rows of a Parquet file that are kept before they are written."""
_TEXT = 1 << 13
"""Characters of a CSV file that are kept before they are written."""
_STEP = 1 << 20
"""Bytes of a file for which room is made at once."""
_MESSAGE, _CHUNK = 64, 256
"""Most bytes of an MCAP file for a message beside its data, and for a chunk in the index."""
_LIBRARIES = {".mcap": "mcap", ".parquet": "pyarrow"}
"""What writes files of some formats."""
_CELL, _GROUP, _COLUMN = 16, 512, 1024
"""Most bytes of a Parquet file for a value, for each column of 5000 rows, and for a column."""


class Column(NamedTuple):
    """A column."""

    name: str  #: SLAVE/ENTRY.
    unit: str  #: Unit of its values, or empty.
    kind: str  #: `float64`, `int64` or `uint64`.

    @property
    def title(self) -> str:
        """Name and unit."""
        return column_title(self.name, self.unit)


class Recording(Protocol):
    """A file that is being written."""

    rows: int  #: How many cycles are in the file for good. After `end`, these are all.
    infinite: int  #: How many values are missing in the file since it cannot have infinity and NaN.

    def add(self, seconds: float, cycle: int, cells: Sequence[Cell], utc_ns: int) -> None:
        """Adds a cycle.

        Args:
            seconds: Time since the first one.
            cycle: Its number.
            cells: A value for each column.
            utc_ns: Unix time of its values in ns.

        Raises:
            OSError: The file cannot be written, for example because the disk is full.
        """

    def end(self) -> None:
        """Writes the rest of the file. Raises as `add`."""


def open_recording(suffix: str, file: io.FileIO, bus: str, columns: Sequence[Column]) -> Recording:
    """Begins a recording.

    Args:
        suffix: One of `FORMATS`.
        file: The file, empty. `Recording.end` does not close it.
        bus: Name of the bus.
        columns: The columns.
    """
    return FORMATS[suffix](file, bus, columns)


def check_format(suffix: str, name: object) -> None:
    """Checks that a format is known, and that its library is there.

    Raises:
        UsageError: The format is unknown.
        StateError: The library is missing.
    """
    if suffix not in FORMATS:
        raise UsageError(f"{name}: give a file name that ends with {', '.join(FORMATS)}")
    if suffix not in _LIBRARIES:
        return
    library = _LIBRARIES[suffix]
    try:
        import_module(library)
    except ImportError as error:
        raise StateError(
            f"{name}: files of this kind need the package {library}: pip install "
            f"'ecatd[{EXTRAS[library]}]'; CSV needs none"
        ) from error


class _Csv:
    def __init__(self, file: io.FileIO, bus: str, columns: Sequence[Column]) -> None:
        del bus
        self.rows = 0
        self._file = file
        self.infinite = 0
        self._size = 0  # bytes of the whole rows in the file
        self._begin()
        self._lines.writerow([TIME, NUMBER, *(column.title for column in columns), UTC])
        self._write()

    def _begin(self) -> None:
        self._text = io.StringIO(newline="")
        self._lines: Any = csv.writer(self._text)
        self._waiting = 0

    def add(self, seconds: float, cycle: int, cells: Sequence[Cell], utc_ns: int) -> None:
        self._lines.writerow([f"{seconds:.6f}", cycle, *map(cell_text, cells), iso_utc(utc_ns)])
        self._waiting += 1
        if self._text.tell() >= _TEXT:
            self._write()

    def _write(self) -> None:
        data, waiting, written = self._text.getvalue().encode(), self._waiting, 0
        self._begin()
        try:
            while written < len(data):
                written += self._file.write(data[written:]) or 0
        except OSError:
            whole = data[:written].rfind(b"\n") + 1
            waiting -= data.count(b"\n", whole)
            with suppress(OSError):  # a pipe cannot be cut
                self._file.truncate(self._size + whole)
            raise
        finally:
            self.rows += max(0, waiting)
        self._size += written

    def end(self) -> None:
        self._write()


class _Room:
    """Keeps room on the disk for all that a file needs to become whole.

    Args:
        file: The file.
        buffer: What has been written goes here first.
    """

    def __init__(self, file: io.FileIO) -> None:
        self._file = file
        self.buffer = io.BufferedWriter(file)
        self._is_file = stat.S_ISREG(os.fstat(file.fileno()).st_mode)
        self._size = 0

    def keep(self, size: int) -> None:
        """Makes room for so many bytes behind those that have been written.

        Raises:
            OSError: There is no such room; the room that there was stays.
        """
        size += self.buffer.tell() if self._is_file else 0
        if not self._is_file or size <= self._size:
            return
        more = size - self._size
        try:
            os.posix_fallocate(self._file.fileno(), self._size, more + _STEP)
            self._size = size + _STEP
        except OSError:
            os.posix_fallocate(self._file.fileno(), self._size, more)
            self._size = size

    def end(self) -> None:
        """Gives the rest of the room back."""
        self.buffer.flush()
        if self._is_file:
            self._file.truncate(self.buffer.tell())
        self.buffer.detach()


class _Mcap:
    """One channel for the bus; a message in JSON for each cycle, with a JSON schema."""

    def __init__(self, file: io.FileIO, bus: str, columns: Sequence[Column]) -> None:
        values = {
            column.name: {"type": ["number", "null"], "description": column.unit}
            for column in columns
        }
        whole = {"cycle": {"type": "integer"}, "values": {"type": "object", "properties": values}}
        schema = json.dumps({"type": "object", "properties": whole}).encode()
        self._room = _Room(file)
        self._end = 4096 + 2 * len(schema)  # the schema is in the first chunk, too
        self._room.keep(self._end)
        writer: Any = import_module("mcap.writer").Writer(self._room.buffer)
        writer.start(library=f"ecatctl {VERSION}")
        number = writer.register_schema(name=SCHEMA, encoding="jsonschema", data=schema)
        self._channel = writer.register_channel(
            topic=f"/{bus}", message_encoding="json", schema_id=number
        )
        self._writer = writer
        self._names = [column.name for column in columns]
        self._begin_ns: int | None = None
        self.rows = self.infinite = 0
        self._count = 0
        self._chunk = 0  # bytes of the present chunk at most

    def add(self, seconds: float, cycle: int, cells: Sequence[Cell], utc_ns: int) -> None:
        finite = [None if cell is None or not math.isfinite(cell) else cell for cell in cells]
        self.infinite += finite.count(None) - list(cells).count(None)
        values = dict(zip(self._names, finite, strict=True))  # JSON has no infinity
        if self._begin_ns is None:
            self._begin_ns = utc_ns
        at = self._begin_ns + round(1e9 * seconds)  # ascends, even if somebody sets the clock back
        data = json.dumps({"cycle": cycle, "values": values}).encode()
        self._chunk += _MESSAGE + len(data)
        self._room.keep(self._end + self._chunk)
        before = self._room.buffer.tell()
        self._writer.add_message(
            channel_id=self._channel, log_time=at, publish_time=at, sequence=cycle, data=data
        )
        self._count += 1
        if self._room.buffer.tell() != before:  # the chunk has been written
            self._chunk = 0
            self._end += _CHUNK

    def end(self) -> None:
        self._writer.finish()
        self._room.end()
        self.rows = self._count


class _Parquet:
    def __init__(self, file: io.FileIO, bus: str, columns: Sequence[Column]) -> None:
        self._arrow: Any = import_module("pyarrow")
        arrow = self._arrow
        fields = [arrow.field(TIME, arrow.float64()), arrow.field(NUMBER, arrow.uint64())]
        for column in columns:
            kind = getattr(arrow, column.kind)()
            fields.append(arrow.field(column.name, kind, metadata={"unit": column.unit}))
        fields.append(arrow.field(UTC, arrow.timestamp("us", tz="UTC")))
        self._schema = arrow.schema(fields, metadata={"bus": bus, "ecatctl": VERSION})
        self._room = _Room(file)
        self._end = 4096 + _COLUMN * len(fields)
        self._room.keep(self._end)
        self._writer: Any = import_module("pyarrow.parquet").ParquetWriter(
            self._room.buffer, self._schema
        )
        self._rows: list[tuple[Cell, ...]] = []
        self.rows = self.infinite = 0
        self._count = 0

    def add(self, seconds: float, cycle: int, cells: Sequence[Cell], utc_ns: int) -> None:
        row = (seconds, cycle, *cells, utc_ns // 1000)
        self._room.keep(self._end + len(row) * (_GROUP + _CELL * (len(self._rows) + 1)))
        self._rows.append(row)
        self._count += 1
        if len(self._rows) >= _ROWS:
            self._write()

    def _write(self) -> None:
        if self._rows:
            columns = [
                self._arrow.array(column, type=field.type)
                for column, field in zip(zip(*self._rows, strict=True), self._schema, strict=True)
            ]
            self._writer.write_batch(
                self._arrow.RecordBatch.from_arrays(columns, schema=self._schema)
            )
            self._end += _GROUP * len(self._schema)
            self._rows.clear()

    def end(self) -> None:
        self._write()
        self._writer.close()
        self._room.end()
        self.rows = self._count


FORMATS: dict[str, type[_Csv | _Mcap | _Parquet]] = {
    ".csv": _Csv,
    ".mcap": _Mcap,
    ".parquet": _Parquet,
}
"""The formats, by the end of the file name."""

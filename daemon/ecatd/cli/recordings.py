"""Files of `ecatctl record`: CSV, MCAP (Foxglove, PlotJuggler) and Parquet (pandas, Polars)."""

from __future__ import annotations

import csv
import io
import json
import math
import time
from collections.abc import Sequence
from importlib import import_module
from typing import Any, BinaryIO, NamedTuple, Protocol

from ecatd.model.errors import StateError, UsageError
from ecatd.version import VERSION

Cell = float | int | None
"""A value; None if it cannot be trusted."""

_ROWS = 5000
"""Rows of a Parquet file that are kept before they are written."""


class Column(NamedTuple):
    """A column.

    Attributes:
        name: SLAVE/ENTRY.
        unit: Unit of its values, or empty.
        kind: `float64`, `int64` or `uint64`.
    """

    name: str
    unit: str
    kind: str

    @property
    def title(self) -> str:
        """Name and unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


class Recording(Protocol):
    """A file that is being written."""

    def add(self, seconds: float, cycle: int, cells: Sequence[Cell]) -> None:
        """Adds a cycle: the time since the first one, its number, and a value for each column."""

    def end(self) -> None:
        """Writes the rest of the file."""


def open_recording(suffix: str, file: BinaryIO, bus: str, columns: Sequence[Column]) -> Recording:
    """Begins a recording.

    Args:
        suffix: One of `FORMATS`.
        file: The file, empty.
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
    library = {".mcap": "mcap", ".parquet": "pyarrow"}.get(suffix)
    if library is None:
        return
    try:
        import_module(library)
    except ImportError as error:
        raise StateError(
            f"{name}: files of this kind need the package {library}: pip install 'ecatd[record]'; "
            "CSV needs none"
        ) from error


class _Csv:
    def __init__(self, file: BinaryIO, bus: str, columns: Sequence[Column]) -> None:
        del bus
        self._text = io.TextIOWrapper(file, encoding="utf-8", newline="", write_through=True)
        self._rows: Any = csv.writer(self._text)
        self._rows.writerow(["time_s", "cycle", *(column.title for column in columns)])

    def add(self, seconds: float, cycle: int, cells: Sequence[Cell]) -> None:
        texts = ("" if c is None else f"{c:.15g}" if isinstance(c, float) else c for c in cells)
        self._rows.writerow([f"{seconds:.6f}", cycle, *texts])

    def end(self) -> None:
        self._text.flush()
        self._text.detach()


class _Mcap:
    """One channel for the bus; a message in JSON for each cycle, with a JSON schema."""

    def __init__(self, file: BinaryIO, bus: str, columns: Sequence[Column]) -> None:
        writer: Any = import_module("mcap.writer").Writer(file)
        writer.start(library=f"ecatctl {VERSION}")
        values = {
            column.name: {"type": ["number", "null"], "description": column.unit}
            for column in columns
        }
        whole = {"cycle": {"type": "integer"}, "values": {"type": "object", "properties": values}}
        schema = json.dumps({"type": "object", "properties": whole}).encode()
        number = writer.register_schema(name="ecatd.cycle", encoding="jsonschema", data=schema)
        self._channel = writer.register_channel(
            topic=f"/{bus}", message_encoding="json", schema_id=number
        )
        self._writer = writer
        self._names = [column.name for column in columns]
        self._begin_ns = time.time_ns()

    def add(self, seconds: float, cycle: int, cells: Sequence[Cell]) -> None:
        finite = (None if cell is None or not math.isfinite(cell) else cell for cell in cells)
        values = dict(zip(self._names, finite, strict=True))  # JSON has no infinity
        at = self._begin_ns + round(1e9 * seconds)
        data = json.dumps({"cycle": cycle, "values": values}).encode()
        self._writer.add_message(
            channel_id=self._channel, log_time=at, publish_time=at, sequence=cycle, data=data
        )

    def end(self) -> None:
        self._writer.finish()


class _Parquet:
    def __init__(self, file: BinaryIO, bus: str, columns: Sequence[Column]) -> None:
        self._arrow: Any = import_module("pyarrow")
        arrow = self._arrow
        fields = [arrow.field("time_s", arrow.float64()), arrow.field("cycle", arrow.uint64())]
        for column in columns:
            kind = getattr(arrow, column.kind)()
            fields.append(arrow.field(column.name, kind, metadata={"unit": column.unit}))
        self._schema = arrow.schema(fields, metadata={"bus": bus, "ecatctl": VERSION})
        self._writer: Any = import_module("pyarrow.parquet").ParquetWriter(file, self._schema)
        self._rows: list[tuple[Cell, ...]] = []

    def add(self, seconds: float, cycle: int, cells: Sequence[Cell]) -> None:
        self._rows.append((seconds, cycle, *cells))
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
            self._rows.clear()

    def end(self) -> None:
        self._write()
        self._writer.close()


FORMATS: dict[str, type[_Csv | _Mcap | _Parquet]] = {
    ".csv": _Csv,
    ".mcap": _Mcap,
    ".parquet": _Parquet,
}
"""The formats, by the end of the file name."""

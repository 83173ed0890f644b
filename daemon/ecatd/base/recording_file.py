"""Reads files of `ecatctl record`: CSV, MCAP and Parquet. `ecatd.cli.recordings` writes them.

Files of the flight recorder are others: see `incident_file.py`.
"""

from __future__ import annotations

import csv
import io
import json
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import UTC as _ZONE
from datetime import datetime
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from .addresses import parse_address
from .errors import ConfigError, EcatError, StateError
from .files import open_regular
from .mcap_file import DamagedError, McapFile, in_words

TIME, NUMBER, UTC = "time_s", "cycle", "utc"
"""The first two columns, and the last one: when the values came, by the clock of the PC."""
EXTRAS = {"mcap": "record", "pyarrow": "parquet"}
"""The packages that files of some formats need, and the extra of ecatd that brings each."""
SCHEMA = "ecatd.cycle"
"""Name of the schema of the messages."""
_TITLE = re.compile(r"(\d+)/(.*) \((0x[0-9A-Fa-f]+:[0-9A-Fa-f]+)\)")


class Place(NamedTuple):
    """Where the values of a column come from."""

    slave: int  #: Position of the slave.
    label: str  #: Name of the entry.
    address: tuple[int, int]  #: Index and subindex.

    @classmethod
    def of(cls, column: str) -> Place | None:
        """That of a column such as `4/Value (0x6000:11)`, in any format; None: it names none."""
        match = _TITLE.fullmatch(column)
        address = parse_address(match[3]) if match else None
        return cls(int(match[1]), match[2], address) if match and address else None


class RecordingFile:
    """A recording in MCAP: a message in JSON for each cycle. Only what is asked for is read.

    Args:
        path: The file.

    Raises:
        OSError: The file cannot be read.
        ValueError: It is no MCAP file.
        ImportError: The package `mcap` is missing.
    """

    def __init__(self, path: Path) -> None:
        self._file = McapFile(path)
        self.is_cut = self._file.is_cut  #: Whether its end is missing.

    def cycles(self) -> Iterator[tuple[int, int, Mapping[str, Any]]]:
        """Unix time in ns, number of the cycle, and values by column; None for a missing one.

        Raises:
            OSError: The file cannot be read.
            ValueError: It holds something else; `DamagedError` behind all that can be read.
        """
        for message in self._file.messages(lambda _, schema: schema and schema.name == SCHEMA):
            try:
                content = json.loads(message.data)
                found = message.log_time, content["cycle"], dict(content["values"])
            except (LookupError, RecursionError, TypeError, ValueError) as error:
                raise ValueError(f"its messages are no values{in_words(error)}") from error
            yield found

    def units(self) -> dict[str, str]:
        """The units by column, from the schema of the file; they may be missing."""
        found: dict[str, str] = {}
        for schema in self._file.schemas.values():
            with suppress(AttributeError, LookupError, TypeError, ValueError):
                if schema.name == SCHEMA:
                    values = json.loads(schema.data)["properties"]["values"]["properties"]
                    found |= {name: str(it.get("description", "")) for name, it in values.items()}
        return found


def iso_utc(utc_ns: int) -> str:
    """A time as in ISO 8601, in UTC with microseconds: `2026-11-25T17:40:12.345678Z`."""
    seconds, ns = divmod(utc_ns, 10**9)
    return f"{time.strftime('%Y-%m-%dT%H:%M:%S', time.gmtime(seconds))}.{ns // 1000:06}Z"


def cell_text(cell: float | None) -> str:
    """A value in a CSV file: 15 digits, and whole numbers exact; empty if it is not known."""
    return "" if cell is None else f"{cell:.15g}" if isinstance(cell, float) else str(cell)


def column_title(name: str, unit: str) -> str:
    """The title of a column in a CSV file."""
    return f"{name} [{unit}]" if unit else name


def recorded_rows(path: Path, tell: Callable[[str], object]) -> Iterator[Sequence[Any]]:
    """Yields the head and then the rows of a recording, as its CSV file has them.

    A cell of a value is a text, a number, or empty: `""` or None.

    Args:
        path: The file.
        tell: Called behind all rows that could be read, if there were more in the file.

    Raises:
        OSError: The file cannot be read.
        ConfigError: It is no recording.
        StateError: The library for files of this kind is missing.
    """
    read = {".mcap": _mcap, ".parquet": _parquet}.get(path.suffix.lower(), _csv)
    has_rows = False
    try:
        for row in read(path):
            yield row
            has_rows = True
    except (OSError, EcatError):
        raise
    except DamagedError as error:
        if not has_rows:
            raise ConfigError(str(error)) from error
        tell(str(error))
    except Exception as error:  # the libraries raise many kinds of errors
        what = _WRONG.get(read) or in_words(error).removeprefix(": ") or "it is damaged"
        text = what if str(path) in what else f"{path}: this is not a recording: {what}"
        raise ConfigError(text) from error


def _csv(path: Path) -> Iterator[Sequence[str]]:
    with io.TextIOWrapper(open_regular(path), "utf-8", newline="") as file:
        yield from csv.reader(file)


def _mcap(path: Path) -> Iterator[Sequence[Any]]:
    _library(path, "mcap.reader")
    file = RecordingFile(path)
    names: list[str] | None = None
    begin = 0
    for time_ns, number, values in file.cycles():
        if names is None:
            names, begin, units = [*values], time_ns, file.units()
            yield [TIME, NUMBER, *(column_title(name, units.get(name, "")) for name in names), UTC]
        moment = datetime.fromtimestamp(time_ns / 1e9, _ZONE)
        yield [1e-9 * (time_ns - begin), number, *(values[name] for name in names), moment]


def _parquet(path: Path) -> Iterator[Sequence[Any]]:
    parquet = _library(path, "pyarrow.parquet")
    with open_regular(path) as file:
        table = parquet.ParquetFile(file)
        yield [
            column_title(item.name, (item.metadata or {}).get(b"unit", b"").decode())
            for item in table.schema_arrow
        ]
        for batch in table.iter_batches():
            yield from zip(*(column.to_pylist() for column in batch.columns), strict=True)


_WRONG: Mapping[Any, str] = {
    _csv: "it is not text in CSV",
    _parquet: (
        "it is no Parquet file, is damaged, or its writer was killed: then nothing in it can be "
        "read, while MCAP and CSV can be"
    ),
}


def _library(path: Path, name: str) -> Any:
    try:
        return import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        raise StateError(
            f"{path}: files of this kind need the package {package}: pip install "
            f"'ecatd[{EXTRAS[package]}]'; CSV needs none"
        ) from error

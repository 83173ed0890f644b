"""Reads files of `ecatctl record`: CSV, MCAP and Parquet. `ecatd.cli.recordings` writes them."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Sequence
from datetime import UTC as _ZONE
from datetime import datetime
from importlib import import_module
from pathlib import Path
from typing import Any

from .errors import ConfigError, EcatError, StateError

TIME, NUMBER, UTC = "time_s", "cycle", "utc"
"""The first two columns, and the last one: when the values came, by the clock of the PC."""
EXTRAS = {"mcap": "record", "pyarrow": "parquet"}
"""The packages that files of some formats need, and the extra of ecatd that brings each."""


def column_title(name: str, unit: str) -> str:
    """The title of a column in a CSV file."""
    return f"{name} [{unit}]" if unit else name


def recorded_rows(path: Path) -> Iterator[Sequence[Any]]:
    """Yields the head and then the rows of a recording, as its CSV file has them.

    A cell of a value is a text, a number, or empty: `""` or None.

    Raises:
        OSError: The file cannot be read.
        ConfigError: It is no recording.
        StateError: The library for files of this kind is missing.
    """
    read = {".mcap": _mcap, ".parquet": _parquet}.get(path.suffix.lower(), _csv)
    try:
        yield from read(path)
    except (OSError, EcatError):
        raise
    except Exception as error:  # the libraries raise many kinds of errors
        what = "it is not text in CSV" if read is _csv else f"{error!r}"
        raise ConfigError(f"{path}: this is not a recording: {what}") from error


def _csv(path: Path) -> Iterator[Sequence[str]]:
    with path.open(newline="", encoding="utf-8") as file:
        yield from csv.reader(file)


def _mcap(path: Path) -> Iterator[Sequence[Any]]:
    make_reader = _library(path, "mcap.reader").make_reader
    names: list[str] | None = None
    begin = 0
    with path.open("rb") as file:
        for schema, _, message in make_reader(file).iter_messages():
            content = json.loads(message.data)
            if names is None:
                names, begin = [*content["values"]], message.log_time
                units = _units(json.loads(schema.data))
                titles = (column_title(name, units.get(name, "")) for name in names)
                yield [TIME, NUMBER, *titles, UTC]
            cells = (content["values"][name] for name in names)
            moment = datetime.fromtimestamp(message.log_time / 1e9, _ZONE)
            yield [1e-9 * (message.log_time - begin), content["cycle"], *cells, moment]


def _units(schema: dict[str, Any]) -> dict[str, str]:
    found = schema["properties"]["values"]["properties"]
    return {name: item["description"] for name, item in found.items()}


def _parquet(path: Path) -> Iterator[Sequence[Any]]:
    parquet = _library(path, "pyarrow.parquet")
    with path.open("rb") as file:
        table = parquet.ParquetFile(file)
        yield [
            column_title(item.name, (item.metadata or {}).get(b"unit", b"").decode())
            for item in table.schema_arrow
        ]
        for batch in table.iter_batches():
            yield from zip(*(column.to_pylist() for column in batch.columns), strict=True)


def _library(path: Path, name: str) -> Any:
    try:
        return import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        raise StateError(
            f"{path}: files of this kind need the package {package}: pip install "
            f"'ecatd[{EXTRAS[package]}]'; CSV needs none"
        ) from error

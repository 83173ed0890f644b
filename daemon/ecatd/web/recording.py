"""A recording of `ecatctl record` in MCAP, for pages."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

from ecatd.base.addresses import address_text, parse_address
from ecatd.base.errors import EcatError, UsageError

from .hub import Hub

_TITLE = re.compile(r"(\d+)/(.*) \((0x[0-9A-Fa-f]+:[0-9A-Fa-f]+)\)")
_SCHEMA = "ecatd.cycle"


class Recording:
    """See `ecatd.web.file_source.Contents`.

    Args:
        path: The file.

    Raises:
        UsageError: It cannot be read, or is no such recording.
    """

    about = "a recording; nothing in it changes"

    def __init__(self, path: Path) -> None:
        self._path = path
        self._reader: Any = import_module("mcap.reader").make_reader
        first = next(self.cycles(), None)
        if first is None:
            raise UsageError(f"{path}: there are no values of `ecatctl record` in it")
        units = self._units()
        found: dict[str, Mapping[str, Any]] = {}
        self.columns: dict[str, str] = {}
        for column in first[2]:
            described = _describe(column, units.get(column, ""))
            found[described["name"]] = described
            self.columns[described["name"]] = column
        self.signals = [*found.values()]
        self.answers: dict[str, Mapping[str, Any] | EcatError] = {}

    def cycles(self) -> Iterator[tuple[int, int, Mapping[str, Any]]]:
        """See `Contents`."""
        try:
            with self._path.open("rb") as file:
                for schema, _, message in self._reader(file).iter_messages():
                    if schema is not None and schema.name == _SCHEMA:
                        content = json.loads(message.data)
                        values = dict(content["values"])
                        yield message.log_time, content["cycle"], values
        except OSError as error:
            raise UsageError(f"cannot read '{self._path}': {error.strerror}") from error
        except EcatError:
            raise
        except Exception as error:  # the library raises many kinds of errors
            raise UsageError(
                f"{self._path}: this is not a whole recording of `ecatctl record`: {error!r}"
            ) from error

    def tell(self, hub: Hub) -> None:
        """See `Contents`: there is nothing else."""

    def _units(self) -> dict[str, str]:
        """The units, from the schema of the file; they may be missing."""
        found: dict[str, str] = {}
        with self._path.open("rb") as file, suppress(Exception):  # of many kinds, by the library
            for schema in self._reader(file).get_summary().schemas.values():
                if schema.name == _SCHEMA:
                    values = json.loads(schema.data)["properties"]["values"]["properties"]
                    found |= {name: str(it.get("description", "")) for name, it in values.items()}
        return found


def _describe(column: str, unit: str) -> dict[str, Any]:
    match = _TITLE.fullmatch(column)
    address = parse_address(match[3]) if match else None
    slave, _, entry = column.partition("/")
    return {
        "name": f"{match[1]}/{address_text(*address)}" if match and address else column,
        "label": f"{match[1]}/{match[2]}" if match else column,
        "path": column,
        "slave": int(slave) if slave.isdigit() else -1,
        "address": address_text(*address) if address else entry,
        "output": False,
        "type": "float64",
        "bits": 64,
        "scale": 1.0,
        "offset": 0.0,
        "unit": unit,
        "minimum": None,
        "maximum": None,
        "values": {},
    }

"""Reads recordings of `ecatctl record` in MCAP: a message in JSON for each cycle.

`ecatd.cli.recordings` writes them; `ecatctl web` and the simulator read them with this module.
Files of the flight recorder are others: see `incident_file.py`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from .addresses import parse_address

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
    """A recording. Only what is asked for is read.

    Args:
        path: The file.

    Raises:
        ImportError: The package `mcap` is missing.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._make_reader: Any = import_module("mcap.reader").make_reader

    def cycles(self) -> Iterator[tuple[int, int, Mapping[str, Any]]]:
        """Unix time in ns, number of the cycle, and values by column; None for a missing one.

        Raises:
            OSError: The file cannot be read.
            ValueError: It is no MCAP file, is damaged, or holds something else.
        """
        with self._path.open("rb") as file:
            messages = self._make_reader(file).iter_messages()
            while True:
                try:
                    schema, _, message = next(messages)
                    if schema is None or schema.name != SCHEMA:
                        continue
                    content = json.loads(message.data)
                    found = message.log_time, content["cycle"], dict(content["values"])
                except StopIteration:
                    return
                except OSError:
                    raise
                except Exception as error:  # the library raises many kinds of errors
                    raise ValueError(f"{error!r}") from error
                yield found

    def units(self) -> dict[str, str]:
        """The units by column, from the schema of the file; they may be missing."""
        found: dict[str, str] = {}
        with self._path.open("rb") as file, suppress(Exception):  # of many kinds, by the library
            for schema in self._make_reader(file).get_summary().schemas.values():
                if schema.name == SCHEMA:
                    values = json.loads(schema.data)["properties"]["values"]["properties"]
                    found |= {name: str(it.get("description", "")) for name, it in values.items()}
        return found

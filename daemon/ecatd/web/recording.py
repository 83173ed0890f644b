"""A recording of `ecatctl record` in MCAP, for pages."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

from ecatd.base.addresses import address_text
from ecatd.base.errors import EcatError, UsageError
from ecatd.base.mcap_file import DamagedError
from ecatd.base.recording_file import Place, RecordingFile

from .hub import Hub

_LOOKED_AT = 1000
"""Cycles at the begin of a file that say what is a bit, since the file does not."""
_BIT = {0, 1}


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
        try:
            self._file = RecordingFile(path)
        except OSError as error:
            raise UsageError(f"cannot read '{path}': {error.strerror}") from error
        except ValueError as error:
            raise UsageError(str(error)) from error
        if self._file.is_cut:
            self.about = "a recording that ends in the middle; all of it that is whole is here"
        seen: defaultdict[str, set[Any]] = defaultdict(set)
        try:
            for _, _, cells in islice(self.cycles(), _LOOKED_AT):
                for column, cell in cells.items():
                    if len(seen[column]) <= len(_BIT):
                        seen[column].add(cell)
        except UsageError:  # pages hear of what is damaged where they come to it
            if not seen:
                raise
        if not seen:
            raise UsageError(f"{path}: there are no values of `ecatctl record` in it")
        units = self._file.units()
        found: dict[str, Mapping[str, Any]] = {}
        self.columns: dict[str, str] = {}
        for column, values in seen.items():
            described = _describe(column, units.get(column, ""), is_bit=values == _BIT)
            found[described["name"]] = described
            self.columns[described["name"]] = column
        self.signals = [*found.values()]
        self.named: list[str] = []
        self.answers: dict[str, Mapping[str, Any] | EcatError] = {}

    def cycles(self) -> Iterator[tuple[int, int, Mapping[str, Any]]]:
        """See `Contents`."""
        try:
            yield from self._file.cycles()
        except OSError as error:
            raise UsageError(f"cannot read '{self._path}': {error.strerror}") from error
        except DamagedError as error:
            raise UsageError(str(error)) from error
        except ValueError as error:
            raise UsageError(str(error)) from error

    def tell(self, hub: Hub) -> None:
        """See `Contents`: there is nothing else."""


def _describe(column: str, unit: str, *, is_bit: bool) -> dict[str, Any]:
    place = Place.of(column)
    slave, _, entry = column.partition("/")
    address = address_text(*place.address) if place else entry
    return {
        "name": f"{place.slave}/{address}" if place else column,
        "label": f"{place.slave}/{place.label}" if place else column,
        "path": column,
        "slave": int(slave) if slave.isdigit() else -1,
        "address": address,
        "output": False,
        "type": "float64",
        "bits": 1 if is_bit else 64,
        "scale": 1.0,
        "offset": 0.0,
        "unit": unit,
        "minimum": None,
        "maximum": None,
        "values": {},
    }

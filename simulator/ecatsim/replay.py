"""Replays a recording of `ecatctl record --raw`, or an incident, into the inputs of a rig."""

from __future__ import annotations

import bisect
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from ecatd.base.errors import ConfigError, UsageError
from ecatd.base.incident_file import CYCLE, IncidentFile
from ecatd.base.mcap_file import DamagedError
from ecatd.base.recording_file import UTC, Place, recorded_rows
from ecatd.etg.datatypes import is_real, value_range
from ecatd.etg.pdo import Entry

from .rig import Rig
from .slave.device import Device

_TIME, _FIRST = 0, 2
Value = int | float


class _Track:
    """The values of one input, with the entry that gets them."""

    def __init__(self, key: tuple[int, int], column: int, entry: Entry) -> None:
        self.key = key
        self.column = column
        self.values: list[Value | None] = []
        self._is_real = is_real(entry.data_type)
        self._range = value_range(entry.data_type, entry.bit_length)

    def value(self, cell: str | Value | None) -> Value | None:
        """Returns the value in a cell, None if the cell is empty.

        Raises:
            ValueError: The input cannot have this value.
        """
        if cell is None or cell == "":
            return None
        if self._is_real:
            return float(cell)
        whole = int(cell)
        low, high = self._range
        if not low <= whole <= high:
            raise ValueError
        return whole


class Replay:
    """Gives the inputs of a rig the values of a recording.

    The recording starts when a slave gives its inputs for the first time. A value stays until the
    next one is due; after the last row, the last values stay.

    Args:
        path: A file that `ecatctl record --raw` or the flight recorder has written.
        rig: A rig with the slaves that were recorded.
        repeat: Whether to start again after the last row.

    Attributes:
        damage: What of the file could not be read; empty if it is whole.
        left_out: The columns that are no inputs of the rig, such as outputs, which a master writes.

    Raises:
        UsageError: The file cannot be read.
        StateError: The library for files of this kind is missing.
        ConfigError: The file is not such a recording, or is a recording of other slaves.
    """

    def __init__(self, path: Path, rig: Rig, *, repeat: bool = False) -> None:
        self.left_out: list[str] = []
        self.damage = ""
        self._repeat = repeat
        self._times: list[float] = []
        self._began: float | None = None
        tracks: defaultdict[int, list[_Track]] = defaultdict(list)
        for slave, track in self._read(path, rig):
            tracks[slave].append(track)
        for slave, mine in tracks.items():
            self._attach(rig.devices[slave], mine)

    def _read(self, path: Path, rig: Rig) -> Iterator[tuple[int, _Track]]:
        try:
            rows = _rows(path, self._tell)
            tracks = [*self._tracks(path, next(rows, []), rig)]
            for number, row in enumerate(rows, 2):
                self._add(path, number, row, [track for _, track in tracks])
        except OSError as error:
            raise UsageError(f"cannot read '{path}': {error.strerror}") from error
        if not self._times:
            raise ConfigError(f"{path}: there are no values in it")
        return iter(tracks)

    def _tell(self, damage: str) -> None:
        self.damage = damage

    def _tracks(self, path: Path, head: Sequence[str], rig: Rig) -> Iterator[tuple[int, _Track]]:
        if [*head[:_FIRST]] != ["time_s", "cycle"]:
            raise ConfigError(f"{path}:1: this is not a recording of `ecatctl record`")
        known = 0
        for column, title in enumerate(head[_FIRST:], _FIRST):
            if title == UTC:  # the wall clock says nothing about inputs
                continue
            place = Place.of(title)
            if place is None:
                raise ConfigError(
                    f"{path}:1: '{title}' has no address: record with `ecatctl record --raw`"
                )
            slave, _, key = place
            if slave >= len(rig.devices):
                raise ConfigError(
                    f"{path}:1: '{title}' is of slave {slave}, but rig {rig.name} has {rig.size}"
                )
            device = rig.devices[slave]
            if key[0] not in device.dictionary:
                raise ConfigError(f"{path}:1: slave {slave} ({device.order}) has no '{title}'")
            entries = (entry for pdo in device.tx_pdos for entry in pdo.entries)
            found = next((e for e in entries if key == (e.index, e.subindex)), None)
            if found is None:
                self.left_out.append(title)
            else:
                known += 1
                yield slave, _Track(key, column, found)
        if not known:
            raise ConfigError(f"{path}:1: no column is an input of rig {rig.name}")

    def _add(self, path: Path, number: int, row: Sequence[Any], tracks: list[_Track]) -> None:
        try:
            at = float(row[_TIME])
            cells = [row[track.column] for track in tracks]
            values = [track.value(cell) for track, cell in zip(tracks, cells, strict=True)]
        except (TypeError, ValueError, IndexError):
            text = f"{path}:{number}: a time and {len(tracks)} values of the inputs are needed"
            raise ConfigError(text) from None
        if self._times and at <= self._times[-1]:
            raise ConfigError(f"{path}:{number}: times must ascend")
        self._times.append(at)
        for track, value in zip(tracks, values, strict=True):
            before = track.values[-1] if track.values else None
            track.values.append(before if value is None else value)

    def _attach(self, device: Device, tracks: list[_Track]) -> None:
        give = device.give

        def recorded() -> bytes:
            row = self._row()
            for track in tracks:
                value = track.values[row]
                if value is not None:
                    device.dictionary.mapped(*track.key).value = value
            return give()

        vars(device).update(give=recorded, rests=lambda: False)

    def _row(self) -> int:
        """Returns the number of the row for the present time."""
        now = time.monotonic()
        if self._began is None:
            self._began = now
        at = now - self._began + self._times[0]
        whole = self._times[-1] - self._times[0]
        if self._repeat and whole > 0:
            period = whole + whole / (len(self._times) - 1)
            at = self._times[0] + (now - self._began) % period
        return max(0, bisect.bisect_right(self._times, at) - 1)


def _rows(path: Path, tell: Callable[[str], None]) -> Iterator[Sequence[Any]]:
    """Yields the head and then the rows of a recording or an incident."""
    if path.suffix.lower() == ".mcap":
        try:
            incident = IncidentFile(path)
        except (ImportError, ValueError):
            pass  # what is wrong with it is said when it is read as a recording
        else:
            try:
                yield from _incident(incident)
            except DamagedError as error:
                tell(str(error))
            except ValueError as error:
                raise ConfigError(str(error)) from error
            return
    yield from recorded_rows(path, tell)


def _incident(incident: IncidentFile) -> Iterator[Sequence[Any]]:
    """The raw values of an incident."""
    signals = incident.signals
    yield ["time_s", "cycle", *(f"{item['name']} ({item['address']})" for item in signals)]
    begin: int | None = None
    for time_ns, values in incident.cycles():
        begin = time_ns if begin is None else begin
        cells = (values[signal["raw"]] for signal in signals)
        yield [1e-9 * (time_ns - begin), values[CYCLE], *cells]

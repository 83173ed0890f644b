"""Incidents and recordings as tables: CSV, which FMPy reads as inputs of an FMU, and for Modelica.

All tables have the same columns: the time, the number of the cycle, for each slave whether it took
part, and the values. A value that is missing in a cycle is held. Where cycles are missing, the
first of them has a row, and so has the end: values are held there, and are not valid. In CSV, the
last column is the Unix time.

`path_table` is for people and scripts instead: the columns are those of `ecatctl record`, and what
is missing is empty.
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from fnmatch import fnmatchcase
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ecatd.base.addresses import parse_address
from ecatd.base.errors import StateError, UsageError
from ecatd.base.incident_file import CYCLE
from ecatd.base.mcap_file import DamagedError
from ecatd.base.recording_file import NUMBER, TIME, cell_text, column_title, iso_utc, recorded_rows
from ecatd.base.recording_file import UTC as WALL_CLOCK
from ecatd.description.bus import Bus
from ecatd.description.bus_reader import read_bus
from ecatd.operations.incident_files import read_head
from ecatgen.recorded import (
    RecordedBlock,
    RecordedEntry,
    Variable,
    cycle_variable,
    modelica_names,
    render_block,
    valid_variable,
    variables,
)

if TYPE_CHECKING:
    from ecatd.base.incident_file import IncidentFile

TABLE = "recording"
"""Name of the table in a file for Modelica."""
UNIX_TIME = "unix_s"
"""The last column of CSV for FMUs: Unix time in seconds."""
_NAME = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*", re.ASCII)
_TITLE = re.compile(
    r"(?P<path>(?P<slave>\d+)/.*?)( \((?P<address>0x\w+:\w+)\))?( \[(?P<unit>.*)\])?"
)
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_WRAP = 1 << 31
_DEFAULT_CYCLE_S = 0.001


@dataclass(frozen=True, slots=True)
class _Cycle:
    seconds: float  # since the first one
    number: int
    values: Sequence[float | None]


@dataclass(slots=True)
class _Source:
    """What a file has.

    Attributes:
        what: What it is, and of which bus.
        entries: The entries, each with the name of its slave.
        bus: The bus; None if it is not known.
        cycles: Its cycles.
        cycle_time: Seconds from one cycle to the next.
        begin_ns: Unix time of the first cycle, or None.
        trigger: Unix time of what has begun it, or None.
        reason: Why it was recorded, or empty.
        notes: What could not be read.
    """

    what: str
    entries: list[RecordedEntry]
    bus: Bus | None
    cycles: list[_Cycle]
    cycle_time: float
    begin_ns: int | None = None
    trigger: float | None = None
    reason: str = ""
    notes: list[str] = field(default_factory=list)


@dataclass(slots=True)
class Table:
    """A table of recorded values.

    Attributes:
        title: What it is about.
        columns: What stands in each column behind the time.
        rows: Its rows: first the seconds since the first cycle.
        source: The file that it was made from.
        missing: How many cycles in between are missing.
        places: Where the values are in the cycles of the source.
    """

    title: str
    columns: list[Variable]
    rows: list[list[float]]
    source: _Source
    missing: int
    places: list[int]


def incident_table(found: IncidentFile, wanted: Sequence[str]) -> Table:
    """The table of an incident.

    Args:
        found: The incident.
        wanted: Which values, each as SIGNAL or NAME=SIGNAL; all if there are none.

    Raises:
        UsageError: A signal is not in it.
        OSError: The file cannot be read.
        ValueError: It is damaged.
    """
    facts = read_head(found.path)
    notes, bus = [], None
    try:
        bus = read_bus(json.loads(found.attachment("bus.json")), "bus.json", strict=False)
    except (RecursionError, UsageError, ValueError) as error:
        notes.append(f"names come from the numbers of slaves, since its bus is unknown: {error}")
    times, cycles = [], []
    fields = [item["field"] for item in found.signals]
    try:
        for time_ns, values in found.cycles():
            times.append(time_ns)
            seconds, number = (time_ns - times[0]) / 1e9, values[CYCLE]
            if number is None:
                raise ValueError(f"{found.path} is damaged: a cycle has no number")
            cycles.append(_Cycle(seconds, int(number), [values[name] for name in fields]))
    except DamagedError as error:
        if not cycles:
            raise
        notes.append(str(error))
    return _table(
        _Source(
            what=f"Incident of bus {found.bus}",
            entries=[_entry_of(item) for item in found.signals],
            bus=bus,
            cycles=cycles,
            cycle_time=bus.cycle_time_us / 1e6 if bus else _cycle_time(cycles),
            begin_ns=times[0] if times else None,
            trigger=int(facts["time_ns"]) / 1e9,
            reason=facts["reason"],
            notes=notes,
        ),
        wanted,
    )


def _entry_of(item: dict[str, Any]) -> RecordedEntry:
    index, subindex = parse_address(item["address"]) or (0, 0)
    meaning = {key: item[key] for key in ("slave", "output", "unit", "scale", "offset")}
    return RecordedEntry(item["name"], index=index, subindex=subindex, **meaning)


def recording_table(path: Path, wanted: Sequence[str]) -> Table:
    """The table of a file of `ecatctl record`; arguments and errors as `incident_table`.

    Raises:
        ConfigError: It is no recording.
    """
    notes: list[str] = []
    rows = recorded_rows(path, notes.append)
    head = [str(title) for title in next(rows, [])]
    if head[:2] != [TIME, NUMBER]:
        raise UsageError(f"{path} is neither an incident nor a recording of `ecatctl record`")
    columns = [(place, m) for place, t in enumerate(head) if (m := _TITLE.fullmatch(t))]
    entries = []
    for _, match in columns:
        index, subindex = parse_address(match["address"] or "") or (0, 0)
        slave, unit = int(match["slave"]), match["unit"] or ""
        entries.append(
            RecordedEntry(match["path"], slave, index=index, subindex=subindex, unit=unit)
        )
    cycles: list[_Cycle] = []
    begin_ns = None
    for number, row in enumerate(rows, 2):
        try:
            if begin_ns is None and head[-1] == WALL_CLOCK:
                since = datetime.fromisoformat(str(row[-1])) - _EPOCH
                begin_ns = since // timedelta(microseconds=1) * 1000
            values = [_number(row[place]) for place, _ in columns]
            cycles.append(_Cycle(float(row[0]), int(row[1]), values))
        except (IndexError, TypeError, ValueError):
            raise UsageError(f"{path}:{number}: this row is damaged") from None
    what = "Recording of `ecatctl record`"
    source = _Source(what, entries, None, cycles, _cycle_time(cycles), begin_ns, notes=notes)
    return _table(source, wanted)


def _number(cell: Any) -> float | None:
    """The value of a cell; whole numbers stay exact.

    Raises:
        ValueError: It is no number.
    """
    if cell is None or cell == "":
        return None
    try:
        return int(cell) if isinstance(cell, str | int) else float(cell)
    except ValueError:
        return float(cell)


def _cycle_time(cycles: Sequence[_Cycle]) -> float:
    count = cycles[-1].number - cycles[0].number if cycles else 0
    return round(cycles[-1].seconds / count, 9) if count > 0 else _DEFAULT_CYCLE_S


def _table(source: _Source, wanted: Sequence[str]) -> Table:
    if not source.cycles:
        raise StateError("there are no cycles in it, so it makes no table")
    chosen = list(_chosen(source, wanted))
    slaves: dict[int, str] = {}  # the instance of each slave, in the order of the bus
    for place, variable in chosen:
        slaves.setdefault(source.entries[place].slave, variable.instance)
    columns = [cycle_variable()]
    columns += [valid_variable(instance, slave) for slave, instance in slaves.items()]
    columns += [variable for _, variable in chosen]
    names = [item.fmi_name for item in columns]
    if twice := {name for name in names if names.count(name) > 1}:
        raise UsageError(f"'{min(twice)}' would be the name of two columns: choose another one")
    begin = ""
    if source.begin_ns is not None:
        begin = f"{datetime.fromtimestamp(source.begin_ns / 1e9, UTC):, %Y-%m-%d %H:%M:%S.%f} UTC"
    places = [place for place, _ in chosen]
    table = Table(f"{source.what}{begin}", columns, [], source, 0, places)
    groups = [
        [n for n, place in enumerate(places) if source.entries[place].slave == slave]
        for slave in slaves
    ]
    _fill(table, places, groups)
    return table


def _fill(table: Table, places: Sequence[int], groups: Sequence[Sequence[int]]) -> None:
    """Makes the rows.

    Args:
        table: The table.
        places: Places of the values in each cycle.
        groups: For each slave the numbers of its values.
    """
    cycles = table.source.cycles
    step = min((b.number - a.number for a, b in pairwise(cycles)), default=1)
    held: list[float] = [0] * len(places)
    invalid = [0] * len(groups)
    before = cycles[0]
    for cycle in cycles:
        if cycle.number > before.number + step:
            table.missing += (cycle.number - before.number) // step - 1
            at = before.seconds + step * table.source.cycle_time
            if at < cycle.seconds:
                table.rows.append([at, (before.number + step) % _WRAP, *invalid, *held])
        values = [cycle.values[place] for place in places]
        is_there = [value is not None and math.isfinite(value) for value in values]
        held = [
            old if new is None or not there else new
            for old, new, there in zip(held, values, is_there, strict=True)
        ]
        valid = [int(all(is_there[n] for n in group)) for group in groups]
        table.rows.append([cycle.seconds, cycle.number % _WRAP, *valid, *held])
        before = cycle
    end = before.seconds + step * table.source.cycle_time
    table.rows.append([end, (before.number + step) % _WRAP, *invalid, *held])


def _chosen(source: _Source, wanted: Sequence[str]) -> Iterator[tuple[int, Variable]]:
    """Yields the places of the entries that somebody wants, and their variables."""
    found = variables(source.entries, source.bus)
    if not wanted:
        yield from enumerate(found)
        return
    for text in wanted:
        name, equals, pattern = text.partition("=")
        if not equals or not _NAME.fullmatch(name):
            name, pattern = "", text
        fitting = [
            place
            for place, entry in enumerate(source.entries)
            if any(
                own.lower() == pattern.lower() or fnmatchcase(own.lower(), pattern.lower())
                for own in _names(entry, found[place], source.bus)
            )
        ]
        if not fitting:
            raise UsageError(f"no signal fits '{pattern}': export it without --signal to see all")
        if name and len(fitting) > 1:
            paths = ", ".join(source.entries[place].path for place in fitting[:3])
            raise UsageError(
                f"'{pattern}' fits {len(fitting)} signals ({paths} …), but {name} can be one only"
            )
        for place in fitting:
            yield place, replace(found[place], name=name)


def _names(entry: RecordedEntry, variable: Variable, bus: Bus | None) -> Iterable[str]:
    """The names by which somebody may want an entry."""
    who, _, what = entry.path.partition("/")
    yield variable.fmi_name
    slaves = [who]
    if bus is not None and entry.slave < len(bus.slaves):
        slave = bus.slaves[entry.slave]
        slaves += [slave.given_name, slave.name]
    for name in filter(None, slaves):
        yield f"{name}/{what}"
        yield f"{name}/0x{entry.index:04X}:{entry.subindex:02X}"


def csv_table(table: Table) -> str:
    """CSV with the column `time`; the others have the names of variables of the bus's FMU.

    `fmpy simulate --input-file` reads it, and `fmpy.util.read_csv`: both take numbers only, so the
    time of day is one.
    """
    begin_ns = table.source.begin_ns
    heads = ["time", *(item.fmi_name for item in table.columns)]
    if begin_ns is None:
        return _csv([heads, *table.rows])
    rows = ([*row, f"{begin_ns / 1e9 + row[0]:.6f}"] for row in table.rows)
    return _csv([[*heads, UNIX_TIME], *rows])


def path_table(table: Table) -> str:
    """CSV with the columns of `ecatctl record`, and of the page: each value has its path."""
    source, places = table.source, table.places
    entries = [source.entries[place] for place in places]
    heads = [TIME, NUMBER, *(column_title(item.path, item.unit) for item in entries)]
    begin_ns = source.begin_ns
    if begin_ns is not None:
        heads.append(WALL_CLOCK)

    def row(cycle: _Cycle) -> list[object]:
        cells = [cell_text(cycle.values[place]) for place in places]
        when = [] if begin_ns is None else [iso_utc(begin_ns + round(1e9 * cycle.seconds))]
        return [f"{cycle.seconds:.6f}", cycle.number, *cells, *when]

    return _csv([heads, *map(row, source.cycles)])


def _csv(rows: Iterable[Sequence[object]]) -> str:
    text = io.StringIO(newline="")
    csv.writer(text).writerows(rows)
    return text.getvalue()


def combi_time_table(table: Table) -> str:
    """A file for `Modelica.Blocks.Sources.CombiTimeTable`, with the table `recording`."""
    lines = ["#1", f"# {table.title}", "# column 1: time in s, since the first cycle"]
    for number, item in enumerate(table.columns, 2):
        unit = f" in {item.unit}" if item.unit else ""
        text = f"# column {number}: {item.fmi_name}{unit}: {item.description}"
        lines.append(" ".join(text.split()))
    lines.append(f"double {TABLE}({len(table.rows)},{len(table.columns) + 1})")
    lines += [" ".join(map(repr, row)) for row in table.rows]
    return "\n".join(lines) + "\n"


def modelica_block(table: Table, path: Path) -> str:
    """A Modelica file with a block around the table, which is in a file beside it.

    Args:
        table: The table.
        path: Where the Modelica file will be; the block has its name.

    Raises:
        UsageError: A block or a connector cannot have the name.
    """
    source = table.source
    for item in table.columns:
        if "." in item.name or (item.name and item.name not in modelica_names([item])):
            raise UsageError(f"'{item.name}' cannot be the name of a connector: choose another one")
    trigger = None
    if source.trigger is not None and source.begin_ns is not None:
        trigger = round(source.trigger - source.begin_ns / 1e9, 6)
    return render_block(
        RecordedBlock(
            name=path.stem,
            table=path.with_suffix(".txt").name,
            table_name=TABLE,
            variables=table.columns,
            title=table.title,
            reason=source.reason,
            cycle_time=source.cycle_time,
            duration=table.rows[-1][0],
            trigger=trigger,
            cycles=len(source.cycles),
            missing=table.missing,
        )
    )

"""Incidents as tables: CSV, which FMPy reads as inputs of an FMU too, and for CombiTimeTable."""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ecatd.base.incident_file import IncidentFile

Number = float | int | None


def _rows(found: IncidentFile) -> tuple[list[str], list[list[Number]]]:
    """Names of the fields, and for each cycle the seconds since the first one and the values."""
    rows: list[list[Number]] = []
    names = [signal["field"] for signal in found.signals]
    begin: int | None = None
    for time_ns, values in found.cycles():
        begin = time_ns if begin is None else begin
        rows.append([(time_ns - begin) / 1e9, *(values[name] for name in names)])
    return names, rows


def csv_table(found: IncidentFile) -> str:
    """Physical values of each cycle; `nan` if its slave did not take part.

    The first column is `time`, in seconds since the first cycle, and each other column has the name
    of a field, an identifier. `fmpy.util.read_csv` makes of it what `simulate_fmu(input=…)` takes.
    """
    names, rows = _rows(found)
    text = io.StringIO(newline="")
    lines = csv.writer(text)
    lines.writerow(["time", *names])
    lines.writerows(["nan" if cell is None else cell for cell in row] for row in rows)
    return text.getvalue()


def combi_time_table(found: IncidentFile) -> str:
    """A file for `Modelica.Blocks.Sources.CombiTimeTable`, with the table `incident`.

    An entry that is missing in a cycle has its value of the cycle before, and 0 before the first.
    """
    names, rows = _rows(found)
    lines = ["#1", f"# incident of bus {found.bus}: column 1 is the time in s"]
    for number, signal in enumerate(found.signals, 2):
        unit = signal["unit"] or "1"
        what = "output" if signal["output"] else "input"
        text = " ".join(f"{signal['name']} ({signal['address']}), {what}".split())
        lines.append(f"# column {number}: {names[number - 2]} in {unit}: {text}")
    lines.append(f"double incident({len(rows)},{len(names) + 1})")
    before: list[Number] = [0.0] * (len(names) + 1)
    for row in rows:
        before = [old if new is None else new for old, new in zip(before, row, strict=True)]
        lines.append(" ".join(repr(cell) for cell in before))
    return "\n".join(lines) + "\n"

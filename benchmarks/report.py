"""Writes performance.md and its plots from the JSON of the benchmarks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ecatd.model.errors import UsageError

from .client import report as client_report
from .cores import report as cores_report
from .engine import report as engine_report
from .modelica import report as modelica_report
from .requests import report as requests_report
from .scale import report as scale_report
from .simulator import report as simulator_report

SECTIONS: dict[str, Any] = {
    "simulator": simulator_report,
    "engine": engine_report,
    "cores": cores_report,
    "scale": scale_report,
    "requests": requests_report,
    "client": client_report,
    "modelica": modelica_report,
}
"""Reports by the name of the benchmark, in the order of the page."""

_HEAD = """\
# Performance

`make bench` measures for a quarter of an hour, `make bench-full` more, for over an hour. Both need
gcc and g++ and leave such a page and its results in `bench/`, or where `OUT=docs` says; the last
line of each section names the one that wrote it. They need no root, but an ordinary user gets no
real-time priority, and then the load of the machine shows in the numbers, and no frames are
answered in the kernel. Compare ratios, not times: both sides of a ratio are measured in one run,
in turns. A target that assumes more cores than a machine has, and is not met, says so. So does one
that counts lost frames or missed cycles where the processors themselves stood still at least as
often: the host of a virtual machine takes them away whenever it likes.
"""

_COMMANDS = {
    "quick": "`python -m benchmarks --quick` (a trial of seconds)",
    "normal": "`make bench` (a quarter of an hour for all sections)",
    "full": "`make bench-full` (over an hour for all sections)",
}
"""By the extent of a result."""


def page(results: dict[str, dict[str, Any]]) -> str:
    """The page, from results by the name of the benchmark."""
    parts = [_HEAD]
    for name, module in SECTIONS.items():
        if name in results:
            parts += [module.section(results[name]), _origin(results[name]) + "\n"]
    return "\n".join(parts)


def _origin(result: dict[str, Any]) -> str:
    """How the results above it were found, and on what."""
    machine = result["machine"]
    kind = "virtual machine" if machine["virtual"] else "machine"
    rights = "as root" if machine["root"] else "as an ordinary user"
    again = result.get("again")  # a part that was measured later, written in by hand
    return (
        f"\nMeasured by {_COMMANDS[result['extent']]} on {machine['date']} {rights}, "
        f"revision {machine['revision']}, on a {kind} with {machine['cores']} cores "
        f"({machine['processor']}, governor {machine['governor']}), "
        f"Linux {machine['kernel']}, Python {machine['python']}, "
        f"load before the run {machine['load']}."
        + _interruptions(machine.get("interruptions"))
        + (f" {again['what']}: again on {again['date']}, {again['revision']}." if again else "")
    )


def _interruptions(found: dict[str, Any] | None) -> str:
    """How steady the machine is."""
    if found is None:
        return ""
    who = "the highest priority" if found["real_time"] else "ordinary priority"
    return (
        f" A loop of {who} that never sleeps stood still on each of these processors "
        f"{found['rate']:g} times a second for longer than {found['longer_than_us']:g} µs, "
        f"{found['longest_us'] / 1000:.1f} ms at most."
    )


def load(folder: Path) -> dict[str, dict[str, Any]]:
    """The results in a folder."""
    return {
        name: json.loads(file.read_text())
        for name in SECTIONS
        if (file := folder / f"{name}.json").exists()
    }


def write(out: Path) -> str:
    """Writes the page and the plots to a folder; returns what to tell the user.

    Raises:
        UsageError: There are no results.
    """
    folder = out / "performance"
    results = load(folder)
    if not results:
        raise UsageError(f"there are no results in '{folder}': run without --report-only")
    for name, result in results.items():
        SECTIONS[name].plot(result, folder / f"{name}.svg")
    (out / "performance.md").write_text(page(results))
    return "\n\n".join(SECTIONS[name].section(result) for name, result in results.items())

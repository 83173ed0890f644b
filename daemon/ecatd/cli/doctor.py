"""Command `doctor`: finds what makes a bus slow, late or unreachable on this machine."""

from __future__ import annotations

import argparse
import platform
import socket
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

from ecatd.admin.doctor.findings import Finding, Level
from ecatd.admin.doctor.interface import look_at
from ecatd.admin.doctor.processors import look_at_processors
from ecatd.admin.doctor.rights import look_at_rights, service_group
from ecatd.admin.doctor.service import look_at_service
from ecatd.admin.doctor.settings import mend, undo
from ecatd.admin.doctor.software import (
    look_at_configuration,
    look_at_recorder,
    look_at_settings,
    look_at_shared_memory,
    look_at_versions,
)
from ecatd.admin.doctor.wakeup import Wakeups, measure
from ecatd.base.errors import EcatError, UsageError
from ecatd.base.paths import MACHINE
from ecatd.config import Config
from ecatd.operations.bus import ReadInfo
from ecatd.shm.statistics import Snapshot

from .arguments import seconds
from .bus_source import use_bus_of
from .output import print_json, table_lines
from .saving import add_out, save
from .source import Source

COMMANDS = {
    "machine": {"doctor": "Find what makes a bus slow, late or unreachable on this machine."}
}

_QUANTILES = {"median": 0.5, "p99": 0.99, "p9999": 0.9999}
_WINDOW_S = 2.0


@dataclass(slots=True)
class _Report:
    """What is printed, and written into the report."""

    findings: list[Finding]
    done: list[str] = field(default_factory=list)
    wakeups: list[Wakeups] = field(default_factory=list)

    @property
    def problems(self) -> int:
        return sum(item.level == Level.PROBLEM for item in self.findings)


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments of the command."""
    command.add_argument(
        "--config",
        type=Path,
        metavar="FILE",
        help="check the interface and the CPU of this configuration (default: /etc/ecatd/BUS.toml)",
    )
    command.add_argument("--interface", metavar="IF", help="check this interface instead")
    command.add_argument(
        "--latency",
        type=seconds,
        metavar="SECONDS",
        help="also measure for SECONDS how late the engine would wake up; all processors are "
        "busy for half of that time",
    )
    changes = command.add_mutually_exclusive_group()
    changes.add_argument(
        "--fix",
        action="store_true",
        help="apply the fixes that can be undone; they last until the next boot",
    )
    changes.add_argument("--undo", action="store_true", help="undo what --fix has changed")
    add_out(command, "also write a report that you can send to others")


def doctor(options: argparse.Namespace) -> int:
    """Checks, measures and changes settings; returns 1 if there is a problem, else 0."""
    file = options.config or MACHINE / f"{options.bus}.toml"
    about, config = look_at_configuration(file)
    if options.config is not None and not file.exists():
        raise UsageError(f"there is no file {file}")
    if options.config is not None and config is not None:
        use_bus_of(options, config)
    report = _Report([])
    if options.undo:
        report.done = list(_measured(options, undo()))
    report.findings = [about, *_look(options, config)]
    if options.fix:
        changes = [item.change for item in report.findings if item.change is not None]
        report.done = list(_measured(options, mend(changes))) if changes else []
        report.findings = [about, *_look(options, config)]
    if options.latency is not None:
        report.wakeups = _latency(options, config)
    lines = list(_lines(report, options))
    if options.json:
        print_json(_document(report))
    else:
        print("\n".join(lines))
    if options.out is not None:
        _write(options.out, lines)
    return 1 if report.problems else 0


def _look(options: argparse.Namespace, config: Config | None) -> Iterator[Finding]:
    cpu = config.realtime.cpu if config is not None else None
    cpu = None if cpu is None or cpu < 0 else cpu
    names = [options.interface] if options.interface else []
    if not names and config is not None:
        names = [name for name in (config.interface, config.second_interface) if name]
    if not names:
        names = _in_use(options)
    if config is not None:
        yield from look_at_settings(config.realtime)
        yield from look_at_recorder(config.flight_recorder)
    for name in names:
        yield from look_at(name, cpu)
    if not names:
        text = "no interface was checked, because no configuration and no running bus names one"
        yield Finding(
            "interface", "name", Level.HINT, text, "name it: `ecatctl doctor --interface IF`"
        )
    yield from look_at_processors(cpu, service_group())
    yield from look_at_service(options.bus)
    yield from look_at_rights(options.bus)
    yield from look_at_shared_memory()
    yield from look_at_versions(options.bus)


def _in_use(options: argparse.Namespace) -> list[str]:
    """The interfaces of the running bus, as far as this machine has them."""
    with Source(options) as source:
        try:
            links = source.remote().request(ReadInfo())["links"] if source.local else {}
        except EcatError:
            return []
    here = {name for _, name in socket.if_nameindex()}
    return [name for name in links if name in here]


def _measured(options: argparse.Namespace, changes: Iterator[str]) -> Iterator[str]:
    """Adds the effect to each change if a bus runs here: the median time of the exchange."""
    before = _exchange_us(options)
    for text in changes:
        after = _exchange_us(options)
        if before is None or after is None:
            yield text
        else:
            yield f"{text}; the exchange took {before:.1f} µs, now {after:.1f} µs"
        before = after


def _exchange_us(options: argparse.Namespace) -> float | None:
    """Measures the median of the exchange in µs for two seconds; None without a bus here."""
    with Source(options) as source:
        if not source.local:
            return None
        try:
            first = source.read()
            time.sleep(_WINDOW_S)
            interval: Snapshot = source.read() - first
        except EcatError:
            return None
        exchange = interval.times["exchange"]
        return exchange.quantile(0.5) / 1e3 if exchange.count else None


def _latency(options: argparse.Namespace, config: Config | None) -> list[Wakeups]:
    config = config or Config()
    cpu = config.realtime.cpu if config.realtime.cpu >= 0 else None
    half = options.latency / 2
    if not options.json:
        print(f"Measuring for {options.latency:g} s how late the engine wakes up ...", flush=True)
    return [measure(half, config.realtime.priority, cpu, load=load) for load in (False, True)]


def _lines(report: _Report, options: argparse.Namespace) -> Iterator[str]:
    area = ""
    for item in report.findings:
        if item.area != area:
            yield from ([""] if area else [])
            yield item.area
            area = item.area
        yield f"  {item.level:<8} {item.name}: {item.text}"
        if item.remedy:
            fixed = "; `ecatctl doctor --fix` does that" if item.change is not None else ""
            yield f"           {item.remedy}{fixed}"
        if item.cost:
            yield f"           {item.cost}"
    if report.wakeups:
        yield ""
        yield "how late the engine wakes up, in µs"
        head = ["  processors", "real time", "median", "99 %", "99.99 %", "largest", "samples"]
        yield from table_lines(head, map(_row, report.wakeups), "<<>>>>>")
    if report.done:
        yield ""
        yield from report.done
        if options.fix:
            yield "`ecatctl doctor --undo` changes that back, and so does the next boot"
    elif options.fix or options.undo:
        yield ""
        yield "nothing to change"
    yield ""
    hints = sum(item.level == Level.HINT for item in report.findings)
    yield f"{_count(report.problems, 'problem')}, {_count(hints, 'hint')}"


def _count(number: int, what: str) -> str:
    return f"{number or 'no'} {what}{'' if number == 1 else 's'}"


def _row(wakeups: Wakeups) -> list[str]:
    late = wakeups.late
    times = [late.quantile(q) for q in _QUANTILES.values()] + [late.max_ns]
    return [
        "  busy" if wakeups.load else "  idle",
        "yes" if wakeups.real_time else "no",
        *(f"{ns / 1e3:.1f}" for ns in times),
        str(late.count),
    ]


def _document(report: _Report) -> dict[str, object]:
    findings = []
    for item in report.findings:
        row = asdict(item)
        change = row.pop("change")
        findings.append({**row, "fixable": change is not None})
    wakeups = []
    for measured in report.wakeups:
        late = measured.late
        times = {name: late.quantile(q) for name, q in _QUANTILES.items()}
        wakeups.append(
            {
                "load": measured.load,
                "real_time": measured.real_time,
                "samples": late.count,
                **{f"{name}_ns": ns for name, ns in times.items()},
                "max_ns": late.max_ns,
            }
        )
    return {
        "problems": report.problems,
        "findings": findings,
        "changes": report.done,
        "wakeups": wakeups,
    }


def _write(file: Path, lines: list[str]) -> None:
    head = [f"ecatctl doctor, {time.strftime('%Y-%m-%d %H:%M')}", platform.platform(), ""]
    save(file, "\n".join([*head, *lines, ""]))

"""Commands `read`, `write` and `record`: values of the process image, by names."""

from __future__ import annotations

import argparse
import csv
import signal as signals
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ecatd.model.errors import NotPermittedError, StateError, UsageError

from .arguments import add_watch, seconds, times
from .confirm import add_yes, confirm
from .output import print_json, table_lines
from .watch import present

if TYPE_CHECKING:
    from ecatd.client import Client
    from ecatd.client.signals import Signal

_GLOB = set("*?[")
_LEASE = 1.0
"""Seconds after which outputs are safe if this command hangs or is killed."""
_BEAT = 0.1
"""Seconds between two signs of life."""
_PATIENCE = 5.0


def add_arguments(command: argparse.ArgumentParser, name: str) -> None:
    """Adds the arguments of a command."""
    command.set_defaults(alone={"read": read, "write": write, "record": record}[name])
    if name == "write":
        command.add_argument(
            "values",
            nargs="+",
            metavar="NAME=VALUE",
            help="an output, as 'drive/Target velocity', and its value in its unit",
        )
        command.add_argument("--raw", action="store_true", help="values are raw, without unit")
        _add_for(command, "give the outputs back after so many seconds (default: with Ctrl-C)")
        add_yes(command)
        return
    command.add_argument(
        "patterns",
        nargs="*",
        metavar="PATTERN",
        help="SLAVE/ENTRY with * and ?, as 'drive/*', '*/Status*' or '4/0x6000:11' (default: all)",
    )
    if name == "read":
        add_watch(command)
        return
    command.add_argument(
        "-o", dest="out", metavar="FILE", type=Path, required=True, help="a file that ends in .csv"
    )
    command.add_argument(
        "--every", type=times, default=1, metavar="N", help="only each Nth cycle (default: 1)"
    )
    _add_for(command, "end after so many seconds (default: with Ctrl-C)")


def _add_for(command: argparse.ArgumentParser, text: str) -> None:
    command.add_argument("--for", dest="seconds", type=seconds, metavar="S", help=text)


@contextmanager
def _client(options: argparse.Namespace) -> Iterator[Client]:
    """A client of the shared memory, which has an image.

    Raises:
        UsageError: `--connect` is given.
        EcatError: No daemon serves the bus here.
    """
    if options.connect is not None:
        raise UsageError(
            "values are in shared memory, on the machine of the daemon: leave --connect out, or "
            "run the command there"
        )
    from ecatd.client import Client

    with Client(options.bus) as client:
        client.sample()
        yield client


def _find(client: Client, patterns: Sequence[str]) -> list[Signal]:
    """The entries that fit one of the patterns, in the order of the bus; all if there are none.

    Raises:
        StateError: A pattern fits nothing.
    """
    if not patterns:
        return client.signals()
    names = {slave.position: slave.name for slave in client.slaves()}
    found: dict[int, Signal] = {}
    for pattern in patterns:
        if not _GLOB & set(pattern) and "/" in pattern:
            fitting = [client.signal(pattern)]
        else:
            wanted = (pattern if "/" in pattern else f"*/{pattern}").lower()
            fitting = [
                signal
                for signal in client.signals()
                if any(fnmatchcase(name, wanted) for name in _names(signal, names[signal.slave]))
            ]
        if not fitting:
            raise StateError(
                f"no entry fits '{pattern}': `ecatctl read` lists all of them with their names"
            )
        found |= {signal.number: signal for signal in fitting}
    return [found[number] for number in sorted(found)]


def _names(signal: Signal, slave: str) -> Iterator[str]:
    """All names of an entry, in small letters."""
    for who in (str(signal.slave), slave):
        for entry in (signal.name, f"{signal.pdo_name}/{signal.name}", signal.address):
            yield f"{who}/{entry}".lower()


# --- read ----------------------------------------------------------------------------------------


def read(options: argparse.Namespace) -> None:
    """Shows values once, or with `--watch` again and again."""
    with _client(options) as client:
        chosen = _find(client, options.patterns)
        names = {slave.position: slave.name for slave in client.slaves()}

        def take() -> dict[str, Any]:
            client.sample()
            return {
                "bus": client.name,
                "cycle": max(client.domain(signal.domain).cycle for signal in chosen),
                "values": [_row(signal, names[signal.slave]) for signal in chosen],
            }

        present(options, take, _lines)


def _row(signal: Signal, slave: str) -> dict[str, Any]:
    return {
        "slave": signal.slave,
        "slave_name": slave,
        "address": signal.address,
        "pdo": signal.pdo_name,
        "name": signal.name,
        "output": signal.output,
        "raw": signal.raw,
        "value": signal.value,
        "unit": signal.unit,
        "validity": signal.validity.name.lower(),
    }


def _lines(document: dict[str, Any]) -> list[str]:
    return table_lines(
        ("SLAVE", "ENTRY", "NAME", "", "VALUE", "UNIT", "RAW", ""),
        (
            (
                f"{row['slave']} {row['slave_name']}",
                row["address"],
                row["name"],
                "out" if row["output"] else "in",
                f"{row['value']:.7g}",
                row["unit"],
                f"{row['raw']:g}" if isinstance(row["raw"], float) else row["raw"],
                "" if row["validity"] == "valid" else row["validity"].replace("_", " "),
            )
            for row in document["values"]
        ),
        "    > >",
    )


# --- write ---------------------------------------------------------------------------------------


def write(options: argparse.Namespace) -> None:
    """Becomes the owner of outputs, and holds values there until it ends."""
    with _client(options) as client:
        wanted = dict(_assigned(client, text) for text in options.values)
        slaves = {client.slaves()[output.slave].name: None for output in wanted}
        texts = [f"{output.path} = {value:g}" for output, value in wanted.items()]
        about = f"This takes over {', '.join(texts)} ({', '.join(slaves)})"
        until = "Ctrl-C" if options.seconds is None else f"{options.seconds:g} s"
        confirm(options, f"{about} until {until}. Then the outputs take their safe values.")
        with _ended_by_signals(), client.claim(wanted, lease=_LEASE):
            for output, value in wanted.items():
                if options.raw:
                    output.raw = value
                else:
                    output.value = value
            client.commit()
            _hold(client, options.seconds)
        rows = [{"output": output.path, "value": value} for output, value in wanted.items()]
        if options.json:
            print_json({"bus": client.name, "written": rows})
        else:
            print("the outputs are given back, and are safe again")


def _assigned(client: Client, text: str) -> tuple[Signal, float]:
    """The output and the value of an argument.

    Raises:
        UsageError: It is none.
        StateError: There is no such entry.
    """
    from ecatd.shm import Direction

    name, equals, value = text.rpartition("=")
    try:
        number = float(int(value, 0)) if value.lower().startswith("0x") else float(value)
    except ValueError:
        equals = ""
    if not equals or not name:
        raise UsageError(
            f"'{text}' is no output with a value: write it as 'drive/Target velocity=5'"
        )
    return client.signal(name, direction=Direction.OUTPUT), number


def _hold(client: Client, duration: float | None) -> None:
    """Gives signs of life until the time is over, or somebody ends the command."""
    end = None if duration is None else time.monotonic() + duration
    try:
        while end is None or time.monotonic() < end:
            time.sleep(_BEAT if end is None else min(_BEAT, max(0.0, end - time.monotonic())))
            client.sample()
    except KeyboardInterrupt:
        return


@contextmanager
def _ended_by_signals() -> Iterator[None]:
    """Lets SIGTERM end the command as Ctrl-C does."""
    before = signals.signal(signals.SIGTERM, signals.default_int_handler)
    try:
        yield
    finally:
        signals.signal(signals.SIGTERM, before)


# --- record --------------------------------------------------------------------------------------


def record(options: argparse.Namespace) -> None:
    """Writes the values of each cycle to a CSV file, until it ends."""
    if options.out.suffix.lower() != ".csv":
        raise UsageError(f"{options.out}: give a file name that ends with .csv")
    with _client(options) as client:
        chosen = _find(client, options.patterns)
        try:
            with options.out.open("w", encoding="utf-8", newline="") as file, _ended_by_signals():
                count, left_out = _record(client, chosen, csv.writer(file), options)
        except PermissionError as error:
            raise NotPermittedError(f"{options.out} cannot be written: {error.strerror}") from error
        except OSError as error:
            raise StateError(f"{options.out} cannot be written: {error.strerror}") from error
    if options.json:
        print_json(
            {"bus": options.bus, "file": str(options.out), "cycles": count, "left_out": left_out}
        )
        return
    more = f"; {left_out} cycles were missed, because this program had no processor" * bool(
        left_out
    )
    print(f"{options.out}: {count} cycles with {len(chosen)} values{more}")


def _record(
    client: Client, chosen: list[Signal], rows: Any, options: argparse.Namespace
) -> tuple[int, int]:
    """Writes the head and the rows; returns how many, and how many cycles were missed."""
    units = {signal.number: f" [{signal.unit}]" if signal.unit else "" for signal in chosen}
    rows.writerow(["time_s", "cycle", *(f"{s.path}{units[s.number]}" for s in chosen)])
    group, step, count, left_out = client.group(chosen), client.cycle_time, 0, 0
    domains = {signal.domain for signal in chosen}
    first = last = None
    end = None if options.seconds is None else time.monotonic() + options.seconds
    try:
        while end is None or time.monotonic() < end:
            client.wait(options.every, timeout=_PATIENCE)
            client.sample()
            cycle = max(client.domain(number).cycle for number in domains)
            if first is None:
                first = cycle
            elif last is not None:
                left_out += max(0, (cycle - last) // options.every - 1)
            rows.writerow(
                [
                    f"{(cycle - first) * step:.6f}",
                    cycle,
                    *(f"{value:.9g}" for value in group.values),
                ]
            )
            last, count = cycle, count + 1
    except KeyboardInterrupt:
        pass
    return count, left_out

"""Commands `read`, `write` and `record`: values of the process image, by names."""

from __future__ import annotations

import argparse
import csv
import fcntl
import signal as signals
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from ecatd.model.al import AlState, al_state_text
from ecatd.model.errors import LeaseError, NotPermittedError, StateError, UsageError

from .arguments import add_watch, seconds, times
from .confirm import add_yes, confirm
from .output import print_json, table_lines
from .watch import present

if TYPE_CHECKING:
    from ecatd.client import Client
    from ecatd.client.group import SignalGroup
    from ecatd.client.signals import Signal

_GLOB = set("*?[")
_LEASE = 1.0
"""Seconds after which outputs are safe if this command hangs or is killed."""
_BEAT = 0.1
"""Seconds between two signs of life."""
_PATIENCE, _PERIOD_MOST = 5.0, 3600.0


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
    found: dict[int, Signal] = {}
    for pattern in patterns:
        fitting = _fitting(client, pattern if "/" in pattern else f"*/{pattern}")
        if not fitting and "/" in pattern and not _GLOB & set(pattern):
            fitting = [client.signal(pattern)]  # raises what is wrong with the name
        if not fitting:
            raise StateError(
                f"no entry fits '{pattern}': `ecatctl read` lists all of them with their names"
            )
        found |= {signal.number: signal for signal in fitting}
    return [found[number] for number in sorted(found)]


def _fitting(client: Client, pattern: str) -> list[Signal]:
    """The entries that fit a pattern; small and capital letters are the same."""
    slaves = {slave.position: slave.name for slave in client.slaves()}
    return [
        signal
        for signal in client.signals()
        if any(fnmatchcase(name, pattern.lower()) for name in _names(signal, slaves[signal.slave]))
    ]


def _output(client: Client, name: str) -> Signal:
    """The output with a name.

    Raises:
        StateError: There is none, or there are several.
    """
    from ecatd.shm import Direction

    try:
        return client.signal(name, direction=Direction.OUTPUT)
    except StateError:
        fitting = [] if _GLOB & set(name) else _fitting(client, name)
        outputs = [signal for signal in fitting if signal.output]
        if len(outputs) != 1:
            raise
        return outputs[0]


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
        wanted: dict[Signal, float] = {}
        for text in options.values:
            output, value = _assigned(client, text, raw=options.raw)
            if output in wanted:
                raise UsageError(f"{output.path} is given twice")
            wanted[output] = value
        _check_slaves(client, wanted)
        slaves = {client.slaves()[output.slave].name: None for output in wanted}
        texts = [f"{output.path} = {value}" for output, value in wanted.items()]
        about = f"This takes over {', '.join(texts)} ({', '.join(slaves)})"
        until = "until Ctrl-C" if options.seconds is None else f"for {options.seconds:g} s"
        confirm(options, f"{about} {until}. Then the outputs take their safe values.")
        with _ended_by_signals(), client.claim(wanted, lease=_LEASE):
            for output, value in wanted.items():
                if options.raw or not _is_physical(output):
                    output.raw = value
                else:
                    output.value = value
            client.commit()
            _hold(client, wanted, options.seconds)
        rows = [{"output": output.path, "value": value} for output, value in wanted.items()]
        if options.json:
            print_json({"bus": client.name, "written": rows})
        else:
            print("the outputs are given back, and are safe again")


def _is_physical(signal: Signal) -> bool:
    return (signal.scale, signal.offset) != (1.0, 0.0)


def _assigned(client: Client, text: str, *, raw: bool) -> tuple[Signal, float]:
    """The output and the value of an argument; whole numbers keep all their digits.

    Raises:
        UsageError: It is none.
        StateError: There is no such entry.
    """
    name, equals, value = text.rpartition("=")
    number: float = 0
    try:
        number = int(value, 0)
    except ValueError:
        try:
            number = float(value)
        except ValueError:
            equals = ""
    if not equals or not name:
        raise UsageError(
            f"'{text}' is no output with a value: write it as 'drive/Target velocity=5'"
        )
    output = _output(client, name)
    whole = not output.real and (raw or not _is_physical(output))
    if whole and isinstance(number, float):
        if not number.is_integer():
            raise UsageError(f"{output.path} takes whole numbers, not {number:g}")
        number = int(number)
    return output, number


def _check_slaves(client: Client, wanted: Iterable[Signal]) -> None:
    """Refuses outputs of slaves that do not take any.

    Raises:
        StateError: A slave is not in OP.
    """
    slaves = client.slaves()
    for output in wanted:
        slave = slaves[output.slave]
        if slave.al_state != AlState.OP:
            state = al_state_text(slave.al_state) if slave.al_state else "without an answer"
            raise StateError(
                f"slave {slave.position} ({slave.name}) is {state}, so {output.path} does not "
                "reach it: `ecatctl state` says why"
            )


def _hold(client: Client, wanted: Iterable[Signal], duration: float | None) -> None:
    """Gives signs of life until the time is over, or somebody ends the command.

    Raises:
        LeaseError: The outputs were lost.
        StateError: A slave has left OP.
    """
    outputs = list(wanted)
    end = None if duration is None else time.monotonic() + duration
    try:
        while end is None or time.monotonic() < end:
            time.sleep(_BEAT if end is None else min(_BEAT, max(0.0, end - time.monotonic())))
            client.sample()
            lost = [output.path for output in outputs if not client.output(output).owned]
            if lost:
                raise LeaseError(
                    f"{', '.join(lost)}: lost, and at the safe value, because this command gave no "
                    "sign of life in time; write again"
                )
            _check_slaves(client, outputs)
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
        period = options.every * client.cycle_time
        if period > _PERIOD_MOST or (options.seconds is not None and period > options.seconds):
            raise UsageError(
                f"{options.every} cycles last {period:g} s: that is longer than "
                f"{'--for' if period <= _PERIOD_MOST else f'{_PERIOD_MOST:g} s'}"
            )
        try:
            with _alone(options.out) as file, _ended_by_signals():
                count, left_out, empty = _record(client, chosen, csv.writer(file), options)
        except PermissionError as error:
            raise NotPermittedError(f"{options.out} cannot be written: {error.strerror}") from error
        except OSError as error:
            raise StateError(f"{options.out} cannot be written: {error.strerror}") from error
    if options.json:
        print_json(
            {
                "bus": options.bus,
                "file": str(options.out),
                "cycles": count,
                "left_out": left_out,
                "empty": empty,
            }
        )
        return
    more = f"; {left_out} cycles were missed, because this program had no processor" * bool(
        left_out
    )
    more += f"; {empty} fields are empty, because their values could not be trusted" * bool(empty)
    print(f"{options.out}: {count} cycles with {len(chosen)} values{more}")


@contextmanager
def _alone(path: Path) -> Iterator[TextIO]:
    """Opens a file for writing that no other `record` writes.

    Raises:
        StateError: Another one writes it.
        OSError: It cannot be written.
    """
    with path.open("a", encoding="utf-8", newline="") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise StateError(f"{path} is being written by another ecatctl record") from error
        if path.is_file():
            file.truncate(0)
        yield file


def _record(
    client: Client, chosen: list[Signal], rows: Any, options: argparse.Namespace
) -> tuple[int, int, int]:
    """Writes the head and the rows.

    Returns:
        How many rows, how many cycles were missed, and how many fields are empty.
    """
    units = {signal.number: f" [{signal.unit}]" if signal.unit else "" for signal in chosen}
    rows.writerow(["time_s", "cycle", *(f"{s.path}{units[s.number]}" for s in chosen)])
    group, step, count, left_out, empty = client.group(chosen), client.cycle_time, 0, 0, 0
    patience = _PATIENCE + 2 * options.every * step
    domains = {signal.domain for signal in chosen}
    first = last = None
    end = None if options.seconds is None else time.monotonic() + options.seconds
    try:
        while end is None or time.monotonic() < end:
            client.wait(options.every, timeout=patience)
            client.sample()
            cycle = max(client.domain(number).cycle for number in domains)
            if first is None:
                first = cycle
            elif last is not None:
                left_out += max(0, (cycle - last) // options.every - 1)
            cells = _cells(chosen, group)
            empty += cells.count("")
            rows.writerow([f"{(cycle - first) * step:.6f}", cycle, *cells])
            last, count = cycle, count + 1
    except KeyboardInterrupt:
        pass
    return count, left_out, empty


def _cells(chosen: list[Signal], group: SignalGroup) -> list[str]:
    """The values as texts; that of an entry that cannot be trusted is empty.

    All entries of a slave in one direction are worth the same.
    """
    worth: dict[tuple[int, bool], bool] = {}
    cells = []
    for signal, raw, value in zip(chosen, group.raw, group.values, strict=True):
        key = signal.slave, signal.output
        if key not in worth:
            worth[key] = signal.validity.name == "VALID"
        text = f"{value:.15g}" if _is_physical(signal) or signal.real else str(raw)
        cells.append(text if worth[key] else "")
    return cells

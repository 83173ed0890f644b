"""Command `record`: writes the values of each cycle to a file."""

from __future__ import annotations

import argparse
import fcntl
import io
import time
from collections.abc import Iterator
from contextlib import contextmanager
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING

from ecatd.base.errors import NotPermittedError, StateError, UsageError
from ecatd.base.files import open_new
from ecatd.client.patterns import find_signals

from .arguments import times
from .output import print_json
from .recordings import FORMATS, Cell, Column, Recording, check_format, open_recording
from .saving import add_force, add_out, check_target
from .signals import (
    add_for,
    add_patterns,
    ended_by_signals,
    is_physical,
    open_client,
)

if TYPE_CHECKING:
    from ecatd.client import Client
    from ecatd.client.group import SignalGroup
    from ecatd.client.signals import Signal

COMMANDS = {
    "values": {"record": "Record the values of each cycle in a file (CSV, MCAP or Parquet)."}
}

_PATIENCE, _PERIOD_MOST = 5.0, 3600.0
"""Seconds for which a cycle may be late, and longest time between two lines in seconds."""


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments of the command."""
    add_patterns(command)
    add_out(command, f"the file; its name ends in {', '.join(FORMATS)}", "--out", required=True)
    command.add_argument(
        "--raw",
        action="store_true",
        help="record raw values, which `ecatd --simulate RIG --replay FILE` and `ecatsim run` need",
    )
    command.add_argument(
        "--every",
        type=times,
        default=1,
        metavar="N",
        help="record only every Nth cycle (default: 1)",
    )
    add_force(command)
    add_for(command, "stop after S seconds (default: when you press Ctrl-C)")


def record(options: argparse.Namespace) -> None:
    """Writes the values of each cycle to a file, until it ends."""
    suffix = options.out.suffix.lower()
    check_format(suffix, options.out)
    check_target(options.out, force=options.force)
    with open_client(options) as client:
        chosen = find_signals(client, options.patterns)
        period = options.every * client.cycle_time
        if period > _PERIOD_MOST or (options.seconds is not None and period > options.seconds):
            raise UsageError(
                f"{options.every} cycles last {period:g} s: that is longer than "
                f"{'--for' if period <= _PERIOD_MOST else f'{_PERIOD_MOST:g} s'}"
            )
        recording = None
        try:
            with _alone(options.out, force=options.force) as file, ended_by_signals():
                columns = [_column(signal, options.raw) for signal in chosen]
                recording = open_recording(suffix, file, options.bus, columns)
                try:
                    count, left_out, empty = _record(client, chosen, recording, options)
                finally:
                    recording.end()
        except FileExistsError as error:  # it was not there a moment ago
            raise UsageError(f"{options.out}: {error.strerror}") from error
        except PermissionError as error:
            raise NotPermittedError(f"{options.out} cannot be written: {error.strerror}") from error
        except OSError as error:
            rows = recording.rows if recording else 0
            if not rows and options.out.is_file():
                options.out.unlink()
            safe = f"{rows} cycles are safe in it" if rows else "nothing was recorded"
            raise StateError(
                f"{options.out} cannot be written: {error.strerror}; {safe}"
            ) from error
    if options.json:
        print_json(
            {
                "bus": options.bus,
                "file": str(options.out),
                "cycles": count,
                "left_out": left_out,
                "empty": empty,
                "infinite": recording.infinite,
            }
        )
        return
    more = f"; {left_out} cycles were missed, because this program got no processor in time" * bool(
        left_out
    )
    more += f"; {empty} fields are empty, because their values could not be trusted" * bool(empty)
    if recording.infinite:
        more += f"; {recording.infinite} fields are empty, because JSON has no infinity: use CSV"
    print(f"{options.out}: {count} cycles with {len(chosen)} values{more}")


@contextmanager
def _alone(path: Path, *, force: bool) -> Iterator[io.FileIO]:
    """Opens a file for writing, unless another `record` writes it.

    Raises:
        StateError: Another one writes it.
        OSError: It cannot be written.
    """
    # Not truncated before it is locked, and not buffered: no data wait for room when it is closed.
    number = open_new(path, force=force)
    with open(number, "wb", buffering=0) as file:  # noqa: PTH123  a path has no such mode
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise StateError(f"{path} is being written by another ecatctl record") from error
        if path.is_file():
            file.truncate(0)
        yield file


def _column(signal: Signal, raw: bool) -> Column:
    """A column of the file; that of raw values has the address of the entry, for a replay."""
    whole = "int64" if signal.signed else "uint64"
    kind = "float64" if signal.real else whole
    if raw:
        return Column(f"{signal.path} ({signal.address})", "", kind)
    return Column(signal.path, signal.unit, "float64" if is_physical(signal) else kind)


def _record(
    client: Client, chosen: list[Signal], recording: Recording, options: argparse.Namespace
) -> tuple[int, int, int]:
    """Records cycles.

    Returns:
        How many, how many cycles were missed, and how many values could not be trusted.
    """
    group, step, count, left_out, empty = client.group(chosen), client.cycle_time, 0, 0, 0
    patience = _PATIENCE + 2 * options.every * step
    domains = {signal.domain for signal in chosen}
    first = last = None
    end = None if options.seconds is None else time.monotonic() + options.seconds
    try:
        while end is None or time.monotonic() < end:
            client.wait(options.every, timeout=patience)
            client.sample()
            newest = max((client.domain(number) for number in domains), key=attrgetter("cycle"))
            cycle = newest.cycle
            if first is None:
                first = cycle
            elif last is not None:
                left_out += max(0, (cycle - last) // options.every - 1)
            cells = _cells(chosen, group, options.raw)
            empty += cells.count(None)
            age_ns = time.monotonic_ns() - newest.time_ns if newest.time_ns else 0
            recording.add((cycle - first) * step, cycle, cells, time.time_ns() - age_ns)
            last, count = cycle, count + 1
    except KeyboardInterrupt:
        pass
    return count, left_out, empty


def _cells(chosen: list[Signal], group: SignalGroup, only_raw: bool) -> list[Cell]:
    """The values; that of an entry that cannot be trusted is None.

    All entries of a slave in one direction can be trusted, or none of them.
    """
    worth: dict[tuple[int, bool], bool] = {}
    cells: list[Cell] = []
    for signal, raw, value in zip(chosen, group.raw, group.values, strict=True):
        key = signal.slave, signal.output
        if key not in worth:
            worth[key] = signal.validity.name == "VALID"
        physical = not only_raw and (is_physical(signal) or signal.real)
        cells.append((value if physical else raw) if worth[key] else None)
    return cells

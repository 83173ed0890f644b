"""Command `record`: writes the values of each cycle to a file."""

from __future__ import annotations

import argparse
import fcntl
import io
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ecatd.base.errors import NotPermittedError, StateError, UsageError
from ecatd.base.files import open_new
from ecatd.etg.scaling import to_physical

from .arguments import seconds, times
from .output import print_json
from .recordings import FORMATS, Cell, Column, Recording, check_format, open_recording
from .saving import add_force, add_out, check_target
from .signals import (
    add_for,
    add_patterns,
    ended_by_signals,
)

if TYPE_CHECKING:
    from ecatd.client.remote import Remote
    from ecatd.client.trace import Batch, Trace
    from ecatd.operations.traces import TraceSignal

COMMANDS = {
    "values": {"record": "Record the values of each cycle in a file (CSV, MCAP or Parquet)."}
}

_STDOUT = (Path("/dev/stdout"), Path("/dev/fd/1"), Path("/proc/self/fd/1"))
_PERIOD_MOST = 3600.0
"""Longest time between two lines in seconds."""


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
    command.add_argument(
        "--before",
        type=seconds,
        default=0.0,
        metavar="S",
        help="begin with the last S seconds, as far as ecatd keeps them",
    )
    add_force(command)
    add_for(command, "stop after S seconds (default: when you press Ctrl-C)")


def record(remote: Remote, options: argparse.Namespace) -> None:
    """Writes the values of each cycle to a file, until it ends."""
    check_target(options.out, force=options.force)
    suffix = options.out.suffix.lower()
    is_stream = not options.out.is_file() and options.out.exists()
    is_stdout = options.out in _STDOUT
    if (is_stream or is_stdout) and suffix not in FORMATS:
        suffix = ".csv"  # a device or a pipe has no such name
    check_format(suffix, options.out)
    recording = None
    try:
        with remote.trace(options.patterns or ["*"], options.before) as trace:
            _check_period(options, trace.cycle_time)
            with _alone(options.out, force=options.force) as file, ended_by_signals():
                columns = [_Column(signal, options.raw) for signal in trace.signals]
                heads = [column.head for column in columns]
                recording = open_recording(suffix, file, options.bus, heads)
                try:
                    counts = _record(trace, columns, recording, options)
                finally:
                    recording.end()
    except FileExistsError as error:  # it was not there a moment ago
        raise StateError(f"{options.out}: {error.strerror}") from error
    except PermissionError as error:
        raise NotPermittedError(f"{options.out} cannot be written: {error.strerror}") from error
    except OSError as error:
        rows = recording.rows if recording else 0
        if not rows and options.out.is_file():
            options.out.unlink()
        safe = f"{rows} cycles are safe in it" if rows else "nothing was recorded"
        raise StateError(f"{options.out} cannot be written: {error.strerror}; {safe}") from error
    before = (trace.live - trace.begin) * trace.cycle_time
    if options.json and not is_stdout:
        print_json(
            {
                "bus": options.bus,
                "file": str(options.out),
                "cycles": counts.cycles,
                "before_s": round(before, 6),
                "left_out": counts.left_out,
                "lost": counts.lost,
                "empty": counts.empty,
                "infinite": recording.infinite,
            }
        )
        return
    more = f"; it begins {before:.3f} s before and not {options.before:g} s, since ecatd keeps no "
    more += "older frames (flight_recorder.memory_mb)"
    more *= before + trace.cycle_time < options.before
    for count, what, why in (
        (counts.left_out, "cycle", "missing, since ecatd left them out"),
        (counts.lost, "cycle", "missing, since they were lost on the way here"),
        (counts.empty, "field", "empty, because their slaves did not take part"),
        (recording.infinite, "field", "empty, because JSON has no infinity: use CSV"),
    ):
        if count:
            more += f"; {_number_of(count, what)} {'is' if count == 1 else 'are'} {why}"
    text = f"{_number_of(counts.cycles, 'cycle')} with {_number_of(len(columns), 'value')}"
    print(f"{options.out}: {text}{more}", file=sys.stderr if is_stdout else sys.stdout)


def _number_of(count: int, what: str) -> str:
    return f"{count} {what}{'s' * (count != 1)}"


def _check_period(options: argparse.Namespace, cycle_time: float) -> None:
    period = options.every * cycle_time
    if period > _PERIOD_MOST or (options.seconds is not None and period > options.seconds):
        raise UsageError(
            f"{options.every} cycles last {period:g} s: that is longer than "
            f"{'--for' if period <= _PERIOD_MOST else f'{_PERIOD_MOST:g} s'}"
        )


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


class _Column:
    """An entry in the file; that of raw values has its address in its name, for a replay.

    Attributes:
        head: The head of the column.
    """

    def __init__(self, signal: TraceSignal, raw: bool) -> None:
        self._scale, self._offset = signal["scale"], signal["offset"]
        self._is_physical = not raw and (self._scale, self._offset) != (1.0, 0.0)
        is_real = signal["type"].startswith("float")
        kind = "float64" if is_real or self._is_physical else signal["type"].rstrip("0123456789")
        kind += "64" if kind in ("int", "uint") else ""
        if raw:
            self.head = Column(f"{signal['name']} ({signal['address']})", "", kind)
        else:
            self.head = Column(signal["name"], signal["unit"], kind)

    def cells(self, values: Sequence[float], places: Sequence[int]) -> list[Cell]:
        """The values of some cycles of a batch."""
        if self._is_physical:
            return [to_physical(values[at], self._scale, self._offset) for at in places]
        return [values[at] for at in places]


class _Counts(NamedTuple):
    """How many there were of what, for the end of the command."""

    cycles: int  #: How many were recorded.
    left_out: int  #: How many in between were not exchanged.
    lost: int  #: How many in between did not come here.
    empty: int  #: How many values are older ones, since their slaves did not take part.


def _record(
    trace: Trace, columns: Sequence[_Column], recording: Recording, options: argparse.Namespace
) -> _Counts:
    """Records cycles."""
    every, step = options.every, trace.cycle_time
    count = left_out = lost = empty = 0
    first = last = None
    is_lost = False
    with suppress(KeyboardInterrupt):
        for batch in trace:
            if first is None:
                first = batch.cycles[0]
            places = [at for at, cycle in enumerate(batch.cycles) if (cycle - first) % every == 0]
            if options.seconds is not None:
                end = trace.live + max(1, round(options.seconds / step))
                places = [at for at in places if batch.cycles[at] < end]
            rows = _rows(batch, places, columns)
            is_lost |= batch.lost
            for at, cells in zip(places, rows, strict=True):
                cycle = batch.cycles[at]
                missed = (cycle - last) // every - 1 if last is not None else 0
                if is_lost:
                    lost += missed
                else:
                    left_out += missed
                is_lost = False
                empty += cells.count(None)
                recording.add((cycle - first) * step, cycle, cells, batch.utc_ns[at])
                last, count = cycle, count + 1
            if options.seconds is not None and batch.cycles[-1] + 1 >= end:
                break
    return _Counts(count, left_out, lost, empty)


def _rows(batch: Batch, places: Sequence[int], columns: Sequence[_Column]) -> list[list[Cell]]:
    """The cells of some cycles of a batch; None for values that are older."""
    cells = [
        column.cells(values, places) for column, values in zip(columns, batch.columns, strict=True)
    ]
    for number, invalid in batch.invalid.items():
        for row, at in enumerate(places):
            if at in invalid:
                cells[number][row] = None
    return [list(row) for row in zip(*cells, strict=True)]

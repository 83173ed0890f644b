"""Waveform sources: functions of time (CLOCK_MONOTONIC in seconds)."""

from __future__ import annotations

import bisect
import csv
import math
from collections.abc import Callable
from pathlib import Path
from random import Random

from ecatd.base.errors import ConfigError, UsageError

Waveform = Callable[[float], float]


def constant(value: float) -> Waveform:
    """Makes a constant."""
    return lambda now: value


def sine(amplitude: float, frequency: float, phase: float = 0.0, offset: float = 0.0) -> Waveform:
    """Makes a sine; frequency in Hz, phase in rad."""
    omega = 2 * math.pi * frequency
    return lambda now: offset + amplitude * math.sin(omega * now + phase)


def square(frequency: float, low: float = 0, high: float = 1) -> Waveform:
    """Alternates between `high` and `low`, half a period each; frequency in Hz."""
    return lambda now: high if now * frequency % 1.0 < 0.5 else low


def ramp(low: float, high: float, frequency: float) -> Waveform:
    """Rises from `low` to `high` and drops at once (a saw tooth); frequency in Hz."""
    return lambda now: low + (high - low) * (now * frequency % 1.0)


def triangle(low: float, high: float, frequency: float) -> Waveform:
    """Rises from `low` to `high` and falls at the same rate; frequency in Hz."""
    return lambda now: high - (high - low) * abs(2 * (now * frequency % 1.0) - 1)


def noise(deviation: float, mean: float = 0.0, seed: int = 1) -> Waveform:
    """Makes normally distributed noise, the same for the same seed.

    Args:
        deviation: Standard deviation.
        mean: Mean value.
        seed: Seed of the generator.
    """
    gauss = Random(seed).gauss
    return lambda now: gauss(mean, deviation)


def table(
    path: Path | str, column: str | int = 1, time: str | int = 0, *, repeat: bool = False
) -> Waveform:
    """Makes a waveform from a CSV file, linear between its points; its first use starts it.

    Args:
        path: A CSV file; a first line with names is skipped.
        column: Name or number (from 0) of the column with the values.
        time: Name or number of the column with the times in seconds, ascending.
        repeat: Whether to start again after the last point; otherwise the last value stays.

    Raises:
        UsageError: The file cannot be read, or a column number is negative.
        ConfigError: The content of the file cannot be used; the message says where and why.
    """
    times, values = _read(Path(path), time, column)
    start: list[float] = []

    def waveform(now: float) -> float:
        if not start:
            start.append(now)
        at = now - start[0] + times[0]
        if repeat and times[-1] > times[0]:
            at = times[0] + (at - times[0]) % (times[-1] - times[0])
        i = bisect.bisect_right(times, at)
        if i == len(times):
            return values[-1]
        before, after = times[i - 1], times[i]
        return values[i - 1] + (values[i] - values[i - 1]) * (at - before) / (after - before)

    return waveform


def _read(path: Path, time: str | int, column: str | int) -> tuple[list[float], list[float]]:
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = [(number, row) for number, row in enumerate(csv.reader(file), 1) if row]
    except OSError as error:
        raise UsageError(f"cannot read '{path}': {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"{path}: this is not a CSV file: {error}") from error
    names = rows[0][1] if rows and not _is_number(rows[0][1][0]) else []
    if len(rows) <= bool(names):
        raise ConfigError(f"{path}: there are no values in it")
    columns = [_column(path, names, wanted) for wanted in (time, column)]
    times: list[float] = []
    values: list[float] = []
    for number, row in rows[bool(names) :]:
        try:
            at, value = (float(row[i]) for i in columns)
        except (ValueError, IndexError):
            raise ConfigError(f"{path}:{number}: expected a time and a value here") from None
        if not math.isfinite(at) or not math.isfinite(value) or (times and at <= times[-1]):
            raise ConfigError(f"{path}:{number}: times must ascend, and all must be numbers")
        times.append(at)
        values.append(value)
    return times, values


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _column(path: Path, names: list[str], wanted: str | int) -> int:
    if isinstance(wanted, int):
        if wanted < 0:
            raise UsageError(f"{path}: columns are counted from 0, not {wanted}")
        return wanted
    if wanted not in names:
        known = ", ".join(names) or "no names"
        raise ConfigError(f"{path}: there is no column '{wanted}'; the first line has {known}")
    return names.index(wanted)

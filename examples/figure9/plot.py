"""Plots the experiment as Figure 9 of the paper: speeds above, current below.

    python plot.py RESULT.csv [PICTURE.png] [--title TEXT]

The result is the CSV file of figure9.c, or that of TrollPlant.Examples.PointToPointMovement or
WheelOverCAN from a Modelica tool (OpenModelica: `simulate(..., outputFormat = "csv")`).
"""

from __future__ import annotations

import argparse
import csv
import math
from dataclasses import dataclass
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

_RPM = 30 / math.pi  # revolutions per minute at 1 rad/s
_TURNS, _RESTS = 100, 10  # revolutions per minute
_SOME = 0.2  # seconds


@dataclass(frozen=True)
class Result:
    """The curves: seconds, revolutions per minute, ampere."""

    time: list[float]
    reference: list[float]
    speed: list[float]
    current: list[float]


def read(file: Path) -> Result:
    """Reads a result file, whose values are in SI units.

    Raises:
        SystemExit: The file has no such columns.
    """
    with file.open(newline="") as lines:
        rows = list(csv.DictReader(lines))
    try:
        time, reference, speed, current = (
            [float(row[name]) for row in rows] for name in ("time", "w_ref", "w_m", "i_m")
        )
    except KeyError as missing:
        raise SystemExit(
            f"{file} has no column {missing}: is it a result of this experiment?"
        ) from None
    return Result(
        time, [value * _RPM for value in reference], [value * _RPM for value in speed], current
    )


def plot(result: Result, picture: Path, title: str) -> None:
    """Draws the two panels."""
    figure, (speeds, current) = plt.subplots(
        2, 1, sharex=True, figsize=(9, 6), height_ratios=(3, 2), layout="constrained"
    )
    speeds.plot(result.time, result.speed, color="tab:blue", label="measured speed w_m")
    speeds.plot(
        result.time, result.reference, color="black", ls="--", lw=1, label="reference speed w_ref"
    )
    speeds.set_ylabel("speed of the motor in rpm")
    speeds.legend(loc="lower center")
    current.plot(result.time, result.current, color="tab:red", lw=0.8, label="measured current i_m")
    current.set_ylabel("current in A")
    current.set_xlabel("time in s")
    current.legend(loc="lower center")
    for axes in (speeds, current):
        axes.grid(alpha=0.3)
        axes.margins(x=0)
    figure.suptitle(title)
    figure.savefig(picture, dpi=120)
    plt.close(figure)


def seconds_at_rest(result: Result) -> float:
    """How long the motor does not turn although the reference does."""
    pairs = zip(result.reference, result.speed, strict=True)
    at_rest = sum(abs(reference) > _TURNS and abs(speed) < _RESTS for reference, speed in pairs)
    return at_rest / len(result.time) * (result.time[-1] - result.time[0]) if at_rest else 0.0


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description="Plots the result of the experiment.")
    parser.add_argument("result", type=Path, help="result file (CSV)")
    parser.add_argument(
        "picture", type=Path, nargs="?", default=Path("figure9.png"), help="picture to write"
    )
    parser.add_argument("--title", default="Point-to-point movement of the motor")
    options = parser.parse_args()
    result = read(options.result)
    plot(result, options.picture, options.title)
    if (lost := seconds_at_rest(result)) > _SOME:
        print(
            f"The motor stands still for {lost:.1f} s of its movement: ecatd lost the drive, on a "
            "simulated bus because other programs took the processor, and a drive starts again "
            "only after a new edge of `enable`. Repeat the experiment while the machine is idle."
        )


if __name__ == "__main__":
    main()

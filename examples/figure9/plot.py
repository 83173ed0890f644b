"""Plots the experiment as Figure 9 of the paper: speeds above, current below.

    python plot.py RESULT.csv [PICTURE.png]

The result is the CSV file of figure9.c, or that of TrollPlant.Examples.PointToPointMovement from a
Modelica tool (OpenModelica: `simulate(..., outputFormat = "csv")`).
"""

from __future__ import annotations

import argparse
import csv
import re
from dataclasses import dataclass
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

RATED = 1000  # what the drive reports at its rated current


@dataclass(frozen=True)
class Result:
    """The curves, in physical units where the file tells the data of the drive."""

    time: list[float]
    reference: list[float]
    speed: list[float]
    current: list[float]
    speed_unit: str
    current_unit: str


def read(file: Path) -> Result:
    """Reads a result file.

    Raises:
        SystemExit: The file has no such columns.
    """
    with file.open(newline="") as lines:
        first = lines.readline()
        if not first.startswith("#"):
            lines.seek(0)
        rows = list(csv.DictReader(lines))
    try:
        time, reference, speed, current = (
            [float(row[name]) for row in rows] for name in ("time", "w_ref", "w_m", "i_m")
        )
    except KeyError as missing:
        raise SystemExit(
            f"{file} has no column {missing}: is it a result of this experiment?"
        ) from None
    facts = (
        dict(re.findall(r"([a-z ]+?)(?: in mA)?: (\d+)", first)) if first.startswith("#") else {}
    )
    encoder = int(facts.get(" encoder increments", 0)) / (
        int(facts.get(" per revolutions", 0)) or 1
    )
    rated = int(facts.get(" rated current", 0))
    per_minute = 60 / encoder if encoder else 1
    ampere = rated / 1000 / RATED if rated else 1
    return Result(
        time,
        [value * per_minute for value in reference],
        [value * per_minute for value in speed],
        [value * ampere for value in current],
        "rpm" if encoder else "increments/s",
        "A" if rated else "‰ of rated",
    )


def plot(result: Result, picture: Path) -> None:
    """Draws the two panels."""
    figure, (speeds, current) = plt.subplots(
        2, 1, sharex=True, figsize=(9, 6), height_ratios=(3, 2), layout="constrained"
    )
    speeds.plot(result.time, result.speed, color="tab:blue", label="measured speed w_m")
    speeds.plot(
        result.time, result.reference, color="black", ls="--", lw=1, label="reference speed w_ref"
    )
    speeds.set_ylabel(f"speed of the motor in {result.speed_unit}")
    speeds.legend(loc="lower center")
    current.plot(result.time, result.current, color="tab:red", lw=0.8, label="measured current i_m")
    current.set_ylabel(f"current in {result.current_unit}")
    current.set_xlabel("time in s")
    current.legend(loc="lower center")
    for axes in (speeds, current):
        axes.grid(alpha=0.3)
        axes.margins(x=0)
    figure.suptitle("Point-to-point movement of the motor, 1000 Hz")
    figure.savefig(picture, dpi=120)
    plt.close(figure)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description="Plots the result of the experiment.")
    parser.add_argument("result", type=Path, help="result file (CSV)")
    parser.add_argument(
        "picture", type=Path, nargs="?", default=Path("figure9.png"), help="picture to write"
    )
    options = parser.parse_args()
    plot(read(options.result), options.picture)


if __name__ == "__main__":
    main()

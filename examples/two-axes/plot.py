"""Draws the movement of two axes as each client has printed it.

python plot.py PICTURE.png C=c.csv C++=cpp.csv Python=python.csv FMU=fmu.csv
"""

import csv
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt


def read(file: Path) -> list[tuple[float, float, float]]:
    """The rows of a result: time, x and y."""
    with file.open(newline="") as lines:
        return [(float(time), float(x), float(y)) for time, x, y in csv.reader(lines)]


def main(picture: str, *results: str) -> None:
    """Draws results such as `C=c.csv`."""
    figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(8, 5), layout="constrained")
    styles = ("-", "--", "-.", ":")
    for number, item in enumerate(results):
        name, _, file = item.partition("=")
        rows = read(Path(file))
        for panel, column in ((above, 1), (below, 2)):
            panel.plot(
                [row[0] for row in rows],
                [row[column] for row in rows],
                styles[number % len(styles)],
                label=name,
                linewidth=1.6,
            )
    above.set_ylabel("x in m")
    below.set_ylabel("y in rad")
    below.set_xlabel("time in s")
    for panel in (above, below):
        panel.grid(visible=True, alpha=0.3)
    above.legend(loc="upper right")
    above.set_title("Two axes, moved by different clients")
    figure.savefig(picture, dpi=120)


if __name__ == "__main__":
    main(*sys.argv[1:])

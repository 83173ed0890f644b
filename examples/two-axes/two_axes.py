"""Two axes in Python: they home, move together, and stop.

    ecatd --simulate two-axes --config examples/two-axes/two-axes.toml
    python examples/two-axes/two_axes.py ecat0 >two_axes.csv

Prints time in s, position of x in m, and of y in rad.
"""

import sys

from ecatd.client import Client
from ecatd.client.drives import Drives

OUT, BACK = (0.05, 2.0), (0.0, 0.0)
SPEEDS, ACCELERATIONS = (0.1, 2.0), (0.5, 8.0)


def move(axes: Drives, positions: tuple[float, float], time: float) -> float:
    """Moves both axes, and prints where they are meanwhile; returns the time at the end."""
    axes.move_to(None, positions, SPEEDS, ACCELERATIONS, wait=False)
    first = axes.cycle
    while not axes.reached():
        axes.wait()
        x, y = (axis.position for axis in axes)
        print(f"{time + (axes.cycle - first) * axes.cycle_time:.3f},{x:.6f},{y:.6f}")
    return time + (axes.cycle - first) * axes.cycle_time


def main(bus: str) -> None:
    """The whole movement."""
    with Client(bus) as client, client.drives("x", "y") as axes:
        axes.enable()
        axes.home()
        axes.move_to(None, BACK)
        end = move(axes, OUT, 0.0)
        move(axes, BACK, end)
        axes.stop()


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "ecat0")

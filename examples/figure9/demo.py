"""`make demo`: the experiment of Figure 9 of the paper, with the EtherCAT drive of `troll`."""

import sys
from pathlib import Path

from experiment import LIBRARY, Experiment, main

EXPERIMENT = Experiment(
    command="make demo",
    rig="troll",
    program=Path(__file__).with_name("figure9.c"),
    model=f"{LIBRARY}.Examples.PointToPointMovement",
    file=None,
    config=None,
    options=(),
    picture="figure9",
    title="Point-to-point movement of the motor, 1000 Hz",
)

if __name__ == "__main__":
    sys.exit(main(EXPERIMENT))

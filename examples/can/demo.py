"""`make demo-can`: the experiment of Figure 9 of the paper, with a CANopen drive.

The drive is node 5 behind the terminal `can` of the rig `troll-can`.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "figure9"))

from experiment import Experiment, main

from ecatsim.can.nodes.drive import EDS

HERE = Path(__file__).resolve().parent
EXPERIMENT = Experiment(
    command="make demo-can",
    rig="troll-can",
    program=HERE / "wheel_over_can.c",
    model="WheelOverCAN",
    file=HERE / "WheelOverCAN.mo",
    config=HERE.parent / "troll" / "troll-can.toml",
    options=("--can", f"can={EDS}@5"),
    picture="figure9-can",
    title="Point-to-point movement of the motor, 1000 Hz, by CANopen behind EtherCAT",
)

if __name__ == "__main__":
    sys.exit(main(EXPERIMENT))

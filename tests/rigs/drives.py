"""Two drives, whose motors are recorded as the simulator has them, and whose encoders can break.

The record goes to the file that $DRIVES_RECORD names: one row for each step of the simulator.
Object 0x2100 of a drive is of this rig: 1 breaks the cable of its encoder.
"""

import os
from pathlib import Path
from typing import IO

from ecatd.etg.datatypes import DataType
from ecatsim.devices.drive import Drive
from ecatsim.devices.drives import kind
from ecatsim.devices.generic_drive import CiA402Drive
from ecatsim.rig import Rig
from ecatsim.slave.objects import Access, Value

COLUMNS = (
    *("slave", "time", "phi", "w", "i", "control", "status", "mode", "display"),
    *("target_position", "target_velocity", "target_torque", "position"),
)
ELMO, GENERIC = 0, 1
ENCODER = 10_000  # of the generic drive
BREAK_ENCODER = 0x2100


def rig() -> Rig:
    drives: list[Drive] = [kind("ElmoGold")(), CiA402Drive(encoder=ENCODER)]
    result = Rig("drives", list(drives))
    for drive in drives:
        _add_break(drive)
    if path := os.environ.get("DRIVES_RECORD"):
        file = Path(path).open("w", buffering=1)  # noqa: SIM115 - as long as the simulator lives
        file.write(",".join(COLUMNS) + "\n")
        for slave, drive in enumerate(drives):
            result.plants.append(_Recorder(file, slave, drive))
    return result


def _add_break(drive: Drive) -> None:
    drive.dictionary.variable(BREAK_ENCODER, "Break encoder", DataType.UNSIGNED8, 0, Access.RW)

    def written(value: Value) -> None:
        drive.break_encoder(bool(value))

    drive.dictionary[BREAK_ENCODER, 0].on_write = written


class _Recorder:
    def __init__(self, file: IO[str], slave: int, drive: Drive) -> None:
        self._file, self._slave, self._drive = file, slave, drive

    def __call__(self, now: float) -> None:
        drive, motor = self._drive, self._drive.motor
        objects = (0x6040, 0x6041, 0x6060, 0x6061, 0x607A, 0x60FF, 0x6071, 0x6064)
        values = [self._slave, now, motor.position, motor.speed, motor.current]
        values += [drive[index, 0] for index in objects]
        self._file.write(",".join(map(str, values)) + "\n")

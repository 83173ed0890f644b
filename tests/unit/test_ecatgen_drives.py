"""From the block of a CiA 402 drive to the block in SI units around it."""

from dataclasses import replace

import pytest

from ecatd.config.meanings import give_meanings
from ecatd.config.profiles import load_profiles
from ecatd.description.bus import Bus, Slave
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatdev import sample_buses
from ecatgen.build import build_library
from ecatgen.ir import Drive
from ecatgen.render import render

PROFILES = load_profiles()
I16, I32, U16, U32 = (
    DataType.INTEGER16,
    DataType.INTEGER32,
    DataType.UNSIGNED16,
    DataType.UNSIGNED32,
)
CONTROL, STATUS = Entry(0x6040, 0, "Control", U16, 16), Entry(0x6041, 0, "Status", U16, 16)
POSITION = Entry(0x6064, 0, "Position", I32, 32)
TARGET_POSITION = Entry(0x607A, 0, "Target", I32, 32)
TARGET_TORQUE = Entry(0x6071, 0, "Torque", I16, 16)
TORQUE = Entry(0x6077, 0, "Actual torque", I16, 16)


def drives(outputs: list[Entry], inputs: list[Entry], name: str = "Axis") -> tuple[Drive, ...]:
    slave = Slave(
        0,
        name,
        1,
        2,
        3,
        outputs=[Pdo(0x1600, "out", 2, outputs)],
        inputs=[Pdo(0x1A00, "in", 3, inputs)],
    )
    return build_library(give_meanings(Bus("ecat0", 1000, [slave]), PROFILES), "P").drives


def test_the_drive_of_the_reference_plant() -> None:
    library = build_library(sample_buses.troll(), "TrollPlant")
    (drive,) = library.drives
    assert (drive.name, drive.instance) == ("GoldGCONDrive", "goldGCONDrive")
    assert drive.mode == "EtherCAT.Types.DriveMode.CyclicVelocity"
    assert len(drive.modes) == 6
    assert drive.mode_object == 0
    assert drive.missing == drive.unused == ()
    lines = {c.target: c.source for c in drive.connections}
    assert lines["slave.targetVelocity"] == "cia402.targetVelocity"
    assert lines["cia402.torqueActualValue"] == "slave.torqueValue"
    assert lines["cia402.valid"] == "slave.valid"
    assert len(lines) == len(drive.connections) == 13
    files = render(library)
    assert files["Drives/package.order"] == b"GoldGCONDrive\n"
    assert b"\nDrives\n" in files["package.order"]


def test_a_position_drive_that_gets_its_mode_by_sdo() -> None:
    (drive,) = drives([CONTROL, TARGET_POSITION], [STATUS, POSITION])
    assert drive.mode == "EtherCAT.Types.DriveMode.CyclicPosition"
    assert drive.modes == ("CyclicPosition", "ProfilePosition")
    assert [what for _, what in drive.missing] == [
        "target velocity 0x60FF",
        "target torque 0x6071",
    ]
    assert "final modeInProcessData = false" in drive.modifiers
    assert "final useVelocity = false" in drive.modifiers
    assert drive.mode_object == 0x6060
    assert drive.entries == "ECAT_DRIVE_HAS_POSITION"


def test_outputs_that_the_state_machine_does_not_know_are_parameters() -> None:
    other = Entry(0x6081, 0, "Profile velocity", U32, 32)
    (drive,) = drives([CONTROL, TARGET_TORQUE, other], [STATUS, TORQUE])
    assert [c.name for c in drive.unused] == ["profileVelocity"]
    library = build_library(
        Bus(
            "ecat0",
            1000,
            [
                Slave(
                    0,
                    "Axis",
                    1,
                    2,
                    3,
                    outputs=[Pdo(0x1600, "out", 2, [CONTROL, TARGET_TORQUE, other])],
                    inputs=[Pdo(0x1A00, "in", 3, [STATUS, TORQUE])],
                )
            ],
        ),
        "P",
    )
    text = render(library)["Drives/Axis.mo"].decode()
    assert "parameter Real profileVelocityValue = 0" in text
    assert "profileVelocity = profileVelocityValue" in text


@pytest.mark.parametrize(
    ("outputs", "inputs"),
    [
        ([TARGET_POSITION], [STATUS, POSITION]),
        ([CONTROL, TARGET_POSITION], [POSITION]),
        ([CONTROL, TARGET_POSITION], [STATUS]),
        ([CONTROL], [STATUS, POSITION]),
        ([CONTROL, replace(TARGET_POSITION, data_type=U32)], [STATUS, POSITION]),
    ],
    ids=["control word", "status word", "position", "target", "type of the target"],
)
def test_no_drive_without(outputs: list[Entry], inputs: list[Entry]) -> None:
    assert drives(outputs, inputs) == ()


def test_a_slave_called_drives_leaves_the_name_to_the_package() -> None:
    (drive,) = drives([CONTROL, TARGET_POSITION], [STATUS, POSITION], "Drives")
    assert drive.block.name == "DrivesSlave"

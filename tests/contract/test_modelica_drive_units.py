"""A drive whose process data have units: its block in SI units takes them, converts, or refuses."""

import math
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from plant_calls import compile_program, run

from conftest import Daemon, names
from ecatd.config import SignalConfig
from ecatd.config.meanings import give_meanings
from ecatd.config.profiles import Profiles
from ecatd.description.bus import Bus
from ecatdev import sample_buses
from ecatdev.drawing.checks import check_diagram
from ecatdev.drawing.pictures import found_with
from ecatdev.drawing.scene import diagram
from ecatdev.files import write_files
from ecatgen.build import build_library
from ecatgen.ir import Drive, Library
from ecatgen.render import render

POSITION, TARGET_POSITION = "0x6064:00", "0x607A:00"
VELOCITY, TARGET_VELOCITY, TORQUE = "0x606C:00", "0x60FF:00", "0x6077:00"
TURN = 2 * math.pi / 65536
"""Radian of an increment of the motor of the rig."""

CONFIG = f"""
[[signal]]
slave = 0
entry = "{POSITION}"
unit = "rad"
scale = {TURN!r}

[[signal]]
slave = 0
entry = "{TARGET_VELOCITY}"
unit = "rpm"
scale = {60 / 65536!r}

[gateway]
listen = []
"""

PROGRAM = """
#include "Plant.h"
/* Turns the drive at 10 rad/s; prints angles of both blocks and the speed when it has turned. */
int main(int argc, char **argv) {
  static Plant_Drives_GoldGCONDrive drive;
  ecatm_drive_settings settings;
  int n, enabled = 0;
  double from = 0;
  void *master = ecatm_master_open(argv[argc - 1], 1, 0.001, 1, 30, 1, 2, 0, 0, 0, "");
  /* 1: what follows from the units */
  ecatm_drive_defaults(&settings, ECAT_DRIVE_CYCLIC_VELOCITY, 1);
  Plant_Drives_GoldGCONDrive_open(&drive, master, 1, &settings, NULL, 0);
  for (n = 0; n < 20000; n++) {
    double time = 0.001 * n;
    int cycle = ecatm_wait(master, time);
    Plant_Drives_GoldGCONDrive_read(&drive, time, cycle);
    drive.enable = drive.faultReset = 1;
    drive.reference = 10;
    if (drive.enabled && !enabled) enabled = 1, from = drive.phi;
    if (enabled && drive.phi - from > 5) {
      printf("%.9f %.9f %.9f %.9f\\n", drive.phi, drive.slave.@POSITION@, drive.w,
             (double)drive.slave.@VELOCITY@);
      break;
    }
    Plant_Drives_GoldGCONDrive_write(&drive, time, cycle);
  }
  Plant_Drives_GoldGCONDrive_close(&drive);
  ecatm_master_close(master);
  return !enabled;
}
"""


def library(*rules: SignalConfig) -> Library:
    bus: Bus = give_meanings(sample_buses.troll(), Profiles(), rules)
    return build_library(bus, "Plant")


def drive_of(*rules: SignalConfig) -> Drive:
    (drive,) = library(*rules).drives
    return drive


def parameters(*rules: SignalConfig) -> dict[str, float]:
    return {item.name: float(item.value) for item in drive_of(*rules).parameters}


def rule(entry: str, unit: str, scale: float = 1.0, offset: float | None = None) -> SignalConfig:
    return SignalConfig(0, entry, unit=unit, scale=scale, offset=offset)


@pytest.mark.bus
def test_the_angle_of_the_drive_is_that_of_its_slave(
    start_daemon: Callable[..., Daemon], compiler: str, tmp_path: Path
) -> None:
    daemon = start_daemon("troll", config=CONFIG)
    daemon.ctl("generate", "Plant", str(tmp_path))
    text = (tmp_path / "Plant" / "Drives" / "GoldGCONDrive.mo").read_text()
    (position,) = re.findall(r"connect\(slave\.(\w+), positionActualValueConversion\.u\)", text)
    (velocity,) = re.findall(r"connect\(slave\.(\w+), cia402\.velocityActualValue\)", text)
    source = PROGRAM.replace("@POSITION@", position).replace("@VELOCITY@", velocity)
    result = run(compile_program(compiler, source, tmp_path, tmp_path), daemon.bus)
    assert result.returncode == 0, result.stderr
    phi, slave_phi, w, raw_speed = map(float, result.stdout.split())
    assert phi == pytest.approx(slave_phi, abs=1e-6)
    assert w == pytest.approx(raw_speed * TURN, rel=1e-6)  # increments/s: without a unit of its own
    assert 5 < w < 15


def test_the_documentation_of_a_drive_names_what_follows_from_units() -> None:
    def documented(*rules: SignalConfig) -> str:
        return render(library(*rules))["Drives/GoldGCONDrive.mo"].decode()

    position = rule(POSITION, "rad", TURN)
    assert re.search(r"</code> = [\d.]+\nfollows from the units", documented(position))
    assert re.search(
        r"= [\d.]+, <code>velocityScale</code> = [\d.]+\nfollow from the units",
        documented(position, rule(TARGET_VELOCITY, "rad/s", TURN)),
    )


def test_parameters_follow_from_units() -> None:
    assert parameters() == {}
    assert parameters(rule(POSITION, "deg", 360 / 4096)) == {
        "encoderResolution": pytest.approx(4096)
    }
    assert parameters(rule(TARGET_VELOCITY, "1/min", 0.1), rule(TORQUE, "mN.m", 0.5)) == {
        "velocityScale": pytest.approx(600),
        "ratedTorque": pytest.approx(0.5),
    }
    # Both count in the same unit, which may be spelled in two ways.
    assert parameters(
        rule(POSITION, "deg", 360 / 4096), rule(TARGET_POSITION, "rev", 1 / 4096)
    ) == {"encoderResolution": pytest.approx(4096)}


def test_units_of_another_kind_are_converted_back() -> None:
    """The state machine gets raw values, and its parameters stay the user's."""
    drive = drive_of(rule(POSITION, "m", 0.001), rule(TORQUE, "%", 0.1))
    assert drive.parameters == ()
    conversions = {line.drive: line.conversion for line in drive.reads}
    assert conversions["positionActualValue"] == "positionActualValueConversion"
    assert conversions["velocityActualValue"] == ""
    lines = [(line.source, line.target) for line in drive.connections]
    assert ("positionActualValueConversion.y", "cia402.positionActualValue") in lines
    assert all(target != "cia402.torqueActualValue" or "Conversion" in s for s, target in lines)


def test_the_diagram_is_in_order(tmp_path: Path) -> None:
    """Conversions stand in the lines between state machine and slave, and nothing overlaps."""
    scaled = [rule(entry, "rad") for entry in (POSITION, TARGET_POSITION)]
    scaled += [rule(entry, "rpm") for entry in (VELOCITY, TARGET_VELOCITY)]
    write_files(tmp_path / "Plant", render(library(*scaled, rule(TORQUE, "%"))))
    found = found_with(tmp_path)
    drawn = diagram(found, "Plant.Drives.GoldGCONDrive")
    assert {name for name in drawn.parts if name.endswith("Conversion")} == {
        *("positionActualValueConversion", "velocityActualValueConversion"),
        *("targetPositionConversion", "targetVelocityConversion", "torqueActualValueConversion"),
    }
    assert list(check_diagram(drawn)) == []


def test_all_modes_are_there_whatever_the_units() -> None:
    with_units = drive_of(rule(TARGET_VELOCITY, "rpm", 0.1), rule(TARGET_POSITION, "rad", TURN))
    assert with_units.modes == drive_of().modes
    assert with_units.missing == ()
    assert "PointToPointMovement" in [example.name for example in library().examples]
    (example, *_) = library(rule(POSITION, "rad", TURN)).examples
    assert "encoderResolution" not in str(example.components)  # which is final then


@pytest.mark.parametrize(
    ("rules", "reason"),
    [
        (
            [rule(POSITION, "rad", TURN), rule(TARGET_POSITION, "rad", 2 * TURN)],
            "0x607A:00 | 0.000191748 rad | 0x6064:00 | 9.58738e-05 rad",
        ),
        ([rule(POSITION, "rad", TURN, 0.5)], "0x6064:00 | offset | 0.5 rad"),
        ([rule(TARGET_VELOCITY, "rpm", -1)], "0x60FF:00 | scale | -1"),
    ],
)
def test_what_cannot_be_had_in_si_units_is_refused_by_name(
    rules: list[SignalConfig], reason: str
) -> None:
    made = library(*rules)
    assert made.drives == ()
    (note,) = made.notes
    place, what, why = note.split(": ", 2)
    names(f"{place}: {what}", "slave 0 GoldGCONDrive", "no block", "SI units")
    names(why, *reason.split(" | "))
    assert why in render(made)["UsersGuide.mo"].decode()

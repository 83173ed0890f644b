"""The units of systemd: what they protect, and that the one for a single bus is like the other."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from ecatd.service.failed_starts import RESTART_S

UNITS = Path(__file__).parents[2] / "systemd"
EXPOSURE = 2.3
OF_ONE_BUS = ("# ", "Conflicts=", "After=ecatd@", "DefaultInstance=")


def settings(unit: str) -> list[str]:
    """The lines of a unit that are the same for a single bus and for several."""
    lines = (UNITS / unit).read_text().replace("%i", "ecat0").splitlines()
    return [line for line in lines if line and not line.startswith(OF_ONE_BUS)]


def test_a_single_bus_is_a_bus_as_any_other() -> None:
    assert settings("ecatd.service") == settings("ecatd@.service")


def test_only_one_of_both_runs_the_bus() -> None:
    lines = (UNITS / "ecatd.service").read_text().splitlines()
    assert {"Conflicts=ecatd@ecat0.service", "After=ecatd@ecat0.service"} <= set(lines)


def test_the_pause_after_a_failed_start_is_that_of_the_unit() -> None:
    assert f"RestartSec={RESTART_S}" in settings("ecatd@.service")


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="there is no systemd")
def test_exposure(tmp_path: Path) -> None:
    unit = shutil.copy(UNITS / "ecatd.service", tmp_path)
    command = ["systemd-analyze", "security", "--offline=yes", "--no-pager", unit]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    (found,) = re.findall(r"Overall exposure level .*: ([0-9.]+)", told)
    assert float(found) <= EXPOSURE, told

"""The units of systemd: what they protect, and that those for a single bus are like the others."""

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from ecatd.admin.installation.places import LOCAL, files
from ecatd.base.errors import LOOPBACK
from ecatd.cli.main import make_parser as make_client_parser
from ecatd.service.failed_starts import RESTART_S
from ecatd.service.main import make_parser
from ecatd.service.supervisor import STOP_PATIENCE_S

UNITS = Path(__file__).parents[2] / "systemd"
ALL = ("ecatd.service", "ecatd@.service", "ecatd-gateway.service", "ecatd-gateway@.service")
WEB, ROS = "ecatd-web.service", "ecatd-ros@.service"
EXPOSURE = {"ecatd.service": 2.3, "ecatd-gateway.service": 1.4, WEB: 1.4, ROS: 1.4}
OF_ONE_BUS = ("# ", "Conflicts=", "After=ecatd@", "DefaultInstance=")

needs_systemd = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="there is no systemd"
)


def lines(unit: str) -> list[str]:
    """What a unit says."""
    return [line for line in (UNITS / unit).read_text().splitlines() if line]


def settings(unit: str) -> list[str]:
    """The lines of a unit that are the same for a single bus and for several."""
    text = "\n".join(lines(unit)).replace("@%i.service", ".service").replace("%i", "ecat0")
    return [line for line in text.splitlines() if not line.startswith(OF_ONE_BUS)]


@pytest.mark.parametrize("name", ["ecatd", "ecatd-gateway"])
def test_a_single_bus_is_a_bus_as_any_other(name: str) -> None:
    assert settings(f"{name}.service") == settings(f"{name}@.service")


def test_only_one_of_both_runs_the_bus() -> None:
    assert {"Conflicts=ecatd@ecat0.service", "After=ecatd@ecat0.service"} <= set(
        lines("ecatd.service")
    )


def test_the_pause_after_a_failed_start_is_that_of_the_unit() -> None:
    assert f"RestartSec={RESTART_S}" in settings("ecatd@.service")


@pytest.mark.parametrize("setting", ["TimeoutStopSec", "TimeoutAbortSec"])
def test_systemd_waits_for_the_longest_orderly_end(setting: str) -> None:
    (line,) = (line for line in settings("ecatd@.service") if line.startswith(f"{setting}="))
    drives_s, mailboxes_s = 30, 9  # the most that a configuration may allow
    assert int(line.partition("=")[2]) > STOP_PATIENCE_S + drives_s + mailboxes_s


def test_r41_the_gateway_has_a_user_of_its_own_and_no_rights() -> None:
    bus, gateway = set(lines("ecatd@.service")), set(lines("ecatd-gateway@.service"))
    (user,) = (line for line in gateway if line.startswith("User="))
    assert user not in bus
    users = (UNITS / "ecatd.sysusers.conf").read_text()
    assert f"u {user.removeprefix('User=')} " in users
    # Without the gateway's group the bus runs: it is no setting of its unit.
    assert "m ecatd ecatd-gateway" in users
    assert not [line for line in bus if line.startswith("SupplementaryGroups=")]
    assert {"CapabilityBoundingSet=", "InaccessiblePaths=-/dev/shm/ecat/%i.out"} <= gateway
    assert not [line for line in gateway if line.startswith("AmbientCapabilities=")]


def test_the_gateway_begins_and_ends_with_the_bus_and_never_ends_it() -> None:
    start = "ExecStartPost=-+/bin/systemctl start --no-block ecatd-gateway@%i.service"
    assert start in lines("ecatd@.service")
    assert {"BindsTo=ecatd@%i.service", "After=ecatd@%i.service"} <= set(
        lines("ecatd-gateway@.service")
    )


@pytest.mark.parametrize("unit", ALL)
def test_the_program_knows_the_options(unit: str) -> None:
    (command,) = (line for line in lines(unit) if line.startswith("ExecStart="))
    options = make_parser().parse_args(shlex.split(command)[1:])
    assert options.bus in ("%i", "ecat0")
    assert options.only_gateway == ("gateway" in unit)
    assert options.no_gateway != options.only_gateway


def test_the_live_view_has_no_right_on_the_bus() -> None:
    unit = set(lines(WEB))
    users = (UNITS / "ecatd.sysusers.conf").read_text().splitlines()
    assert {"User=ecatd-web", "Group=ecatd-web", "CapabilityBoundingSet="} <= unit
    assert "InaccessiblePaths=-/run/ecatd -/dev/shm" in unit
    groups = [line for line in unit if line.startswith("SupplementaryGroups=")]
    assert not groups + [line for line in users if line.startswith("m ecatd-web")]
    (command,) = (line for line in unit if line.startswith("ExecStart="))
    (given,) = (line for line in unit if line.startswith("Environment="))
    gateway = given.partition("GATEWAY=")[2]
    words = shlex.split(command.replace("${GATEWAY}", gateway).replace("$OPTIONS", ""))
    options = make_client_parser().parse_args(words[1:])
    assert (options.connect, options.address, options.allow) == (LOOPBACK, None, ())
    folder = str(options.address_file.parent)
    assert f"d {folder} 2750 ecatd-web ecat -" in (UNITS / "ecatd.tmpfiles.conf").read_text()


def test_what_ros_sees_has_a_user_of_its_own_that_reads_only() -> None:
    unit = set(lines(ROS))
    users = (UNITS / "ecatd.sysusers.conf").read_text().splitlines()
    assert {"User=ecatd-ros", "Group=ecat", "CapabilityBoundingSet="} <= unit
    assert 'u ecatd-ros - "EtherCAT for ROS 2"' in users
    # No socket to request something, and no file to claim outputs.
    assert "InaccessiblePaths=-/run/ecatd -/dev/shm/ecat/%i.out" in unit
    groups = [line for line in unit if line.startswith("SupplementaryGroups=")]
    assert not groups + [line for line in users if line.startswith("m ecatd-ros")]
    (command,) = (line for line in unit if line.startswith("ExecStart="))
    options = make_parser().parse_args(shlex.split(command)[1:])
    assert (options.only_ros, options.bus, str(options.config)) == (
        True,
        "%i",
        "/etc/ecatd/%i.toml",
    )


@needs_systemd
@pytest.mark.parametrize("folder", ["bin", "a b%n$HOME"])
def test_systemd_understands_every_line(tmp_path: Path, folder: str) -> None:
    program = tmp_path / folder / "ecatd"
    program.parent.mkdir()
    for file in (program, program.with_name("ecatctl")):
        file.symlink_to(sys.executable)
    units = []
    for path, data in files(LOCAL, program).items():
        if path.name in (*ALL, WEB, ROS):
            unit = tmp_path / path.name.replace("@.", "@press.")
            unit.write_bytes(data)
            units.append(str(unit))
    assert len(units) == len(ALL) + 2
    command = ["systemd-analyze", "verify", "--man=no", *units]
    told = subprocess.run(command, capture_output=True, text=True, check=False).stderr
    assert not [line for line in told.splitlines() if "ecatd" in line], told


@needs_systemd
@pytest.mark.parametrize("unit", list(EXPOSURE))
def test_r41_exposure(tmp_path: Path, unit: str) -> None:
    copy = shutil.copy(UNITS / unit, tmp_path)
    command = ["systemd-analyze", "security", "--offline=yes", "--no-pager", copy]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    (found,) = re.findall(r"Overall exposure level .*: ([0-9.]+)", told)
    assert float(found) <= EXPOSURE[unit], told

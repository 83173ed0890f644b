"""A library is the same, byte for byte, whichever way its bus is described."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from conftest import Daemon, names, one_line_error, run_module

pytestmark = [pytest.mark.bus, pytest.mark.long]

CYCLE_TIME_US = 1000
"""The bus has the default of rigs and scans."""

ESI = (Path(__file__).parents[1] / "unit" / "esi_sample.py").read_text().split('"""')[3]
DEVICES = "AX2:0x00020001,0x1234:0x00020001,DI4"
RIG = """
name = "of ESI files"
[[slave]]
esi = "sample.xml"
type = "AX2"
revision = 0x00020001
[[slave]]
esi = "sample.xml"
type = "AX2"
revision = 0x00020001
serial = 77
[[slave]]
esi = "sample.xml"
type = "DI4"
"""
CONFIG = """
cycle_time_us = 2000
[gateway]
listen = []
[[domain]]
name = "fast"
[[domain]]
name = "slow"
divider = 4
slaves = [2]
[[signal]]
slave = 0
entry = "0x607A:00"
unit = "rad"
scale = 0.001
"""


def contents(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def alone(*arguments: str) -> None:
    """Runs `ecatctl` where no daemon is."""
    result = run_module("ecatd.cli", *arguments, env=dict(os.environ))
    assert result.returncode == 0, result.stderr


def test_troll(troll: Daemon, tmp_path: Path) -> None:
    scan = tmp_path / "bus.json"
    troll.ctl("generate", "Plant", str(tmp_path / "live"))
    live = contents(tmp_path / "live")
    said = troll.ctl("scan", "-o", str(scan)).stdout
    names(said, scan, troll.bus, "8 slaves", "142 inputs", "14 outputs")
    alone("generate", "Plant", str(tmp_path / "saved"), "--from", str(scan))
    assert contents(tmp_path / "saved") == live
    alone("generate", "Plant", str(tmp_path / "rig"), "--from", "troll", "--bus", troll.bus)
    assert contents(tmp_path / "rig") == live
    inside = tmp_path / "live" / "Plant" / "Resources" / "bus.json"
    alone("generate", "Plant", str(tmp_path / "again"), "--from", str(inside))
    assert contents(tmp_path / "again") == live
    assert b"serial" in scan.read_bytes()
    assert b"serial" not in inside.read_bytes()
    assert str(tmp_path).encode() not in inside.read_bytes()


def test_devices_of_esi_files(start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    esi, rig, config = (tmp_path / name for name in ("sample.xml", "rig.toml", "ecat.toml"))
    esi.write_text(ESI, "utf-8")
    rig.write_text(RIG)
    config.write_text(CONFIG)
    daemon = start_daemon(str(rig), config=CONFIG)
    name = ("--bus", daemon.bus, "--config", str(config))
    daemon.ctl("generate", "Axes", str(tmp_path / "live"))
    live = contents(tmp_path / "live")
    assert b'"scale": 0.001' in live["Axes/Resources/bus.json"]
    daemon.ctl("scan", "-o", str(tmp_path / "bus.json"))
    alone("generate", "Axes", str(tmp_path / "saved"), "--from", str(tmp_path / "bus.json"))
    assert contents(tmp_path / "saved") == live
    alone("generate", "Axes", str(tmp_path / "rig"), "--from", str(rig), *name)
    assert contents(tmp_path / "rig") == live
    alone(
        *("generate", "Axes", str(tmp_path / "esi"), "--from", str(esi), "--devices", DEVICES),
        *name,
    )
    assert contents(tmp_path / "esi") == live


AXIS = "vendor = 0xFFFF\nproduct = 0x1234\n"
EXPECTED = f"""{CONFIG}
[[slave]]
position = 0
name = "lift"
{AXIS}revision_min = 0x00010000
[[slave]]
alias = 7
name = "ends"
vendor = 0xFFFF
product = 0x5678
[[slave]]
position = 1
{AXIS}revision = 0x00020001
"""


def test_slaves_of_a_configuration(tmp_path: Path) -> None:
    """A configuration and ESI files are enough: no bus, no rig and no list."""
    esi, rig, config = (tmp_path / name for name in ("sample.xml", "rig.toml", "ecat.toml"))
    esi.write_text(ESI, "utf-8")
    rig.write_text(RIG + "alias = 7\n")
    config.write_text(EXPECTED)
    given = ("--bus", "desk", "--config", str(config))
    alone("generate", "Axes", str(tmp_path / "rig"), "--from", str(rig), *given)
    alone("generate", "Axes", str(tmp_path / "esi"), "--from", str(esi), *given)
    found = contents(tmp_path / "esi")
    assert {"Axes/Lift.mo", "Axes/Ends.mo"} <= set(found)
    assert found == contents(tmp_path / "rig")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("position = 1", "position = 2", "no [[slave]] has position 1 | has 2 | --devices"),
        (EXPECTED, CONFIG, "no [[slave]] table | --devices"),
        (AXIS + "revision = 0x00020001", 'name = "turn"', "turn | vendor and product"),
        ("0x00010000", "0x00030000", "'0x00001234' | revision 0x00030000 or newer | ESI files"),
        ("0x5678", "0x5679", "'0x00005679' | ESI files"),
        ("product = 0x5678", "product = bad", "{config}:"),
    ],
)
def test_configurations_that_do_not_say_it_all(
    old: str, new: str, message: str, tmp_path: Path
) -> None:
    esi, config = tmp_path / "sample.xml", tmp_path / "ecat.toml"
    esi.write_text(ESI, "utf-8")
    assert old in EXPECTED
    config.write_text(EXPECTED.replace(old, new))
    refused = run_module("ecatd.cli", "scan", "--from", str(esi), "--config", str(config))
    assert refused.returncode == 2
    wanted = [word.format(config=config) for word in message.split(" | ")]
    names(one_line_error(refused.stderr, "ecatctl"), config, *wanted)


def test_a_configuration_names_the_bus_unless_the_user_does(tmp_path: Path) -> None:
    config = tmp_path / "ecat.toml"
    config.write_text('bus = "plant"\n')
    given = ("--from", "line:2", "--config", str(config))
    env = {key: value for key, value in os.environ.items() if key != "ECATD_BUS"}

    def said(*arguments: str) -> str:
        result = run_module("ecatd.cli", *arguments, env=env)
        assert result.returncode == 0, result.stderr
        return result.stdout

    assert json.loads(said("scan", *given))["name"] == "plant"
    assert json.loads(said("scan", *given, "--bus", "desk"))["name"] == "desk"
    assert json.loads(said("scan", *given[:2]))["name"] == "ecat0"
    other = run_module("ecatd.cli", "scan", *given, env={**env, "ECATD_BUS": "other"})
    assert json.loads(other.stdout)["name"] == "other"
    assert 'bus = "plant"' in said("config", "init", *given)
    said("generate", "Plant", str(tmp_path), *given)
    assert "EtherCAT bus plant" in (tmp_path / "Plant" / "package.mo").read_text()
    assert "bus plant with 2 slaves" in said("config", "check", str(config), *given[:2])
    # Commands that ask a daemon ask that of the file.
    for command in ("config check", "config diff", "startup verify --config"):
        refused = run_module("ecatd.cli", *command.split(), str(config), env=env)
        assert refused.returncode != 0
        names(one_line_error(refused.stderr, "ecatctl"), "'plant'")
    report = run_module("ecatd.cli", "doctor", "--config", str(config), env=env).stdout
    assert "plant" in report


def test_a_rig_is_read_beside_a_daemon_that_serves_the_name(troll: Daemon) -> None:
    before = troll.ctl_json("stats")["cycles"]
    scan = json.loads(troll.ctl("scan", "--from", "line:3").stdout)
    assert (scan["name"], len(scan["slaves"])) == (troll.bus, 3)
    assert troll.ctl_json("stats")["cycles"] > before
    assert len(json.loads(troll.ctl("scan").stdout)["slaves"]) == 8


def test_a_scan_in_json_and_under_another_name(troll: Daemon, tmp_path: Path) -> None:
    file = tmp_path / "bus.json"
    said = troll.ctl_json("scan", "-o", str(file))
    assert said == {
        "schema": 1,
        "bus": troll.bus,
        "file": str(file),
        "fingerprint": json.loads(file.read_text())["fingerprint"],
        "slaves": 8,
        "inputs": 142,
        "outputs": 14,
        "outdated": [],
    }
    assert troll.ctl("scan").stdout == file.read_text()
    renamed = json.loads(troll.ctl("scan", "--from", str(file), "--bus", "other").stdout)
    assert renamed["name"] == "other"
    kept = run_module("ecatd.cli", "scan", "--from", str(file)).stdout
    assert kept == file.read_text()


@pytest.mark.parametrize(
    ("arguments", "message", "status"),
    [
        ("--from nothing", "rig | 'nothing' | ecatsim rigs", 2),
        ("--from ./nothing", "no file | './nothing'", 2),
        ("--from {readme}", "{readme} | saved scan", 2),
        ("--from {esi}", "ESI file | --devices", 2),
        ("--from {esi} --devices DI4,DI4", "--devices: | DI4 (position 0) | port 1", 2),
        ("--from {esi} --devices DI5", "no device | 'DI5'", 2),
        ("--from {rig}", "{rig}:2: colour: | not a key", 2),
        ("--from empty", "no EtherCAT slave answers", 3),
        ("--from troll --from troll", "ESI files", 2),
        ("--from troll --devices DI4", "--devices | ESI files", 2),
        ("--devices DI4", "--devices | ESI files", 2),
        ("--from troll --config {rig}", "{rig}:1: name: | not a key", 2),
        ("--from {scan} --config {rig}", "--config | rig | ESI files", 2),
        ("--from {scan}", "{scan}: slaves[0] | 'vendor'", 2),
        ("--from {good} --bus a/b", "'a/b' | bus name | HOST/BUS | --connect", 2),
        ("--from {good} --bus a!b", "'a!b' | bus name | 31", 2),
        ("--from troll --connect tcp/localhost:1", "--from | --connect", 2),
    ],
)
def test_wrong_sources(tmp_path: Path, arguments: str, message: str, status: int) -> None:
    files = {name: tmp_path / name for name in ("sample.xml", "rig.toml", "bus.json", "README")}
    files["sample.xml"].write_text(ESI, "utf-8")
    files["rig.toml"].write_text('name = "x"\ncolour = "red"\n')
    files["README"].write_text("x")
    files["bus.json"].write_text(
        '{"schema": 1, "name": "x", "cycle_time_us": 1000, '
        '"slaves": [{"position": 0, "name": "x", "product": 1, "revision": 1}]}'
    )
    esi, rig, scan, readme = map(str, files.values())
    good = tmp_path / "good.json"
    good.write_text('{"schema": 1, "name": "x", "cycle_time_us": 1000, "slaves": []}')
    made = {"esi": esi, "rig": rig, "scan": scan, "readme": readme, "good": good}
    filled, wanted = arguments.format(**made), message.format(**made)
    result = run_module("ecatd.cli", "generate", "P", str(tmp_path / "out"), *filled.split())
    names(one_line_error(result.stderr, "ecatctl"), *wanted.split(" | "))
    assert result.returncode == status
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("rig", "error"),
    [
        ('name = "x"\ncolour = "red"\n', {"name": "config", "line": 2}),  # says the simulator
        ('name = "x"\n', {"name": "unreachable"}),  # says the bus server
    ],
)
def test_describe_says_for_programs_why_it_has_failed(
    tmp_path: Path, rig: str, error: dict[str, Any]
) -> None:
    (tmp_path / "rig.toml").write_text(rig)
    command = ("--describe", "--simulate", str(tmp_path / "rig.toml"))
    result = run_module("ecatd.service", *command)
    said = json.loads(result.stdout)["error"]
    assert error.items() <= said.items()
    assert said["message"] in result.stderr
    assert said.get("file", command[-1]) == command[-1]


def test_a_scan_replaces_a_file_as_a_whole(tmp_path: Path) -> None:
    target, link = tmp_path / "target.json", tmp_path / "link.json"
    target.write_text("before")
    target.chmod(0o640)
    link.symlink_to(target)
    alone("scan", "--from", "line:1", "-o", str(link))
    assert link.is_symlink()
    assert json.loads(target.read_text())["schema"] == 1
    assert target.stat().st_mode & 0o777 == 0o640
    result = run_module("ecatd.cli", "scan", "--from", "line:1", "-o", str(tmp_path / "no" / "x"))
    assert result.returncode == 7
    names(one_line_error(result.stderr, "ecatctl"), tmp_path / "no", "No such file")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link.json", "target.json"]

"""`ecatctl startup`: parameters of the configuration against the live slave, and captured ones."""

import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon, names, one_line_error
from ecatd.config import read_config
from ecatsim.control import Simulator

pytestmark = pytest.mark.bus

ESI = (Path(__file__).parents[1] / "unit" / "esi_sample.py").read_text().split('"""')[3]
TABLES = """
[[slave.startup]]
object = "0x2000:03"
type = "int16"
value = 7
[[slave.startup]]
object = "0x2001:03"
hex = "05 00"
[[slave.startup]]
object = "0x2000:04"
type = "float"
value = 2.5
"""


@pytest.fixture
def machine(start_daemon: Callable[..., Daemon], tmp_path: Path) -> Callable[[str], Daemon]:
    def start(tables: str) -> Daemon:
        esi, rig = tmp_path / "axis.xml", tmp_path / "rig.toml"
        esi.write_text(ESI)
        device = f'[[slave]]\nesi = "{esi}"\ntype = "AX2"\nrevision = 0x00020001\n'
        rig.write_text(f'name = "m"\n[[slave]]\ndevice = "EK1100"\n{device}')
        axis = '[[slave]]\nposition = 1\nname = "axis"\n'
        return start_daemon(str(rig), config=f"[gateway]\nlisten = []\n{axis}{tables}")

    return start


def test_parameters_are_verified(machine: Callable[[str], Daemon]) -> None:
    daemon = machine(TABLES)
    shown = daemon.ctl("startup", "verify").stdout.splitlines()
    names(shown[1], "axis (AX2)", "0x2000:03", "7", "as configured")
    names(shown[2], "0x2001:03", "05 00", "as configured")
    names(shown[3], "0x2000:04", "2.5", "cannot be read", "0x06010001")  # write only
    daemon.ctl("sdo-write", "axis", "0x2000", "3", "8")
    changed = daemon.ctl("startup", "verify", "axis", check=False)
    assert changed.returncode == 7
    names(changed.stdout.splitlines()[1], "7", "8", "different")
    daemon.ctl("state", "axis", "INIT", "--yes")
    daemon.ctl("state", "axis", "OP")  # it is told again
    rows = daemon.ctl_json("startup", "verify")["parameters"]
    assert [row["result"] for row in rows[:2]] == 2 * ["as configured"]
    names(daemon.ctl("startup", "verify", "EK1100").stdout, "no", "slave 0 (EK1100)")


def test_what_a_slave_may_refuse_is_no_difference(machine: Callable[[str], Daemon]) -> None:
    tables = "".join(
        f'[[slave.startup]]\nobject = "{address}"\ntype = "int16"\nvalue = 7\noptional = true\n'
        for address in ("0x1018:01", "0x5555:00", "0x2000:03")
    )
    daemon = machine(tables)
    fixed, absent, taken = (
        row["result"] for row in daemon.ctl_json("startup", "verify")["parameters"]
    )
    names(fixed, "optional", "different")
    names(absent, "optional", "not verified", "0x06020000")
    assert taken == "as configured"
    assert daemon.ctl("startup", "verify").returncode == 0


@pytest.mark.long
def test_what_cannot_be_verified_is_no_success(
    machine: Callable[[str], Daemon], tmp_path: Path
) -> None:
    daemon = machine(TABLES)
    file = tmp_path / "more.toml"
    more = '[[slave]]\nposition = 2\nname = "gone"\nvendor = 2\nproduct = 3\n'
    file.write_text(daemon.config_file.read_text() + more + TABLES)
    missing = daemon.ctl("startup", "verify", "--config", str(file), check=False)
    assert missing.returncode == 7
    names(one_line_error(missing.stderr, "ecatctl"), "3 of gone")
    assert daemon.ctl("startup", "verify", "axis", "--config", str(file)).returncode == 0
    with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        simulator.faults.power_off(1)
        for arguments in ((), ("axis",), ("--json",)):
            silent = daemon.ctl("startup", "verify", *arguments, check=False)
            assert silent.returncode == 7
            names(one_line_error(silent.stderr, "ecatctl"), "3 of slave 1 (axis, AX2)")
            assert silent.stdout.count("not verified") == 3
    assert daemon.ctl("startup", "verify", "EK1100").returncode == 0


def test_only_what_a_slave_in_op_has_is_compared(machine: Callable[[str], Daemon]) -> None:
    """One object gets another value on the way down, and two values on the way up."""
    rows = (("SP", 1), ("SO", 3), ("PS", 2), ("OS", 4))
    tables = "".join(
        f'[[slave.startup]]\nobject = "0x2000:03"\ntype = "int16"\nvalue = {value}\n'
        f'transition = "{name}"\n'
        for name, value in rows
    )
    daemon = machine(tables)
    shown = daemon.ctl_json("startup", "verify")["parameters"]
    assert [row["has"] for row in shown] == 4 * ["3"]
    assert shown[1]["result"] == "as configured"
    for row, (name, _) in zip(shown, rows, strict=True):
        if name != "SO":
            names(row["result"], name, "OP")
    daemon.ctl("sdo-write", "axis", "0x2000", "3", "4")
    assert daemon.ctl("startup", "verify", check=False).returncode == 7


def test_what_differs_from_the_defaults_is_captured(
    machine: Callable[[str], Daemon], tmp_path: Path
) -> None:
    scaled = '[[slave.startup]]\nobject = "0x2000:03"\ntype = "int16"\nvalue = 20\nunit = "V"\n'
    meaning = '[[signal]]\nslave = 1\nentry = "0x2000:03"\nunit = "V"\nscale = 0.5\n'
    daemon = machine(scaled + meaning)
    read = daemon.ctl_json("sdo-read", "axis", "0x2000", "3")
    assert (read["value"], read["unit"], read["scale"]) == (40, "V", 0.5)
    daemon.ctl("sdo-write", "axis", "0x2000", "3", "21 V")
    assert daemon.ctl_json("sdo-read", "axis", "0x2000", "3")["value"] == 42
    daemon.ctl("sdo-write", "axis", "0x2000", "3", "50")
    daemon.ctl("sdo-write", "axis", "0x2001", "1", "9")
    file = tmp_path / "captured.toml"
    said = daemon.ctl("startup", "capture", "axis", "--esi", str(tmp_path), "-o", str(file)).stdout
    names(said, str(file), "2 parameters")
    kept = daemon.ctl("startup", "capture", "axis", "-o", str(daemon.config_file), check=False)
    assert kept.returncode == 7
    names(one_line_error(kept.stderr, "ecatctl"), str(daemon.config_file), "exists")
    tables = file.read_text()
    names(tables, "slave 1 (axis, AX2)", "Limit; default -2", "axis.xml", "# 25 V")
    itself = daemon.ctl("startup", "capture", "axis").stdout
    plain = [
        [line for line in text.splitlines() if not line.startswith("# ")]
        for text in (itself, tables)
    ]
    assert plain[0] == plain[1], "the slave gives the same defaults"
    names(itself, "# 1 object", "write only")
    assert daemon.ctl_json("startup", "capture", "axis")["write_only"] == ["0x2000:04"]
    config = read_config(tomllib.loads(f"[[slave]]\nposition = 1\n{tables}"))
    found = [(p.object, p.data) for p in config.slave[0].startup]
    assert found == [("0x2000:03", b"\x32\0"), ("0x2001:01", b"\x09\0")]
    assert daemon.stop() == 0

    daemon = machine(tables)  # a slave that is fresh from its box gets them
    assert daemon.ctl_json("sdo-read", "axis", "0x2000", "3")["value"] == 50
    assert daemon.ctl("startup", "verify").stdout.count("as configured") == 2


@pytest.mark.long
def test_objects_that_a_slave_would_refuse_are_found_beforehand(
    machine: Callable[[str], Daemon], tmp_path: Path
) -> None:
    daemon = machine("")
    file = tmp_path / "wrong.toml"
    tables = (
        '[[slave.startup]]\nobject = "0x2000:03"\ntype = "int16"\nvalue = 101\n'
        '[[slave.startup]]\nobject = "0x2009:00"\ntype = "int16"\nvalue = 1\n'
        '[[slave.startup]]\nobject = "0x200A:00"\ntype = "int16"\nvalue = 1\noptional = true\n'
    )
    file.write_text(daemon.config_file.read_text() + tables)
    for more in ((), ("--esi", str(tmp_path / "axis.xml"))):
        found = daemon.ctl("config", "check", str(file), *more, check=False)
        assert found.returncode == 7
        limit, missing = [line for line in found.stdout.splitlines() if "other objects" in line]
        names(limit, f"{file}:", "slave 1 (axis, AX2)", "0x2000:03", "-10", "100", "101")
        names(missing, "slave[0].startup[1]", "slave 1 (axis, AX2)", "no object", "0x2009:00")
        (optional,) = [line for line in found.stdout.splitlines() if line.startswith("note: ")]
        names(optional, f"{file}:", "slave[0].startup[2]", "no object", "0x200A:00", "optional")
    with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        simulator.faults.mailbox(1, "stuck")
        other = '[[slave.startup]]\nobject = "0x2001:03"\nhex = "05 00"\n'  # not asked for before
        file.write_text(daemon.config_file.read_text() + other)
        (warned,) = daemon.ctl_json("config", "check", str(file))["warnings"]
    names(warned, "slave 1 (axis, AX2)", "not checked", "--esi")


PROFILE = """
[[device]]
description = "bench axis"
has = ["0x6040:00"]
[[device.entry]]
index = 0x6083
unit = "rad/s2"
scale = 0.01
"""
PHYSICAL = """
profiles = ["FOLDER"]
[gateway]
listen = []
[[slave]]
position = 0
name = "axis"
[[slave.startup]]
object = "0x6083:00"
type = "uint32"
value = 1.506
unit = "rad/s2"
[[slave.startup]]
object = "0x6081:00"
type = "uint32"
value = 3.141592653589793
unit = "rad/s"
transition = "SO"
[[signal]]
slave = "axis"
entry = "0x6081:00"
unit = "rpm"
scale = 0.5
"""


def test_physical_values_become_raw(start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    """One object is known by a profile, one by a table; both are outside of the process data."""
    (tmp_path / "axis.toml").write_text(PROFILE)
    config = PHYSICAL.replace("FOLDER", str(tmp_path))
    rig = tmp_path / "rig"
    rig.mkdir()
    rig = rig / "rig.toml"
    rig.write_text('name = "m"\n[[slave]]\ndevice = "CiA402"\n')
    daemon = start_daemon(str(rig), config=config)
    raw = [daemon.ctl_json("sdo-read", "axis", at)["value"] for at in ("0x6083", "0x6081")]
    assert raw == [151, 60], "rounded to the nearest raw value; 30 rpm are pi rad/s"
    shown = daemon.ctl("startup", "verify").stdout.splitlines()
    names(shown[1], "0x6083:00", "151 (1.51 rad/s2)", "as configured")
    names(shown[2], "0x6081:00", "60 (30 rpm)", "as configured")
    daemon.ctl("sdo-write", "axis", "0x6081", "0", "61")
    changed = daemon.ctl("startup", "verify", check=False).stdout
    names(changed, "60 (30 rpm)", "61 (30.5 rpm)", "different")
    assert daemon.stop() == 0
    for wrong, tokens in (
        (
            ("0x6083:00", "0x6084:00"),
            ["slave 0 (CiA402)", "0x6084:00", "1.506 rad/s2", "[[signal]]"],
        ),
        (("1.506", "-1"), ["slave 0 (CiA402)", "-1 rad/s2", "-100", "UNSIGNED32"]),
        (('"rad/s2"', '"V"'), ["slave 0 (CiA402)", "0x6083:00 is in rad/s2", "not in V"]),
    ):
        status, log = start_daemon(str(rig), config=config.replace(*wrong), ready=False).wait_end()
        assert status == 2, log
        names(one_line_error(log, "ecatd"), *tokens)


WRONG = [
    ("capture", 2, ["SLAVE"]),
    ("capture EK1100", 7, ["slave 0 (EK1100)", "CoE"]),
    ("verify -o x", 2, ["capture"]),
    ("capture EK1100 --esi FOLDER", 7, ["slave 0 (EK1100)", "0x044C2C52"]),
    ("capture axis --esi nowhere.xml", 2, ["nowhere.xml"]),
    ("verify nobody", 7, ["'nobody'"]),
]


def test_wrong_usage_says_what_to_do(machine: Callable[[str], Daemon], tmp_path: Path) -> None:
    daemon = machine(TABLES)
    for arguments, status, tokens in WRONG:
        given = arguments.replace("FOLDER", str(tmp_path)).split()
        result = daemon.ctl("startup", *given, check=False)
        assert result.returncode == status, arguments
        names(one_line_error(result.stderr, "ecatctl"), *tokens)

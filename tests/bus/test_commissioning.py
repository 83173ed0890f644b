"""A bus that the configuration expects: names, differences, and what happens with them."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from conftest import Daemon, names, one_line_error, wait_for
from ecatd.base.errors import StateError
from ecatd.config import load_config
from ecatsim.control import Simulator

pytestmark = pytest.mark.bus

COUPLER = "vendor = 0x2\nproduct = 0x044c2c52\n"
OUTPUTS = "vendor = 0x2\nproduct = 0x07d83052\n"  # EL2008
INPUTS = "vendor = 0x2\nproduct = 0x03f03052\n"  # EL1008
ANALOG = "vendor = 0x2\nproduct = 0x0bc03052\n"  # EL3008
CONFIG = f"""
[gateway]
listen = []
[expected]
unlisted = false
policy = "POLICY"
[[slave]]
position = 0
type = "EK1100"
{COUPLER}
[[slave]]
position = 1
name = "infeed"
type = "EL2008"
{OUTPUTS}
revision = 0x00100000
[[slave]]
position = 2
type = "EL1008"
{INPUTS}
[[slave]]
position = 3
name = "pressures"
{ANALOG}
[[outputs.safe]]
slave = "infeed"
value = "hold"
[[signal]]
slave = "pressures"
entry = "0x6000:11"
name = "supply"
unit = "bar"
scale = 0.01
[[domain]]
slaves = []
[[domain]]
name = "slow"
divider = 2
slaves = ["pressures"]
"""
AS_EXPECTED = ["EK1100", "EL2008", "EL1008", "EL3008"]

REGISTERS = (0x0400, 0x0410, 0x0420, 0x0814)
"""Divider, times of both watchdogs, and the control of sync manager 2."""

Start = Callable[..., Daemon]


@pytest.fixture
def start(start_daemon: Callable[..., Daemon], tmp_path: Path) -> Start:
    """Starts a daemon with a configuration on slaves of these kinds."""

    def start(
        kinds: list[str],
        policy: str = "strict",
        config: str = CONFIG,
        ready: bool = True,
        **more: str,
    ) -> Daemon:
        rig = tmp_path / "rig.toml"
        rows = [
            f'[[slave]]\ndevice = "{kind}"\n{more.get(f"n{n}", "")}\n'
            for n, kind in enumerate(kinds)
        ]
        rig.write_text('name = "machine"\n' + "".join(rows))
        return start_daemon(str(rig), config=config.replace("POLICY", policy), ready=ready)

    return start


def test_slaves_have_names(start: Start) -> None:
    daemon = start(AS_EXPECTED)
    assert "not as expected" not in daemon.log
    rows = daemon.slave_rows("slaves")
    assert [row["given_name"] for row in rows] == ["", "infeed", "", "pressures"]
    assert [row["domain_name"] for row in rows] == ["", "", "", "slow"]
    shown = daemon.ctl("slaves").stdout
    names(shown, "infeed (EL2008)", "pressures (EL3008)", "EK1100")
    names(daemon.ctl("state", "pressures").stdout, "pressures (EL3008)", "OP")
    assert "EK1100" not in daemon.ctl("state", "pressures").stdout
    names(daemon.ctl("pdos", "EL1008").stdout, "EL1008", "TxPDO")
    names(daemon.ctl("shm", "infeed").stdout, "infeed")
    assert json.loads(daemon.ctl("sdo-read", "pressures", "0x1018", "1", "--json").stdout)["value"]
    daemon.ctl("state", "infeed", "PREOP", "--yes")
    states = [row["text"] for row in daemon.slave_rows("state")]
    assert states == ["OP", "PREOP", "OP", "OP"]
    refused = daemon.ctl("sdo-read", "pressure", "0x1018", "1", check=False)
    assert refused.returncode == 7
    names(one_line_error(refused.stderr, "ecatctl"), "'pressure'", "'pressures'")
    with daemon.client() as client:
        supply = client.signal("pressures/supply")
        assert (supply.slave, supply.unit) == (3, "bar")
        assert client.signal("infeed/0x7000:01").slave == 1


def test_r07_a_wrong_bus_does_not_start(start: Start) -> None:
    daemon = start(["EK1100", "EL2004", "EL2008", "EL3008"], ready=False)
    status, log = daemon.wait_end()
    assert status == 7
    missing, extra = (line for line in log.splitlines() if "bus not as expected" in line)
    names(missing, "error", "EL1008", "missing", "slave 2", "behind slave 1 (infeed)")
    names(extra, "error", "2 differences", "slave 1 (EL2004)", "extra", "[expected]")
    assert log.count("slave 1 (EL2004)") == 1, "it is said once"
    assert extra.endswith(one_line_error(log, "ecatd"))
    assert "not started" in daemon.status
    names(daemon.status, "2 differences", "slave 1 (EL2004)")


def test_a_tolerant_daemon_runs_the_others_with_their_own_tables(start: Start) -> None:
    daemon = start(["EK1100", "EL2004", "EL2008", "EL1008", "EL3008"], "tolerant")
    rows = daemon.slave_rows("slaves")
    assert [row["state"] for row in rows] == ["OP", "PREOP", "OP", "OP", "OP"]
    assert rows[1]["recovery"] == "unexpected"
    names(rows[1]["recovery_text"], "slave 1 (EL2004)", "takes no part")
    assert [row["given_name"] for row in rows] == ["", "", "infeed", "", "pressures"]
    (warning,) = [line for line in daemon.log.splitlines() if "not as expected" in line]
    names(warning, "warning", "slave 1 (EL2004)", "extra")
    names(daemon.log, "1 difference")
    wait_for(lambda: "slave 1 (EL2004) is extra" in daemon.status, daemon)
    names(daemon.status, "4 of 5 slaves in OP", "unexpected")
    with daemon.client() as client:
        assert client.signal("pressures/supply").slave == 4
        output = client.signal("infeed/0x7000:01")
        assert output.slave == 2
        assert not client.signals(1)
        client.claim([output], lease=30)
        output.raw = 1
        client.commit()
        client.wait(20)
    segment = Simulator(str(daemon.child_pid("ecatsim")))
    with daemon.client() as client, segment as simulator:
        output = client.signal("infeed/0x7000:01")

        def without_owner() -> bool:
            client.wait()
            client.sample()
            return client.output(output).owner is None

        wait_for(without_owner, daemon)
        client.wait(5)
        assert simulator.registers(2, 0x0F00, 1)[0] == 1  # to hold it is its safe value


def test_a_new_configuration_keeps_the_tables_of_slaves_that_take_no_part(
    start: Start, tmp_path: Path
) -> None:
    drive = "vendor = 0xFFFF\nproduct = 0x402\n"
    config = f"""
[gateway]
listen = []
[expected]
unlisted = false
policy = "tolerant"
[[slave]]
position = 0
{COUPLER}
[[slave]]
position = 1
name = "axis"
{drive}
[[slave.startup]]
object = "0x6065:00"
type = "uint32"
value = 4321
[[slave]]
position = 2
name = "island"
vendor = 0xFFFF
product = 0xE10
[[slave.module]]
slot = 1
ident = 0x208
[[slave]]
position = 3
name = "stop"
{INPUTS}
[[outputs.safe]]
slave = "axis"
value = "quick_stop"
"""
    kinds = ["EK1100", "ModularIO", "EL1008", "CiA402"]
    modules = 'parameters = { modules = "DI8, -, AI2" }'
    daemon = start(kinds, config=config, n1=modules)
    rows = daemon.slave_rows("slaves")
    assert [row["state"] for row in rows] == ["OP", "PREOP", "OP", "PREOP"]
    file = tmp_path / "new.toml"
    daemon.ctl("config", "init", "-o", str(file))
    known, written = load_config(daemon.config_file), load_config(file)
    assert [slave.name for slave in written.slave] == ["EK1100", "island", "stop", "axis"]
    assert written.slave[3].startup == known.slave[1].startup
    assert written.outputs.safe == [replace(known.outputs.safe[0], slave=3)]
    assert [(item.slot, item.ident) for item in written.slave[1].module] == [(1, 0x108), (3, 0x302)]
    names(daemon.ctl("config", "check", str(file)).stdout, "slave 3 (CiA402)", "takes no part now")
    assert daemon.stop() == 0
    assert "not as expected" not in start(kinds, config=file.read_text(), n1=modules).log


def test_a_slave_with_another_revision_takes_no_part(start: Start) -> None:
    daemon = start(AS_EXPECTED, "tolerant", CONFIG.replace("0x00100000", "0x00110000"))
    rows = daemon.slave_rows("slaves")
    assert [row["recovery"] for row in rows] == ["", "unexpected", "", ""]
    names(rows[1]["recovery_text"], "0x00100000", "0x00110000")
    with daemon.client() as client, pytest.raises(StateError):
        client.signal("infeed/0x7000:01")


def test_a_missing_slave_is_tolerated(start: Start) -> None:
    daemon = start(["EK1100", "EL2008", "EL1008"], "tolerant")
    wait_for(lambda: {row["state"] for row in daemon.slave_rows("slaves")} == {"OP"}, daemon)
    names(daemon.log, "pressures", "missing", "slave 3", "behind slave 2 (EL1008)")


def test_an_alias_finds_a_slave(start: Start) -> None:
    config = """
[gateway]
listen = []
[[slave]]
alias = 300
name = "spindle"
[[slave.startup]]
object = "0x6065:00"
type = "uint32"
value = 4711
"""
    for kinds, place in ((["EK1100", "CiA402", "CiA402"], 2), (["CiA402", "EK1100"], 0)):
        daemon = start(kinds, "", config, **{f"n{place}": "alias = 300"})
        assert daemon.slave_rows("slaves")[place]["given_name"] == "spindle"
        assert daemon.ctl_json("sdo-read", "spindle", "0x6065")["value"] == 4711
        assert daemon.stop() == 0
    daemon = start(["EK1100", "CiA402"], "", config, ready=False)
    status, log = daemon.wait_end()
    assert status == 7
    names(log, "spindle", "missing", "station alias 300")


WATCHDOGS = """
[gateway]
listen = []
[[slave]]
position = 1
watchdog_ms = 250.5
pdi_watchdog_ms = 30
[[slave]]
position = 2
vendor = 2
product = 0x0fa43052
watchdog_ms = WATCHDOG
"""


def test_watchdogs_are_set_and_checked(start: Start) -> None:
    kinds = ["EK1100", "EL2008", "EL4004"]
    daemon = start(kinds, "", WATCHDOGS.replace("WATCHDOG", "40"))
    rows = daemon.slave_rows("slaves")
    assert [row["watchdog_ms"] for row in rows] == [None, 250.5, 40]
    segment = Simulator(str(daemon.child_pid("ecatsim")))

    def registers() -> list[list[int]]:
        return [
            [int.from_bytes(simulator.registers(slave, at, 2), "little") for at in REGISTERS]
            for slave in (1, 2)
        ]

    with segment as simulator:
        assert [row[:3] for row in registers()] == [[2498, 300, 2505], [2498, 1000, 400]]
        assert registers()[1][3] & 0x40, "its EEPROM leaves the watchdog off"
        before = len(daemon.log)  # its short watchdog may have expired on a busy machine
        simulator.faults.power_off(2)
        wait_for(lambda: "1 slave missing" in daemon.log[before:], daemon)
        before = len(daemon.log)
        simulator.faults.power_on(2)
        wait_for(lambda: "slave 2 (EL4004): back in OP" in daemon.log[before:], daemon)
        assert registers()[1][:3] == [2498, 1000, 400]
        assert registers()[1][3] & 0x40


@pytest.mark.long
def test_outputs_without_a_watchdog_are_a_decision(start: Start) -> None:
    kinds = ["EK1100", "EL2008", "EL4004"]
    daemon = start(kinds, "", WATCHDOGS.replace("WATCHDOG", "0"))
    assert "watchdog is off" not in daemon.log
    assert daemon.stop() == 0
    undecided = WATCHDOGS.replace("watchdog_ms = WATCHDOG", "")
    daemon = start(kinds, "", undecided, ready=False)
    status, log = daemon.wait_end()
    assert status == 2
    said = one_line_error(log, "ecatd")
    line = daemon.config_file.read_text().partition("position = 2")[0].count("\n")
    names(said, f"{daemon.config_file}:{line}", "slave[1].watchdog_ms", "slave 2 (EL4004)")
    names(said, "watchdog_ms = 100", "watchdog_ms = 0")
    daemon = start(kinds, "", "[gateway]\nlisten = []\n")
    names(daemon.log, "warning", "slave 2 (EL4004)", "watchdog_ms = 0")
    names(daemon.ctl("config", "init").stdout, "watchdog_ms = 0")

"""Optional slaves and hot-connect groups: they come and go while the rest of the bus runs."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from conftest import Daemon, names, one_line_error, run_module, wait_for
from ecatd import Client
from ecatd.client import Direction
from ecatd.description.bus_file import dump, load
from ecatd.shm.contract import Validity
from ecatsim.control import Simulator

pytestmark = pytest.mark.bus

RIG = """
name = "machine"
[[slave]]
device = "EK1100"
[[slave]]
device = "EL2008"
[[slave]]
device = "EL1008"
[[slave]]
device = "EK1122"
[[slave]]
device = "EK1100"
at = { slave = 3, port = 3 }
alias = 7
[[slave]]
device = "EL2004"
[[slave]]
device = "EL1018"
[[slave]]
device = "EK1100"
at = { slave = 3, port = 1 }
[[slave]]
device = "EL4004"
[[wire]]
from = { slave = 1, entry = "0x7000:01" }
to = { slave = 2, entry = "0x6000:01" }
[[wire]]
from = { slave = 5, entry = "0x7000:01" }
to = { slave = 6, entry = "0x6000:01" }
"""
AWAY = '[[fault]]\nkind = "break-link"\nslave = 4\n'
SLAVES = {
    "EK1100": 0x044C2C52,
    "EL2008": 0x07D83052,
    "EL1008": 0x03F03052,
    "EK1122": 0x04622C52,
    "EL2004": 0x07D43052,
    "EL1018": 0x03FA3052,
    "EL4004": 0x0FA43052,
}
KINDS = ["EK1100", "EL2008", "EL1008", "EK1122", "EK1100", "EL2004", "EL1018", "EK1100", "EL4004"]
OUTPUTS = ("EL2008", "EL2004", "EL4004")
TOOL = (4, 5, 6)
AWAY_STATES = ["OP"] * 4 + ["no answer"] * 3 + ["OP"] * 2


Start = Callable[..., Daemon]


def tables(kinds: list[str], optional: dict[int, str], more: str = "") -> str:
    """A configuration that expects these slaves; `optional` has further keys of some."""
    text = '[gateway]\nlisten = []\n[expected]\ndescription = "DESCRIPTION"\nunlisted = false\n'
    for position, kind in enumerate(kinds):
        text += f'[[slave]]\nposition = {position}\nname = "s{position}"\nvendor = 2\n'
        text += f"product = {SLAVES[kind]}\n{optional.get(position, '')}\n"
        text += "watchdog_ms = 500\n" if kind in OUTPUTS else ""
    return text + more


GROUP = tables(KINDS, dict.fromkeys(TOOL, 'group = "tool"'))


@pytest.fixture
def start(start_daemon: Callable[..., Daemon], tmp_path: Path) -> Start:
    """Starts a daemon on the rig; it has a description of the complete one."""

    def start(
        config: str, rig: str = RIG, describe: bool = True, ready: bool = True, whole: str = RIG
    ) -> Daemon:
        file, description = tmp_path / "rig.toml", tmp_path / "full.json"
        file.write_text(whole)
        run_module("ecatd.cli", "scan", "--from", str(file), "-o", str(description))
        file.write_text(rig)
        text = config.replace("DESCRIPTION", str(description) if describe else "")
        return start_daemon(str(file), config=text, ready=ready)

    return start


def states(daemon: Daemon) -> list[str]:
    return [row["text"] for row in daemon.ctl_json("state")["slaves"]]


def clock(daemon: Daemon, position: int) -> dict[str, Any]:
    """What `ecatctl dc` says of a slave."""
    rows: list[dict[str, Any]] = daemon.ctl_json("dc")["slaves"]
    return rows[position]


def wait_for_states(daemon: Daemon, wanted: list[str]) -> None:
    wait_for(lambda: states(daemon) == wanted, daemon)


class Plant:
    """A client that writes an output of a slave, which is wired to an input of another one."""

    def __init__(self, client: Client, output: str, entry: str) -> None:
        self.client = client
        self.output = client.signal(output, direction=Direction.OUTPUT)
        self.input = client.signal(entry, direction=Direction.INPUT)
        self._rounds = 0
        client.claim(self.output, lease=30)

    def arrives(self) -> bool:
        """Whether a new value of the output arrives, and both are valid meanwhile."""
        self._rounds += 1
        self.output.raw = value = self._rounds % 2
        self.client.commit()
        for _ in range(100):
            self.client.wait()
            self.client.sample()
            if self.input.raw == value and self.input.validity == Validity.VALID:
                return True
        return False


@pytest.mark.long
def test_a_group_comes_and_goes_while_the_others_run(start: Start) -> None:
    daemon = start(GROUP, RIG + AWAY)
    simulator = daemon.child_pid("ecatsim")
    assert states(daemon) == AWAY_STATES
    names(daemon.log, "6 slaves (and 3 optional, absent)")
    rows = daemon.slave_rows("slaves")
    assert [row["recovery"] for row in rows] == [""] * 4 + ["absent"] * 3 + [""] * 2
    for state in ("PREOP", "OP"):  # of all slaves: who is not there is not waited for
        daemon.ctl("state", state, "--yes")
    refused = daemon.ctl("state", "s5", "OP", check=False)
    assert refused.returncode == 7
    names(one_line_error(refused.stderr, "ecatctl"), "slave 5", "no answer")
    with daemon.client() as client, Simulator(str(simulator)) as rig:
        always = Plant(client, "s1/0x7000:01", "s2/0x6000:01")
        tool = Plant(client, "s5/0x7000:01", "s6/0x6000:01")
        assert [slave.optional for slave in client.slaves()] == [n in TOOL for n in range(9)]
        wait_for(always.arrives, daemon)
        assert tool.input.validity == Validity.INCOMPLETE
        for coming in range(3):
            rig.faults.heal_link(4)
            wait_for_states(daemon, ["OP"] * 9)
            # Nobody has claimed anew: what the model writes reaches the tool when it is there.
            wait_for(tool.arrives, daemon)
            wait_for(always.arrives, daemon)
            rig.faults.break_link(4)
            wait_for_states(daemon, AWAY_STATES)
            wait_for(always.arrives, daemon)
            assert [slave.absent for slave in client.slaves()] == [n in TOOL for n in range(9)]
            assert tool.input.validity != Validity.VALID
            wait_for(lambda: daemon.ctl("check", check=False).returncode == 0, daemon)
            if coming == 1:  # it also loses its power, and so its addresses
                for fault in (rig.faults.power_off, rig.faults.power_on):
                    for position in TOOL:
                        fault(position)
    assert daemon.log.count("for the first time, and in OP") >= 1
    assert "slave count changed" not in daemon.log, "that optional slaves leave is no fault"
    assert daemon.stop() == 0


@pytest.mark.long
def test_a_group_of_which_a_slave_is_missing_is_not_well(start: Start) -> None:
    daemon = start(GROUP)
    assert daemon.ctl("check").returncode == 0
    with Simulator(str(daemon.child_pid("ecatsim"))) as rig:
        rig.faults.break_link(5)
        wait_for_states(daemon, ["OP"] * 5 + ["no answer"] * 2 + ["OP"] * 2)
        wait_for(lambda: daemon.ctl("check", check=False).returncode == 1, daemon)
        found = daemon.ctl("check", check=False)
        names(found.stdout, "degraded", "7 of 7", "group tool", "slave 5", "slave 6")
        rig.faults.heal_link(5)
        wait_for(lambda: daemon.ctl("check", check=False).returncode == 0, daemon)


@pytest.mark.long
@pytest.mark.parametrize(("key", "of_rig"), [("alias", "alias"), ("identification", "device_id")])
def test_a_mark_finds_a_group_wherever_it_is_plugged_in(
    start: Start, key: str, of_rig: str
) -> None:
    """Its coupler has an alias or an identification, and its terminals stand behind that."""
    config = GROUP.replace('position = 4\nname = "s4"', f'name = "s4"\n{key} = 7')
    rig_file = RIG.replace("alias = 7", f"{of_rig} = 7")
    for position in (5, 6):
        config = config.replace(f"position = {position}\n", "")
    for now, before in ((4, 7), (5, 8)):
        config = config.replace(f"position = {before}\n", f"position = {now}\n")
    order = [f"s{n}" for n in (0, 1, 2, 3, 7, 8, 4, 5, 6)]
    daemon = start(config, rig_file + AWAY, whole=rig_file)
    assert [row["given_name"] for row in daemon.slave_rows()] == order
    with Simulator(str(daemon.child_pid("ecatsim"))) as rig:
        rig.faults.heal_link(4)
        wait_for_states(daemon, ["OP"] * 9)
    assert daemon.stop() == 0
    daemon = start(config, rig_file, whole=rig_file)
    assert [row["given_name"] for row in daemon.slave_rows()] == order
    assert states(daemon) == ["OP"] * 9
    if key == "alias":
        asked = daemon.ctl("alias", "s4", "8", check=False).stderr
        names(asked, "warning", "alias 7", "before the next start", "Nothing was done")
        names(daemon.ctl("alias", "s0", "7", check=False).stderr, "warning", "s4", "this alias")
    with Simulator(str(daemon.child_pid("ecatsim"))) as rig, daemon.client() as client:
        tool = Plant(client, "s5/0x7000:01", "s6/0x6000:01")
        for fault in (rig.faults.power_off, rig.faults.power_on):
            for position in TOOL:
                fault(position)
        wait_for_states(daemon, ["OP"] * 9)
        wait_for(tool.arrives, daemon)


def test_a_slave_of_which_nothing_is_known_gets_no_place(start: Start) -> None:
    daemon = start(GROUP, RIG + AWAY, describe=False)
    assert [row["given_name"] for row in daemon.slave_rows()] == [
        "s0",
        "s1",
        "s2",
        "s3",
        "s7",
        "s8",
    ]
    names(daemon.log, "optional slave s5", "`ecatctl scan -o FILE`")
    wait_for(lambda: daemon.slave_rows("state")[5]["text"] == "OP", daemon)


@pytest.mark.long
def test_another_device_in_its_place_is_left_alone(start: Start) -> None:
    daemon = start(GROUP, RIG + AWAY)
    with Simulator(str(daemon.child_pid("ecatsim"))) as rig:
        rig.faults.swap(5, "EL2008")
        rig.faults.heal_link(4)
        wait_for(lambda: "is in its place" in daemon.log, daemon)
        assert states(daemon)[5] == "no answer"
        assert states(daemon)[8] == "OP"


def test_two_tools_at_the_same_addresses_are_named(start: Start) -> None:
    """The first tool is unplugged but keeps its power, the second one comes in its place."""
    tool = 'alias = 7\n[[slave]]\ndevice = "EL2004"\n'
    rig_file = '[[slave]]\ndevice = "EK1122"\n'
    for port in (3, 1):
        rig_file += f'[[slave]]\ndevice = "EK1100"\nat = {{ slave = 0, port = {port} }}\n{tool}'
    optional = {1: 'alias = 7\ngroup = "tool"', 2: 'group = "tool"'}
    config = tables(["EK1122", "EK1100", "EL2004"], optional).replace("position = 1\n", "")
    config = config.replace("position = 2\n", "")
    second_away = '[[fault]]\nkind = "break-link"\nslave = 3\n'
    daemon = start(config, rig_file + second_away, whole=rig_file.rsplit("[[slave]]", 2)[0])
    with Simulator(str(daemon.child_pid("ecatsim"))) as rig:
        rig.faults.break_link(1)
        wait_for_states(daemon, ["OP", "no answer", "no answer"])
        rig.faults.heal_link(3)
        wait_for_states(daemon, ["OP"] * 3)
        rig.faults.heal_link(1)
        wait_for(lambda: "two devices answer" in daemon.log, daemon)
        (line,) = [line for line in daemon.log.splitlines() if "two devices answer" in line]
        names(line, "error", "slaves 1-2", "addresses")
        checked = daemon.ctl("check", check=False)
        assert checked.returncode == 1
        names(checked.stdout, "degraded", "two devices answer", "slaves 1-2")
        wire = daemon.ctl("rescan", check=False)
        assert wire.returncode == 7
        names(wire.stdout, "5 devices", "address of slave 2", "like place 4")
        before = len(daemon.log)
        rig.faults.break_link(1)
        wait_for(lambda: "and no others" in daemon.log[before:], daemon)
        wait_for(lambda: daemon.ctl("check", check=False).returncode == 0, daemon)
        wait_for_states(daemon, ["OP"] * 3)


@pytest.mark.long
def test_other_process_data_than_described(start: Start, tmp_path: Path) -> None:
    """A slave that has other PDOs now would write into the bytes of others."""
    other = tmp_path / "other"
    other.mkdir()
    rig = other / "rig.toml"
    rig.write_text(RIG)
    run_module("ecatd.cli", "scan", "--from", str(rig), "-o", str(other / "full.json"))
    bus = load(other / "full.json")
    del bus.slaves[5].outputs[-1]
    (other / "full.json").write_text(dump(bus))
    daemon = start(GROUP.replace("DESCRIPTION", str(other / "full.json")), RIG + AWAY)
    with Simulator(str(daemon.child_pid("ecatsim"))) as rig:
        rig.faults.heal_link(4)
        wait_for(lambda: "in the description of the bus" in daemon.log, daemon)
        assert states(daemon)[5] != "OP"


@pytest.mark.long
def test_a_bus_may_be_empty(start: Start) -> None:
    config = tables(KINDS, dict.fromkeys(range(9), "optional = true"))
    empty = RIG + '[[fault]]\nkind = "break-link"\nslave = 0\n'
    daemon = start(config, empty)
    names(daemon.log, "0 slaves (and 9 optional, absent)")
    assert [slave["recovery"] for slave in daemon.ctl_json("slaves")["slaves"]] == ["absent"] * 9
    with Simulator(str(daemon.child_pid("ecatsim"))) as rig:
        rig.faults.heal_link(0)
        wait_for_states(daemon, ["OP"] * 9)
    with daemon.client() as client:
        wait_for(Plant(client, "s5/0x7000:01", "s6/0x6000:01").arrives, daemon)


@pytest.mark.long
def test_a_wrong_description_is_named(start: Start, tmp_path: Path) -> None:
    (tmp_path / "bad.json").write_text("{}")
    daemon = start(GROUP.replace("DESCRIPTION", str(tmp_path / "bad.json")), ready=False)
    status, log = daemon.wait_end()
    assert status == 2
    names(one_line_error(log, "ecatd"), "expected.description", "bad.json", "`ecatctl scan -o`")


@pytest.mark.long
def test_clocks_of_a_group_follow_when_it_comes(start: Start) -> None:
    clocks = "[dc]\nenabled = true\nlock_us = 400.0\ntimeout_s = 30.0\n"
    daemon = start(GROUP + clocks)
    delay, behind = clock(daemon, 4)["dc_delay_ns"], clock(daemon, 7)["dc_delay_ns"]
    assert daemon.stop() == 0
    assert 0 < delay < behind
    daemon = start(GROUP + clocks, RIG + AWAY)
    assert (clock(daemon, 4)["gone"], clock(daemon, 4)["dc_delay_ns"]) == ("absent", None)
    (line,) = [line for line in daemon.ctl("dc").stdout.splitlines() if line.startswith("  4 ")]
    names(line, "absent")
    assert " ns" not in line
    assert clock(daemon, 7)["dc_delay_ns"] < behind - 200
    with Simulator(str(daemon.child_pid("ecatsim"))) as rig:
        rig.faults.heal_link(4)
        wait_for_states(daemon, ["OP"] * 9)
        assert rig.clocks()[7].delay_ns == clock(daemon, 7)["dc_delay_ns"]
    assert clock(daemon, 4)["dc_delay_ns"] == pytest.approx(delay, abs=100)
    assert clock(daemon, 7)["dc_delay_ns"] == pytest.approx(behind, abs=100)
    wait_for(lambda: clock(daemon, 4)["dc_difference_ns"] is not None, daemon)
    assert abs(clock(daemon, 4)["dc_difference_ns"]) < 100_000

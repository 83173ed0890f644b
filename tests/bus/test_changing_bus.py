"""The bus changes while it runs: it is compared with the expected one as at the start."""

import json
import struct
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from conftest import Daemon, names, one_line_error, run_module, wait_for
from ecatd.client.remote import Remote
from ecatd.operations.bus import Rescan
from ecatd.operations.frames import ReadFrames
from ecatd.shm.contract import Validity
from ecatsim.control import Simulator

pytestmark = pytest.mark.bus

KINDS = {
    "EK1100": 0x044C2C52,
    "EL2008": 0x07D83052,
    "EL1008": 0x03F03052,
    "EL3008": 0x0BC03052,
}
EXTRA = '[[slave]]\ndevice = "EL2004"\n[[fault]]\nkind = "break-link"\nslave = 4\n'
"""A terminal behind all others, whose cable is not plugged in yet."""
STUCK = EXTRA.replace("EL2004", "spares.py:Stuck")
"""The same with an EEPROM that never carries out a command."""
SPARES = """
from dataclasses import replace

from ecatsim.devices.beckhoff import EL2008


class Newer(EL2008):
    revision = 0x00110000


class Smaller(Newer):
    rx_pdos = EL2008.rx_pdos[:4]


class Older(EL2008):
    revision = 0x000F0000


class Numbered(EL2008):
    serial = 12


class Aliased(EL2008):
    alias = 3


class Stuck(EL2008):
    chip = replace(EL2008.chip, eeprom_read_us=3_600_000_000)
"""

Start = Callable[..., Daemon]


def config(policy: str = "strict", more: str = "", description: str = "") -> str:
    """A configuration that expects the slaves; `more` has further keys of the EL2008."""
    text = f'[gateway]\nlisten = []\n[recovery]\nretry_s = 0.5\n[expected]\npolicy = "{policy}"\n'
    text += f'unlisted = false\ndescription = "{description}"\n'
    for position, (kind, product) in enumerate(KINDS.items()):
        place = "" if kind == "EL2008" and "alias" in more else f"position = {position}\n"
        text += f'[[slave]]\n{place}type = "{kind}"\nvendor = 2\nproduct = {product}\n'
        text += more if kind == "EL2008" else ""
    return text


@pytest.fixture
def start(start_daemon: Start, tmp_path: Path) -> Start:
    """Starts a daemon on the expected slaves; `more` stands behind them in the rig."""

    def start(config: str, more: str = "", keys: str = "") -> Daemon:
        rig = tmp_path / "rig.toml"
        rows = [f'[[slave]]\ndevice = "{kind}"\n{keys * (kind == "EL2008")}' for kind in KINDS]
        rig.write_text('name = "machine"\n' + "".join(rows) + more)
        (tmp_path / "spares.py").write_text(SPARES)
        return start_daemon(str(rig), config=config)

    return start


def simulator_of(daemon: Daemon) -> Simulator:
    return Simulator(str(daemon.child_pid("ecatsim")))


def states(daemon: Daemon) -> list[str]:
    return [row["text"] for row in daemon.ctl_json("state")["slaves"]]


def differences(daemon: Daemon) -> list[dict[str, Any]]:
    """What `config check` says of the file with which the daemon was started."""
    found = daemon.ctl("config", "check", str(daemon.config_file), "--json", check=False)
    rows: list[dict[str, Any]] = json.loads(found.stdout)["differences"]
    assert found.returncode == (7 if rows else 0)
    return rows


def told(daemon: Daemon) -> list[str]:
    return [line for line in daemon.log.splitlines() if "bus not as expected" in line]


def removed(daemon: Daemon) -> str:
    """What was last told of slaves that do not answer any more."""
    return [line for line in daemon.log.splitlines() if "missing; check" in line][-1]


def events(daemon: Daemon) -> list[list[str]]:
    """The differences of each event about them."""
    found = daemon.ctl_json("events")["events"]
    return [event["differences"] for event in found if event["event"] == "expected_bus"]


# --- a device is added ---------------------------------------------------------------------------


@pytest.mark.long
def test_an_extra_slave_is_named_once_and_a_restart_is_not_advised(start: Start) -> None:
    daemon = start(config(), EXTRA)
    assert differences(daemon) == []
    with simulator_of(daemon) as rig:
        rig.faults.heal_link(4)
        wait_for(lambda: bool(told(daemon)), daemon)
        (line,) = told(daemon)
        names(line, "error", "slave 4 (EL2004)", "extra", "product 0x07D43052", "[[slave]] table")
        names(line, "restart", "refused", 'policy = "strict"')
        assert "slave count changed from 4 to 5" in daemon.log
        assert "restart ecatd to use" not in daemon.log
        (difference,) = differences(daemon)
        assert (difference["kind"], difference["strict"]) == ("extra", True)
        assert difference["text"] in line
        assert events(daemon) == [[difference["text"]]]
        wire = daemon.ctl("rescan", check=False)
        assert wire.returncode == 7
        names(wire.stdout, "new (EL2004)", "ecatctl config check FILE")
        wait_for(lambda: states(daemon) == ["OP"] * 4, daemon)
        # A cable that breaks is told by the number of slaves alone.
        rig.faults.break_link(2)
        wait_for(lambda: "slave count changed from 4 to 2" in daemon.log, daemon)
        names(removed(daemon), "restart", "refused", 'policy = "strict"')
        rig.faults.heal_link(2)
        wait_for(lambda: states(daemon) == ["OP"] * 4, daemon)
        rig.faults.break_link(4)
        wait_for(lambda: "the bus is as expected again" in daemon.log, daemon)
        assert differences(daemon) == []
        assert len(told(daemon)) == 1
        assert events(daemon) == [[difference["text"]], []]


@pytest.mark.long
def test_a_cable_that_breaks_is_no_difference_of_its_own(start: Start) -> None:
    daemon = start(config())
    with simulator_of(daemon) as rig:
        rig.faults.break_link(2)
        wait_for(lambda: "slave count changed from 4 to 2" in daemon.log, daemon)
        (difference,) = differences(daemon)
        assert (difference["kind"], difference["expected"]) == ("missing", [2, 3])
        rig.faults.heal_link(2)
        wait_for(lambda: states(daemon) == ["OP"] * 4, daemon)
    assert told(daemon) == []
    assert events(daemon) == []


@pytest.mark.long
def test_an_extra_slave_of_a_tolerant_bus(start: Start) -> None:
    daemon = start(config("tolerant"), EXTRA)
    with simulator_of(daemon) as rig:
        rig.faults.heal_link(4)
        wait_for(lambda: bool(told(daemon)), daemon)
    names(told(daemon)[0], "warning", "slave 4 (EL2004)", "extra", 'policy = "tolerant"')


@pytest.mark.long
@pytest.mark.parametrize("text", ["[gateway]\nlisten = []\n", config().replace("false", "true", 1)])
def test_a_slave_that_a_restart_would_use(start: Start, text: str) -> None:
    daemon = start(text, EXTRA)
    with simulator_of(daemon) as rig:
        rig.faults.heal_link(4)
        wait_for(lambda: "restart ecatd to use it" in daemon.log, daemon)
    (line,) = [line for line in daemon.log.splitlines() if "restart ecatd to use it" in line]
    names(line, "slave 4 (EL2004)", "vendor 0x00000002", "product 0x07D43052")
    assert told(daemon) == []


INSERTED = """
[[slave]]
device = "EK1122"
[[slave]]
device = "EK1100"
at = { slave = 0, port = 3 }
[[slave]]
device = "EL2008"
[[slave]]
device = "EK1100"
at = { slave = 0, port = 1 }
[[slave]]
device = "EL2008"
[[fault]]
kind = "break-link"
slave = 1
"""
"""Equal slaves at two cables, of which the first is not plugged in yet."""


def test_equal_slaves_that_are_inserted_are_the_new_ones(
    start_daemon: Start, tmp_path: Path
) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text(INSERTED)
    products = (0x04622C52, KINDS["EK1100"], KINDS["EL2008"])
    rows = [
        f"[[slave]]\nposition = {n}\nvendor = 2\nproduct = {product}\n"
        for n, product in enumerate(products)
    ]
    head = "[gateway]\nlisten = []\n[expected]\nunlisted = false\n"
    daemon = start_daemon(str(rig), config=head + "".join(rows))
    with simulator_of(daemon) as simulator:
        simulator.faults.heal_link(1)
        wait_for(lambda: len(told(daemon)) == 2, daemon)
        for line, new in zip(told(daemon), ("slave 1 (EK1100)", "slave 2 (EL2008)"), strict=True):
            names(line, new, "extra", "behind slave 0 (EK1122)")
        found = differences(daemon)
        assert [row["found"] for row in found] == [[1], [2]]
        wait_for(lambda: states(daemon) == ["OP"] * 3, daemon)


def test_a_scan_that_waits_for_an_eeprom_delays_no_request_and_is_shared(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    daemon = start(config("tolerant"), STUCK)
    monkeypatch.setenv("ECATD_RUNTIME_DIR", daemon.env["ECATD_RUNTIME_DIR"])

    def rescan() -> list[dict[str, Any]]:
        with Remote(daemon.bus) as other:
            devices: list[dict[str, Any]] = other.request(Rescan())["devices"]
        assert [item["vendor"] for item in devices] == [2, 2, 2, 2, None]
        return devices

    def is_under_way() -> bool:
        """Whether the EEPROM of the device is assigned to the master."""
        return rig.registers(4, 0x0500, 1) == b"\0"

    def an_sdo_is_answered_meanwhile() -> bool:
        scan, answered = pool.submit(rescan), False
        while not scan.done():
            if is_under_way():
                assert remote.sdo_read(3, 0x1018, 1).data
                answered |= is_under_way()
        scan.result()
        return answered

    def two_share_a_scan() -> bool:
        _, position = looks(remote, 0)
        first, second = [item.result() for item in [pool.submit(rescan) for _ in range(2)]]
        assert first == second
        return looks(remote, position)[0] == 2  # at the beginning and at the end

    with simulator_of(daemon) as rig, Remote(daemon.bus) as remote, ThreadPoolExecutor(2) as pool:
        rig.faults.heal_link(4)
        wait_for(lambda: "slave count changed from 4 to 5" in daemon.log, daemon)
        wait_for(lambda: not is_under_way(), daemon)  # the daemon has looked by itself
        wait_for(an_sdo_is_answered_meanwhile, daemon)
        wait_for(two_share_a_scan, daemon)


def looks(remote: Remote, position: int) -> tuple[int, int]:
    """How often the devices on the wire were counted after a position in the frames; the next one.

    Only that takes a broadcast read of the station address, alone in its frame.
    """
    count, more = 0, True
    while more:
        found = remote.request(ReadFrames("control", position))
        count += found["records"].count(struct.pack("<HHHH", 0, 0x0010, 2, 0))
        position, more = found["position"], found["more"]
    return count, position


# --- a device is exchanged -----------------------------------------------------------------------


def test_an_exchanged_slave_is_named_with_both_identities(start: Start) -> None:
    daemon = start(config())
    with simulator_of(daemon) as rig:
        rig.faults.swap(3, "EL2004")
        wait_for(lambda: "another device" in daemon.log, daemon)
        (line,) = [line for line in daemon.log.splitlines() if "another device" in line]
        names(line, "slave 3 (EL3008)", "product 0x07D43052", "product 0x0BC03052")
        names(line, "correct its [[slave]] table", "refused", 'policy = "strict"')
        (difference,) = differences(daemon)
        assert (difference["kind"], difference["found"]) == ("other device", [3])
        names(difference["text"], "slave 3 (EL2004)", "EL3008", "0x07D43052", "0x0BC03052")
        rig.faults.swap(3, "original")
        wait_for(lambda: states(daemon) == ["OP"] * 4, daemon)
    assert differences(daemon) == []
    assert told(daemon) == [], "recovery has told it"


def test_commands_say_that_a_slave_is_no_longer_what_it_was(start: Start, tmp_path: Path) -> None:
    """Slave 1 is the same kind with another serial number, slave 3 is another device."""
    daemon = start(config())
    library = ("generate", "Plant", str(tmp_path / "out"))
    assert not daemon.ctl("pdos").stderr
    assert daemon.ctl_json("scan", "-o", str(tmp_path / "bus.json"))["outdated"] == []
    with simulator_of(daemon) as rig:
        rig.faults.power_off(1)
        rig.faults.swap(1, f"{tmp_path / 'spares.py'}:Numbered")
        rig.faults.swap(3, "EL2004")
        rig.faults.power_on(1)

        def are_exchanged() -> bool:
            rows = daemon.slave_rows("state")
            return (rows[1]["text"], rows[3]["recovery"]) == ("OP", "exchanged")

        wait_for(are_exchanged, daemon)
        assert daemon.slave_rows("slaves")[1]["serial"] == 12
        for command in (("pdos",), ("scan",), ("cstruct",), ("xml",), ("config", "init"), library):
            said = one_line_error(daemon.ctl(*command).stderr, "ecatctl")
            names(said, "warning", "slave 1 (EL2008)", "serial number 12")
            names(said, "slave 3 (EL3008)", "another device", "ecatd read at")
            names(said, "`ecatctl check`", "restart of ecatd")
        assert not daemon.ctl("pdos", "0").stderr
        assert "EL3008" in daemon.ctl("pdos", "3").stderr
        for command in (("pdos",), ("config", "init"), (*library, "--check")):
            (first, second) = daemon.ctl_json(*command)["outdated"]
            assert (first["position"], second["position"]) == (1, 3)
            assert first["read_at"] > second["read_at"] > 1e9
            names(second["text"], "another device")
        rig.faults.swap(3, "original")
        rig.faults.swap(1, "original")
        wait_for(lambda: states(daemon) == ["OP"] * 4, daemon)
    assert not daemon.ctl("pdos").stderr


@pytest.mark.long
def test_slaves_that_have_changed_places_are_told(start: Start) -> None:
    daemon = start(config())
    with simulator_of(daemon) as rig:
        for position in (1, 3):
            rig.faults.power_off(position)
        rig.faults.swap(1, "EL3008")
        rig.faults.swap(3, "EL2008")
        for position in (1, 3):
            rig.faults.power_on(position)
        wait_for(lambda: bool(told(daemon)), daemon)
    (line,) = told(daemon)
    names(line, "EL2008", "EL3008", "changed places", "refused")


@pytest.mark.long
@pytest.mark.parametrize(
    ("more", "keys", "spare"),
    [
        ("revision_min = 0x00100000\n", "", "Newer"),
        ("", "", "Newer"),  # any revision
        ("serial = 12\n", "serial = 12\n", "Numbered"),
        ("alias = 3\n", "alias = 3\n", "Aliased"),
    ],
)
def test_a_spare_that_its_table_accepts_is_used_without_a_restart(
    start: Start, tmp_path: Path, more: str, keys: str, spare: str
) -> None:
    daemon = start(config(more=more), keys=keys)
    with simulator_of(daemon) as rig, daemon.client() as client:
        rig.faults.power_off(1)
        wait_for(lambda: states(daemon)[1] != "OP", daemon)
        rig.faults.swap(1, f"{tmp_path / 'spares.py'}:{spare}")
        rig.faults.power_on(1)
        wait_for(lambda: states(daemon) == ["OP"] * 4, daemon)
        output = client.signal(1, 0x7000, 1)
        client.claim(output, lease=30)
        output.raw = 1
        client.commit()
        wait_for(lambda: rig.registers(1, 0x0F00, 1)[0] == 1, daemon)
    assert "left alone" not in daemon.log
    assert differences(daemon) == []


@pytest.mark.long
@pytest.mark.parametrize(
    ("more", "keys", "spare", "tokens"),
    [
        ("revision = 0x00100000\n", "", "Newer", ["revision 0x00110000", "0x00100000"]),
        ("revision_min = 0x00100000\n", "", "Older", ["revision 0x000F0000", "0x00100000"]),
        ("serial = 13\n", "serial = 13\n", "Numbered", ["serial number 12", "13"]),
        ("alias = 4\n", "alias = 4\n", "Aliased", ["station alias 3", "4"]),
    ],
)
def test_a_spare_that_its_table_refuses_is_left_alone(
    start: Start, tmp_path: Path, more: str, keys: str, spare: str, tokens: list[str]
) -> None:
    daemon = start(config(more=more), keys=keys)
    with simulator_of(daemon) as rig:
        rig.faults.swap(1, f"{tmp_path / 'spares.py'}:{spare}")
        wait_for(lambda: "left alone" in daemon.log, daemon)
        (line,) = [line for line in daemon.log.splitlines() if "left alone" in line]
        names(line, "slave 1 (EL2008)", *tokens)
        wait_for(lambda: daemon.slave_rows("state")[1]["recovery"] == "exchanged", daemon)
        (difference,) = differences(daemon)
        assert difference["kind"].startswith("missing" if "alias" in more else "other")
    assert told(daemon) == []


@pytest.mark.long
def test_a_newer_spare_must_have_the_same_process_data(start: Start, tmp_path: Path) -> None:
    daemon = start(config(more="revision_min = 0x00100000\n"))
    with simulator_of(daemon) as rig:
        rig.faults.swap(1, f"{tmp_path / 'spares.py'}:Smaller")
        wait_for(lambda: "other PDOs than at the start" in daemon.log, daemon)
        wait_for(lambda: daemon.slave_rows("state")[1]["recovery"] == "refused", daemon)
        rig.faults.swap(1, "original")
        wait_for(lambda: states(daemon) == ["OP"] * 4, daemon)


# --- slaves that are dark at the start -----------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("first", [0, 2])
def test_slaves_that_are_dark_at_a_tolerant_start_come_later(
    start: Start, tmp_path: Path, first: int
) -> None:
    rig_file, description = tmp_path / "whole.toml", tmp_path / "whole.json"
    rig_file.write_text("".join(f'[[slave]]\ndevice = "{kind}"\n' for kind in KINDS))
    run_module("ecatd.cli", "scan", "--from", str(rig_file), "-o", str(description))
    dark = f'[[fault]]\nkind = "break-link"\nslave = {first}\n'
    daemon = start(config("tolerant", description=str(description)), dark)
    (line,) = told(daemon)
    names(line, "warning", "slaves are missing")
    names(daemon.log, f"{first} slaves (and {4 - first} missing)", "1 difference")
    assert states(daemon) == ["OP"] * first + ["no answer"] * (4 - first)
    conditions = [""] * first + ["missing"] * (4 - first)
    wait_for(
        lambda: [row["recovery"] for row in daemon.ctl_json("state")["slaves"]] == conditions,
        daemon,
    )
    assert "slave count changed" not in daemon.log
    with simulator_of(daemon) as rig, daemon.client() as client:
        if first:  # the others do not wait
            output, value = client.signal(1, 0x7000, 1), client.signal(3, 0x6000, 0x11)
            client.wait()
            client.sample()
            assert output.validity == Validity.VALID
            assert value.validity != Validity.VALID
        rig.faults.heal_link(first)
        wait_for(lambda: states(daemon) == ["OP"] * 4, daemon)
        rig.faults.break_link(first or 1)
        wait_for(lambda: "slave count changed from 4 to" in daemon.log, daemon)
        names(removed(daemon), "restart", "starts the other slaves", 'policy = "tolerant"')
    assert told(daemon) == [line]


@pytest.mark.parametrize(
    ("more", "number"),
    [
        ("serial = 12\n", "serial = 12"),
        ("revision = 0x00110000\n", "revision = 0x00110000"),
        ("revision_min = 0x00110000\n", "revision = 0x00120000"),
    ],
)
def test_a_dark_slave_may_have_other_numbers_than_the_description(
    start: Start, tmp_path: Path, more: str, number: str
) -> None:
    rig_file, description = tmp_path / "whole.toml", tmp_path / "whole.json"
    rig_file.write_text("".join(f'[[slave]]\ndevice = "{kind}"\n' for kind in KINDS))
    run_module("ecatd.cli", "scan", "--from", str(rig_file), "-o", str(description))
    dark = '[[fault]]\nkind = "break-link"\nslave = 1\n'
    daemon = start(config("tolerant", more, str(description)), dark)
    (tmp_path / "late.py").write_text(f"{SPARES}\nclass Late(EL2008):\n    {number}\n")
    assert states(daemon) == ["OP"] + ["no answer"] * 3
    with simulator_of(daemon) as rig:
        rig.faults.swap(1, f"{tmp_path / 'late.py'}:Late")
        rig.faults.heal_link(1)
        wait_for(lambda: states(daemon) == ["OP"] * 4, daemon)
    assert differences(daemon) == []
    assert len(told(daemon)) == 1


def test_a_dark_slave_without_a_place_is_told_when_it_comes(start: Start) -> None:
    daemon = start(config("tolerant"), '[[fault]]\nkind = "break-link"\nslave = 3\n')
    with simulator_of(daemon) as rig:
        rig.faults.heal_link(3)
        wait_for(lambda: "restart ecatd to use it" in daemon.log, daemon)
    (line,) = [line for line in daemon.log.splitlines() if "restart ecatd to use it" in line]
    names(line, "slave 3 (EL3008)", "restart")


@pytest.mark.long
def test_without_a_description_nothing_is_known_of_a_dark_bus(
    start_daemon: Start, tmp_path: Path
) -> None:
    rig = tmp_path / "dark.toml"
    rows = "".join(f'[[slave]]\ndevice = "{kind}"\n' for kind in KINDS)
    rig.write_text(f'{rows}[[fault]]\nkind = "break-link"\nslave = 0\n')
    status, log = start_daemon(str(rig), config=config("tolerant"), ready=False).wait_end()
    assert status == 3
    names(log, "no EtherCAT slave", "description", "[expected]")

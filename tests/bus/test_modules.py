"""Modular devices (ETG.5001): the modules that their slots shall have, and those that they have."""

import json
import struct
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon, names, one_line_error, wait_for
from ecatd.client import Direction
from ecatsim.control import Simulator
from esi_island import ISLAND as ISLAND_FILE

pytestmark = pytest.mark.bus

ISLAND = "vendor = 0xFFFF\nproduct = 0x0E10\n"
CONFIG = f"""
[gateway]
listen = []
[expected]
policy = "POLICY"
[[slave]]
position = 1
name = "island"
type = "ModularIO"
{ISLAND}
[[slave.module]]
slot = 1
ident = 0x0108
type = "DI8"
[[slave.module]]
slot = 2
ident = 0x0208
type = "DO8"
[[slave.module]]
slot = 4
ident = 0x0302
type = "AI2"
"""
STRICT = CONFIG.replace("POLICY", "strict")
DI8, DO8, AI2 = 0x0108, 0x0208, 0x0302

Start = Callable[..., Daemon]


@pytest.fixture
def start(start_daemon: Callable[..., Daemon], tmp_path: Path) -> Start:
    """Starts a daemon on a terminal and an island with these modules."""

    def start(
        modules: str = "DI8, DO8, -, AI2",
        policy: str = "strict",
        config: str = CONFIG,
        ready: bool = True,
    ) -> Daemon:
        rig = tmp_path / "rig.toml"
        rig.write_text(
            'name = "island"\n[[slave]]\ndevice = "EK1100"\n[[slave]]\ndevice = "ModularIO"\n'
            f'parameters = {{ modules = "{modules}" }}\n'
        )
        return start_daemon(str(rig), config=config.replace("POLICY", policy), ready=ready)

    return start


def expected_by(daemon: Daemon) -> list[int]:
    """The list of modules that the island has been told to expect."""
    with daemon.client() as client:
        count = client.sdo_upload(1, 0xF030, 0).result()[0]
        values = [client.sdo_upload(1, 0xF030, slot).result() for slot in range(1, count + 1)]
    return [struct.unpack("<I", value)[0] for value in values]


def test_an_island_is_told_its_modules(start: Start) -> None:
    daemon = start()
    assert "not as expected" not in daemon.log
    assert expected_by(daemon) == [DI8, DO8, 0, AI2]
    island = daemon.slave_rows("slaves")[1]
    assert [(m["ident"], m["name"]) for m in island["modules"]][:4] == [
        (DI8, "DI8"),
        (DO8, "DO8"),
        (0, ""),
        (AI2, "AI2"),
    ]
    names(daemon.ctl("slaves").stdout, "island (ModularIO)", "1 DI8", "2 DO8", "4 AI2")
    with daemon.client() as client, Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        client.claim(1, lease=30)
        client.signal("island/0x7010:03", direction=Direction.OUTPUT).raw = 1
        client.commit()
        simulator.set(1, 0x6030, 2, -1234)
        wait_for(lambda: simulator.get(1, 0x7010, 3) == 1, daemon)
        value = client.signal("island/0x6030:02", direction=Direction.INPUT)
        wait_for(lambda: client.sample() or value.raw == -1234, daemon)


def test_other_modules_are_named_by_slot(start: Start) -> None:
    daemon = start("DI8, -, DO8, AO2", ready=False)
    status, log = daemon.wait_end()
    assert status == 7
    text = one_line_error(log, "ecatd")
    names(text, "slave 1", "ModularIO", "slot 2", "DO8 (0x00000208)", "empty")
    names(text, "slot 3", "slot 4", "AI2 (0x00000302)", "0x00000402", "[[slave.module]]")
    assert "slot 1" not in text


def test_an_island_with_other_modules_takes_no_part(start: Start) -> None:
    daemon = start("DI8, DO8, -, AI2, AO2", policy="tolerant")
    names(daemon.log, "not as expected", "slot 5", "0x00000402")
    states = [row["text"] for row in daemon.slave_rows("state")]
    assert states == ["OP", "PREOP"]
    assert expected_by(daemon) == []


def test_a_module_is_exchanged_while_the_bus_runs(start: Start, tmp_path: Path) -> None:
    daemon = start(config=CONFIG.replace("[gateway]", "[recovery]\nretry_s = 0.5\n[gateway]"))
    with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        simulator.faults.module(1, 2, "AO2")
        wait_for(lambda: "0x00000402" in daemon.log, daemon)
        assert "refused" in daemon.ctl("info").stdout
        names(daemon.log, "slave 1 (island, ModularIO)", "slot 2", "DO8 (0x00000208)", "0x00000402")
        assert [row["text"] for row in daemon.slave_rows("state")] == ["OP", "PREOP"]
        checked = daemon.ctl("config", "check", str(daemon.config_file), check=False)
        assert checked.returncode == 7
        names(checked.stdout, "other modules", "slot 2", "DO8 (0x00000208)", "0x00000402")
        new = tmp_path / "new.toml"
        daemon.ctl("config", "init", "-o", str(new))
        assert "ident = 0x00000402" in new.read_text()
        assert "\npdos" not in new.read_text()
        assert daemon.ctl("config", "check", str(new)).returncode == 0
        simulator.faults.module(1, 2, "DO8")
        wait_for(
            lambda: [row["text"] for row in daemon.slave_rows("state")] == ["OP", "OP"], daemon
        )
    assert expected_by(daemon) == [DI8, DO8, 0, AI2]
    assert daemon.stop() == 0
    daemon = start("DI8, AO2, -, AI2", config=new.read_text())
    assert expected_by(daemon) == [DI8, 0x0402, 0, AI2]


def test_the_slave_itself_refuses_modules_that_it_has_not(start: Start) -> None:
    """A start-up parameter says what the tables would say, so only the island can object."""
    config = CONFIG[: CONFIG.index("[[slave.module]]")]
    for address, kind, value in (("0xF030:01", "uint32", DO8), ("0xF030:00", "uint8", 1)):
        config += f'[[slave.startup]]\nobject = "{address}"\ntype = "{kind}"\nvalue = {value}\n'
    status, log = start(config=config, ready=False).wait_end()
    assert status == 7
    names(one_line_error(log, "ecatd"), "slave 1", "0x0070", "module")


def test_config_init_writes_the_modules(start: Start, tmp_path: Path) -> None:
    daemon = start(config="[gateway]\nlisten = []\n")
    assert expected_by(daemon) == []
    file = tmp_path / "new.toml"
    daemon.ctl("config", "init", "-o", str(file))
    text = file.read_text()
    assert text.count("[[slave.module]]") == 3
    names(text, "slot = 4", "ident = 0x00000302")
    assert daemon.ctl("config", "check", str(file)).returncode == 0
    file.write_text(text.replace("ident = 0x00000302", "ident = 0x00000402"))
    checked = daemon.ctl("config", "check", str(file), "--json", check=False)
    assert checked.returncode == 7
    (difference,) = json.loads(checked.stdout)["differences"]
    assert (difference["kind"], difference["found"]) == ("other modules", [1])
    names(difference["text"], "slot 4", "0x00000402", "0x00000302")


@pytest.mark.parametrize(
    ("wrong", "tokens"),
    [
        ("slot = 2\nident = 0x0302", ["slave[0].module[2].slot", "slot 2", "two tables"]),
        pytest.param(
            "slot = 0\nident = 0x0302",
            ["slave[0].module[2].slot", "0", "1", "254"],
            marks=pytest.mark.long,
        ),
        pytest.param("slot = 4", ["slave[0].module[2].ident", "missing"], marks=pytest.mark.long),
        pytest.param(
            "slot = 4\nident = 0", ["slave[0].module[2].ident", "0"], marks=pytest.mark.long
        ),
    ],
)
def test_wrong_modules_are_refused(start: Start, wrong: str, tokens: list[str]) -> None:
    config = CONFIG.replace("slot = 4\nident = 0x0302", wrong)
    status, log = start(config=config, ready=False).wait_end()
    assert status == 2
    names(one_line_error(log, "ecatd"), *tokens)


def test_a_slave_without_slots_is_told_no_modules(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    config = STRICT.replace("position = 1", "position = 0").replace(ISLAND, "")
    status, log = start_daemon("line:1", config=config, ready=False).wait_end()
    assert status == 2
    names(one_line_error(log, "ecatd"), "slave 0", "[[slave.module]]")
    rig = tmp_path / "rig.toml"
    rig.write_text('[[slave]]\ndevice = "EL3008"\n')
    status, log = start_daemon(str(rig), config=config, ready=False).wait_end()
    assert status == 7
    names(one_line_error(log, "ecatd"), "slave 0", "slots", "0xF030", "[[slave.module]]")


FIXED = """
from ecatd.client import Direction
from ecatd.etg.datatypes import DataType
from ecatsim import Rig
from ecatsim.devices.modular import ModularIO
from ecatsim.slave.objects import Access


class Fixed(ModularIO):
    def describe(self):
        entries = self.dictionary.object(0xF030).entries
        entries[0].value, entries[0].access = 8, Access.RO
        for entry in list(entries.values())[1:]:
            entry.on_write = None


def rig():
    return Rig("fixed", [Fixed("DI8, DO8, -, AI2")])
"""


def test_a_list_with_a_fixed_number_of_slots(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    rig = tmp_path / "fixed.py"
    rig.write_text(FIXED)
    config = STRICT.replace("position = 1", "position = 0")
    daemon = start_daemon(str(rig), config=config)
    with daemon.client() as client:
        for slot, ident in enumerate((DI8, DO8, 0, AI2, 0, 0, 0, 0), 1):
            value = client.sdo_upload(0, 0xF030, slot).result()
            assert struct.unpack("<I", value)[0] == ident


@pytest.mark.long
def test_an_island_from_an_esi_file(start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    """From the file alone to a configuration, then to a bus that runs with it."""
    esi = tmp_path / "island.xml"
    esi.write_text(ISLAND_FILE)
    rig = tmp_path / "rig.toml"
    rig.write_text(f'[[slave]]\nesi = "{esi}"\ntype = "Island"\nmodules = ["DI2", "AO1"]\n')
    daemon = start_daemon(str(rig), config="[gateway]\nlisten = []\n")
    new = tmp_path / "new.toml"
    daemon.ctl("config", "init", "--esi", str(esi), "-o", str(new))
    text = new.read_text()
    names(text, 'type = "DI2"', 'type = "AO1"', 'object = "0x8010:00"', "Input 2")
    checked = daemon.ctl("config", "check", str(new), "--esi", str(esi))
    assert checked.returncode == 0, checked.stdout
    daemon.stop()
    again = start_daemon(str(rig), config=text)
    with again.client() as client:
        assert client.sdo_upload(0, 0x8010, 0).result() == b"\x05\0"
        assert client.signal("Island/0x7010:01", direction=Direction.OUTPUT).raw == 0
    scanned = again.ctl("scan", "--from", str(esi), "--devices", "Island[DI2, AO1]").stdout
    assert [module["ident"] for module in json.loads(scanned)["slaves"][0]["modules"]] == [
        *(0x0101, 0x0202, 0),
    ]
    wrong = text.replace("ident = 0x00000202", "ident = 0x00000303")
    new.write_text(wrong)
    checked = again.ctl("config", "check", str(new), "--esi", str(esi), "--json", check=False)
    kinds = {item["kind"]: item["text"] for item in json.loads(checked.stdout)["differences"]}
    names(kinds["forbidden modules"], "slot 2", "Axis (0x00000303)")
    assert "other modules" in kinds

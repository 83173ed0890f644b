"""`ecatctl config`: the configuration that the bus as it is would have, and what is in force."""

import json
import re
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon, names, one_line_error, run_module, wait_for
from ecatd.config import load_config, read_config
from ecatd.description import bus_file
from ecatsim.control import Simulator

sys.path.insert(0, str(Path(__file__).parents[1] / "unit"))

from eni_sample import MACHINE, eni, ids, slave
from esi_sample import SAMPLE

pytestmark = pytest.mark.bus

CYCLE_TIME_US = 1000
"""The default, which `config check` assumes for a file that does not name it."""

KNOWN = """
cycle_time_us = 2000
[gateway]
listen = []
[[slave]]
position = 2
name = "axis"
[[slave.startup]]
object = "0x6065:00"
type = "uint32"
value = 1234
comment = "following error"
[[slave.pdo]]
index = "0x1A00"
entries = [{ object = "0x6041:00", bits = 16 }, { object = "0x6064:00", bits = 32 }, { bits = 16 }]
[[outputs.safe]]
slave = "axis"
value = "quick_stop"
[[domain]]
slaves = []
[[domain]]
name = "slow"
divider = 4
slaves = [1]
[dc]
lock_us = 900
timeout_s = 60
[[dc.slave]]
slave = "axis"
[[signal]]
slave = 1
entry = "0x6000:01"
name = "stop"
values = { 0 = "pressed" }
"""


@pytest.fixture
def machine(start_daemon: Callable[..., Daemon], tmp_path: Path) -> Callable[..., Daemon]:
    def start(kinds: list[str], config: str, *, ready: bool = True, faults: str = "") -> Daemon:
        rig = tmp_path / "rig.toml"
        slaves = "".join(f'[[slave]]\ndevice = "{k}"\n' for k in kinds)
        rig.write_text(f'name = "m"\n{slaves}{faults}')
        return start_daemon(str(rig), config=config, ready=ready)

    return start


def test_from_an_unknown_bus_to_a_checked_configuration(
    machine: Callable[..., Daemon], tmp_path: Path
) -> None:
    kinds = ["EK1100", "EL1008", "CiA402", "EL3008", "EL3008"]
    daemon = machine(kinds, KNOWN)
    file = tmp_path / "machine.toml"
    names(daemon.ctl("config", "init", "-o", str(file)).stdout, str(file), "5 slaves")
    again = daemon.ctl("config", "init", "-o", str(file), check=False)
    assert again.returncode == 7
    names(one_line_error(again.stderr, "ecatctl"), str(file), "--force")
    mine = f"# mine\n{file.read_text()}"
    for kept in (f"{file}.bak", f"{file}.bak2"):
        file.write_text(mine)
        names(daemon.ctl("config", "init", "-o", str(file), "--force").stderr, kept)
        assert Path(kept).read_text() == mine
    assert not daemon.ctl("config", "init", "-o", str(file), "--force").stderr
    folder = daemon.ctl("config", "init", "-o", str(tmp_path), "--force", check=False)
    assert folder.returncode == 2
    names(one_line_error(folder.stderr, "ecatctl"), str(tmp_path), "folder")
    text = file.read_text()
    names(text, "value = 1234", "0x6041:00", "slave 2: CiA402", "slave 3: EL3008", "0x6000:11")
    written = load_config(file)
    assert [slave.name for slave in written.slave] == [
        "EK1100",
        "EL1008",
        "axis",
        "EL3008",
        "EL3008_2",
    ]
    assert not written.expected.unlisted
    assert written.outputs.safe[0].slave == 2
    known = load_config(daemon.config_file)
    assert (written.domain, written.dc, written.signal) == (known.domain, known.dc, known.signal)
    assert written.slave[2].startup == known.slave[0].startup
    assert written.slave[2].pdo == known.slave[0].pdo
    names(daemon.ctl("config", "check", str(file)).stdout, "5 slaves", str(file))
    changed = daemon.ctl("config", "diff", str(file), check=False)
    assert changed.returncode == 1
    names(changed.stdout, "expected.unlisted", "slave[EL3008_2]", "(no table)", "0x0BC03052")
    names(changed.stdout, "slave[axis].product", "(not set)")
    assert "cycle_time_us" not in changed.stdout
    assert daemon.stop() == 0
    first = daemon.bus

    daemon = machine(kinds, text)
    assert "not as expected" not in daemon.log
    assert (
        daemon.ctl("config", "init").stdout.partition("\n")[2]
        == (text.replace(first, daemon.bus).partition("\n")[2])
    )
    first_table = text[text.index("[[slave]]") :].partition("\n\n")[0]
    assert 'name = "EK1100"' in first_table
    file.write_text(text.replace(first_table, "").replace(first, daemon.bus))
    removed = daemon.ctl("config", "diff", str(file), check=False)
    heads = [line.split()[0] for line in removed.stdout.splitlines()]
    assert heads == ["KEY", "slave[EK1100]", "restart"]
    document = daemon.ctl("config", "diff", str(file), "--json", check=False)
    (row,) = json.loads(document.stdout)["differences"]
    assert (row["used"]["product"], row["file"]) == (0x044C2C52, None)
    only = daemon.ctl("config", "diff", str(daemon.config_file), check=False)
    assert only.returncode == 0
    names(only.stderr, "command line", "bus")


def test_a_file_is_checked_against_the_bus(machine: Callable[..., Daemon], tmp_path: Path) -> None:
    daemon = machine(["EK1100", "EL1008", "CiA402"], "[gateway]\nlisten = []\n")
    file, scan = tmp_path / "other.toml", tmp_path / "scan.json"
    daemon.ctl("config", "init", "-o", str(file))
    text = file.read_text()
    file.write_text(
        text.replace("0x03F03052", "0x03F13052").replace("pdos = [0x1600", "pdos = [0x1601")
    )
    daemon.ctl("scan", "-o", str(scan))
    for source in ([], ["--from", str(scan)]):
        found = daemon.ctl("config", "check", str(file), *source, check=False)
        assert found.returncode == 7
        device, *_, pdos = found.stdout.splitlines()
        names(device, "other device", "slave 1 (EL1008)", "0x03F13052", "0x03F03052")
        names(pdos, "note", "restart", "slave 2 (CiA402)", "0x1600", "0x1601")
    offline = daemon.ctl("config", "init", "--from", str(scan)).stdout
    assert offline.partition("[dc]")[0] == text.partition("[dc]")[0]


OTHER_PDOS = "[[slave]]\nposition = 2\npdos = [0x1601, 0x1A01]\n"
OTHER_MAPPING = """
[[slave]]
position = 2
[[slave.pdo]]
index = 0x1A00
entries = [{ object = "0x6041:00", bits = 16 }, { object = "0x6064:00", bits = 32 }]
"""


@pytest.mark.parametrize("table", [OTHER_PDOS, OTHER_MAPPING])
def test_pdos_that_a_start_writes_are_no_difference(
    machine: Callable[..., Daemon], tmp_path: Path, table: str
) -> None:
    kinds, gateway = ["EK1100", "EL1008", "CiA402"], "[gateway]\nlisten = []\n"
    daemon = machine(kinds, gateway)
    file, scan = tmp_path / "machine.toml", tmp_path / "scan.json"
    daemon.ctl("scan", "-o", str(scan))
    file.write_text(f"{table}{gateway}")
    checked = daemon.ctl("config", "check", str(file))
    (note,) = checked.stdout.splitlines()
    names(note, "note", "restart", "slave 2 (CiA402)")
    document = daemon.ctl_json("config", "check", str(file))
    assert (document["differences"], document["warnings"]) == ([], [])
    assert [f"note: {text}" for text in document["notes"]] == [note]
    # A file tells nothing of PDOs that the slave did not exchange.
    offline = daemon.ctl("config", "check", str(file), "--from", str(scan)).stdout
    assert note in offline
    if table == OTHER_PDOS:
        names(offline, "warning", "0x1601, 0x1A01", "--esi")
    assert daemon.stop() == 0
    daemon = machine(kinds, f"{table}{gateway}")
    assert "notes" in daemon.ctl_json("config", "check", str(daemon.config_file))
    names(daemon.ctl("config", "check", str(daemon.config_file)).stdout, "3 slaves")


ISLAND = """
[[slave]]
vendor = 0xFFFF
product = 0x77
name = "Plain"
[slave.mailbox]
[[slave.pdo]]
index = 0x1600
entry = [{ index = 0x7000, subindex = 1, name = "Open", type = "uint16" }]
[[slave.pdo]]
index = 0x1601
assigned = false
entry = [{ index = 0x7000, subindex = 2, name = "Speed", type = "uint16" }]
[[slave.object]]
index = 0x8000
name = "Ramp"
entry = [{ subindex = 1, name = "Up", type = "uint16", access = "rw" }]
"""
REFUSED = {
    "missing PDO": ("position = 2\npdos = [0x1605, 0x1A55]", "0x1A55"),
    "fixed PDO": (
        "position = 2\n[[slave.pdo]]\nindex = 0x1605\n"
        "entries = [{ object = '0x6040:00', bits = 16 }]",
        "0x1605",
    ),
    "fixed assignment": ("position = 3\npdos = [0x1601]", "0x1C12"),
    "no modules": ("position = 3\n[[slave.module]]\nslot = 1\nident = 5", "0xF030"),
    "no complete access": (
        "position = 3\n[[slave.startup]]\nobject = '0x8000:01'\nhex = '0100'\ncomplete = true",
        "0x8000:01",
    ),
    "no PDO in the EEPROM": ("position = 1\npdos = [0x1A55]", "0x1A55"),
}
"""Tables that a slave refuses, and the object that this is about."""


@pytest.mark.long
@pytest.mark.parametrize("what", [*REFUSED])
def test_what_a_slave_refuses_is_found_in_advance(
    machine: Callable[..., Daemon], tmp_path: Path, what: str
) -> None:
    (table, about), gateway = REFUSED[what], "[gateway]\nlisten = []\n"
    kinds = ["EK1100", "EL1008", "ElmoGold"]
    daemon = machine(kinds, gateway, faults=ISLAND)
    file = tmp_path / "machine.toml"
    file.write_text(f"[[slave]]\n{table}\n{gateway}")
    checked = daemon.ctl("config", "check", str(file), check=False)
    (problem,) = (line for line in checked.stdout.splitlines() if not line.startswith("note: "))
    names(problem, about)
    assert daemon.stop() == 0
    refused = machine(kinds, file.read_text(), ready=False, faults=ISLAND)
    status, log = refused.wait_end()
    assert status == checked.returncode, log
    said = one_line_error(log, "ecatd").removeprefix("error: ")
    names(said, about)
    for text in (problem, said):
        assert re.search(r"\.toml:\d+: slave\[0\]\.\w+", text), text


@pytest.mark.long
def test_slaves_that_do_not_answer_are_told(machine: Callable[..., Daemon], tmp_path: Path) -> None:
    daemon = machine(["EK1100", "EL1008", "EL2008"], "[gateway]\nlisten = []\n")
    file, again = str(tmp_path / "machine.toml"), str(tmp_path / "again.toml")
    assert not daemon.ctl("config", "init", "-o", file).stderr
    assert not daemon.ctl("config", "check", file).stderr
    with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        simulator.faults.break_link(1)
        wait_for(lambda: daemon.slave_rows("state")[2]["al_state"] == 0, daemon)
        told = one_line_error(daemon.ctl("config", "init", "-o", again).stderr, "ecatctl")
        names(told, "slave 1 (EL1008), slave 2 (EL2008): no answer", "ecatd read at", "restart")
        checked = daemon.ctl("config", "check", file, check=False)
        assert checked.returncode == 7
        names(checked.stdout, "missing", "slaves 1 to 2", "EL1008", "EL2008", "power")
        found = json.loads(daemon.ctl("config", "check", file, "--json", check=False).stdout)
        assert [row["position"] for row in found["outdated"]] == [1, 2]
        assert [item["expected"] for item in found["differences"]] == [[1, 2]]
        told = daemon.ctl("config", "check", str(daemon.config_file))  # which expects no slaves
        names(one_line_error(told.stderr, "ecatctl"), "slave 1 (EL1008)", "ecatd read at")
        found = daemon.ctl_json("config", "init")
        assert [row["position"] for row in found["outdated"]] == [1, 2]


DOUBTFUL = """
[[fault]]
kind = "mailbox"
slave = 1
mode = "stuck"
[[fault]]
kind = "eeprom"
slave = 2
content = "truncated"
[[fault]]
kind = "eeprom"
slave = 3
content = "ones"
"""


@pytest.mark.long
def test_slaves_in_doubt_are_told_as_by_the_start(
    machine: Callable[..., Daemon], tmp_path: Path
) -> None:
    kinds = ["EK1100", "CiA402", "EL3008", "EL2008"]
    file = tmp_path / "machine.toml"
    daemon = machine(kinds, "[gateway]\nlisten = []\n")
    rule = '[[signal]]\nslave = 2\nentry = "0x6000:11"\nunit = "bar"\n'
    file.write_text(f"{daemon.ctl('config', 'init').stdout}{rule}")
    assert daemon.stop() == 0
    daemon = machine(kinds, "[gateway]\nlisten = []\n", faults=DOUBTFUL)
    checked = daemon.ctl("config", "check", str(file), check=False)
    assert checked.returncode == 7
    unwritten, silent, damaged = checked.stdout.splitlines()
    names(unwritten, "other device", "slave 3", "EL2008", "0xFFFFFFFF", "EEPROM again")
    names(silent, "warning", "slave 1 (CiA402)", "mailbox did not answer", "takes no part")
    names(damaged, "warning", "slave 2", "EEPROM is damaged", "takes no part", "EEPROM again")
    assert daemon.stop() == 0
    tolerant = file.read_text().replace('"strict"', '"tolerant"')
    log = machine(kinds, tolerant, faults=DOUBTFUL).log
    assert unwritten.removeprefix("other device: ") in log
    names(log, "slave 1 (CiA402)", "stays in PREOP")
    assert damaged.partition("slave 2: ")[2] in log


WRONG = """
[[signal]]
slave = 2
entry = "0x60FF:00"
unit = "rpm"
scale = 0.1
maximum = -5.0
[[signal]]
slave = "stop"
entry = "0x6000:01"
unit = "V"
[[copy]]
slave = 2
entry = "0x60FF:00"
from_slave = "stop"
from_entry = "0x6000:01"
[[copy]]
slave = 2
entry = "0x60FF:01"
from_slave = "stop"
from_entry = "0x6010:01"
[[copy]]
slave = 2
entry = "0x6071:00"
from_slave = 7
from_entry = "0x6010:01"
[[domain]]
[[domain]]
name = "coupler"
slaves = [0]
[outputs]
[[outputs.safe]]
slave = "stop"
value = "hold"
[[dc.slave]]
slave = "stop"
"""


@pytest.mark.long
def test_all_that_does_not_fit_the_bus_is_listed(
    machine: Callable[..., Daemon], tmp_path: Path
) -> None:
    kinds = ["EK1100", "EL1008", "CiA402"]
    running = "[[signal]]\nslave = 2\nentry = '0x60FF:00'\nunit = 'm/s'\n[gateway]\nlisten = []\n"
    daemon = machine(kinds, running)
    file, scan = tmp_path / "machine.toml", tmp_path / "scan.json"
    config = f"[gateway]\nlisten = []\n[[slave]]\nposition = 1\nname = 'stop'\n{WRONG}"
    file.write_text(config)
    daemon.ctl("scan", "-o", str(scan))
    expected = [
        ("signal[0].maximum", "slave 2 (CiA402)", "0x60FF:00", "[[outputs.safe]]"),
        ("copy[0].factor", "rpm", "V", "slave 1 (stop, EL1008)"),
        ("copy[1].entry", "0x60FF:01", "slave 2 (CiA402)", "ecatctl pdos 2"),
        ("copy[2].from_slave", "slave 7", "3 slaves"),
        ("domain[1].slaves", "domain 1 (coupler)", "nothing"),
        ("outputs.safe[0].slave", "slave 1 (stop, EL1008)", "no outputs"),
        ("dc.slave[0].slave", "slave 1 (stop, EL1008)", "no distributed clock"),
    ]
    for source in ([], ["--from", str(scan)]):
        found = daemon.ctl("config", "check", str(file), *source, check=False)
        assert found.returncode == 2, found.stderr
        lines = sorted(found.stdout.splitlines(), key=lambda line: line.split(": ")[1])
        assert len(lines) == len(expected), lines
        for line, tokens in zip(lines, sorted(expected), strict=True):
            assert line.startswith(f"{file}:")
            names(line, *tokens)
    document = daemon.ctl("config", "check", str(file), "--json", check=False)
    said = json.loads(document.stdout)["wrong"]
    assert sorted(said) == sorted(lines)
    assert daemon.stop() == 0
    # A start ends with one of them, and the same words, apart from names of file and bus.
    refused = machine(kinds, config, ready=False)
    status, log = refused.wait_end()
    assert status == 7, "a slave is not there, and may come later"
    text = one_line_error(log, "ecatd").removeprefix("error: ")
    assert text.split(": ", 1)[1].replace(refused.bus, daemon.bus) in "\n".join(said)


STARTS_WRONG = {
    "expected.description": "[expected]\ndescription = 'nowhere.json'\n",
    "slave[0].startup[0] (slave 1)": "[[slave]]\nposition = 1\n[[slave.startup]]\n"
    "object = '0x2000:00'\nhex = '00'\n",
    "domain[1].divider": "[[domain]]\n[[domain]]\ndivider = 200\nslaves = [2]\n",
}
"""What once only a start found, by the key in its message."""


@pytest.mark.long
def test_the_check_finds_what_the_start_finds(
    machine: Callable[..., Daemon], tmp_path: Path
) -> None:
    kinds = ["EK1100", "EL1008", "EL2008"]
    gateway = "[gateway]\nlisten = []\n"
    daemon = machine(kinds, gateway)
    file = tmp_path / "machine.toml"
    file.write_text("".join(STARTS_WRONG.values()) + gateway)
    found = daemon.ctl("config", "check", str(file), check=False)
    assert found.returncode == 2, found.stderr
    said = {line.split(": ")[1]: line.split(": ", 2)[2] for line in found.stdout.splitlines()}
    assert said.keys() == STARTS_WRONG.keys()
    file.write_text(f"profiles = ['nowhere']\n{gateway}")
    found = daemon.ctl("config", "check", str(file), check=False)
    assert found.returncode == 2
    assert found.stdout.startswith(f"{file}:1: profiles[0]: ")
    alone = run_module("ecatd.service", "--check-config", "--config", str(file))
    assert alone.returncode == 2
    names(one_line_error(alone.stderr, "ecatd"), f"{file}:1: profiles[0]")
    assert daemon.stop() == 0
    for key, text in STARTS_WRONG.items():
        refused = machine(kinds, f"{text}{gateway}", ready=False)
        status, log = refused.wait_end()
        assert status == 2, log
        place, named, words = one_line_error(log, "ecatd").removeprefix("error: ").split(": ", 2)
        assert place.startswith(f"{refused.config_file}:")
        assert named == key
        assert words.replace(f"{refused.config_file.parent}", f"{file.parent}") == said[key]


def test_slaves_that_nothing_tells_apart_are_a_warning(machine: Callable[..., Daemon]) -> None:
    row = "[[slave]]\nposition = {}\nvendor = 2\nproduct = 0x03F03052\noptional = true\n"
    config = f"[gateway]\nlisten = []\n{row.format(1)}{row.format(2)}"
    daemon = machine(["EK1100", "EL1008", "EL1008"], config)
    file = str(daemon.config_file)
    (warned,) = (line for line in daemon.log.splitlines() if "side by side" in line)
    names(warned, "warning", "slave 1", "slave 2", "alias", "slave[1].position")
    text = warned.partition("warning: ")[2]
    checked = daemon.ctl("config", "check", file)
    assert checked.stdout == f"warning: {text}\n"
    assert daemon.ctl_json("config", "check", file)["warnings"] == [text]
    alone = run_module("ecatd.service", "--check-config", "--config", file)
    assert (alone.returncode, text in alone.stderr) == (0, True)


def test_what_is_in_force_is_shown_with_its_origin(machine: Callable[..., Daemon]) -> None:
    daemon = machine(["EK1100", "EL1008", "CiA402", "EL3008"], KNOWN)
    lines = daemon.ctl("config", "show").stdout.splitlines()
    rows = {line.split()[0]: line for line in lines if line}
    names(rows["bus"], f'"{daemon.bus}"', "command line")
    names(rows["cycle_time_us"], "2000", "ecat.toml:2")
    names(rows["recovery.retry_s"], "10.0", "default")
    names(rows["slave[0].pdo[0].index"], "0x1A00", "ecat.toml:14")
    names(rows["1/0x6000:01"], "stop", "[[signal]]")
    names(rows["3/0x6000:11"], "V", "profile")
    document = daemon.ctl_json("config", "show")
    keys = {row["key"]: row for row in document["keys"]}
    assert keys["cycle_time_us"] == {
        "key": "cycle_time_us",
        "value": 2000,
        "origin": f"{daemon.config_file}:2",
    }


@pytest.mark.parametrize(
    ("arguments", "tokens"),
    [
        ("check", "FILE"),
        ("from-eni", "FILE"),
        ("from-eni x.xml --from troll", "FILE"),
        ("show --esi x", "config init"),
        ("diff", "FILE"),
        ("init x.toml", "-o FILE"),
        ("show x.toml", "no FILE"),
        ("show -o x.toml", "config init"),
        ("diff x.toml --from troll", "--from"),
        ("show --config x.toml", "--config"),
        ("init --config x.toml", "--config"),
        ("check missing.toml --from troll", "missing.toml"),
    ],
)
def test_wrong_usage_says_what_to_do(arguments: str, tokens: str) -> None:
    result = run_module("ecatd.cli", "config", *arguments.split())
    assert result.returncode == 2
    names(one_line_error(result.stderr, "ecatctl"), tokens)


# --- ENI files -----------------------------------------------------------------------------------


def test_from_an_eni_file_to_a_bus_that_runs(
    machine: Callable[..., Daemon], tmp_path: Path
) -> None:
    source, file = tmp_path / "press.xml", tmp_path / "machine.toml"
    source.write_text(MACHINE)
    made = run_module("ecatd.cli", "config", "from-eni", str(source), "-o", str(file))
    assert made.returncode == 0, made.stderr
    names(made.stdout, str(file), "4 slaves")
    names(made.stderr, "taken", "Press", "not taken", f"{source}:", "0x1018:01", "FMMUs")
    text = file.read_text().replace("# lock_us = 20.0", "lock_us = 900")
    text = text.replace("# timeout_s = 5.0", "timeout_s = 60").partition("\n[gateway]")[0]

    daemon = machine(["EK1100", "EL2008", "CiA402", "ElmoGold"], f"{text}\n[gateway]\nlisten = []")
    names(daemon.ctl("config", "check", str(daemon.config_file)).stdout, "4 slaves")
    assert daemon.ctl_json("sdo-read", "Press", "0x6065")["value"] == 1234
    rows = daemon.ctl_json("slaves")["slaves"]
    assert [row["domain"] for row in rows] == [0, 1, 0, 0]
    assert (rows[2]["sync0_ns"], rows[2]["sync_shift_ns"]) == (2_000_000, 250_000)
    assert rows[1]["watchdog_ms"] == 50
    slaves = bus_file.parse(daemon.ctl("scan").stdout, "scan").slaves
    assert [item.given_name for item in slaves] == ["Term_1", "Term_2", "Press", "Term_3"]
    mapping = [(e.index, e.bit_length) for e in slaves[2].inputs[0].entries]
    assert mapping == [(0x6041, 16), (0x6064, 32), (0, 16)]
    assert [pdo.index for pdo in slaves[3].outputs + slaves[3].inputs] == [0x1605, 0x1A02, 0x1A0A]


def test_an_eni_file_for_programs(tmp_path: Path) -> None:
    source = tmp_path / "press.xml"
    source.write_text(eni(slave("x", ids(2, 3), more="<Strange/>")))
    made = run_module("ecatd.cli", "config", "from-eni", str(source), "--json", "--bus", "press")
    document = json.loads(made.stdout)
    assert (made.stderr, document["bus"], document["slaves"]) == ("", "press", 1)
    assert read_config(tomllib.loads(document["text"])).slave[0].product == 3
    (left,) = document["unsupported"]
    assert left["slave"] == 0
    names(left["text"], "<Strange>")
    plain = run_module("ecatd.cli", "config", "from-eni", str(source), "--bus", "press")
    assert plain.stdout == document["text"]
    source.write_text("<EtherCATInfo/>")
    refused = run_module("ecatd.cli", "config", "from-eni", str(source))
    assert (refused.returncode, refused.stdout) == (2, "")
    names(one_line_error(refused.stderr, "ecatctl"), "press.xml:1", "ESI")


# --- ESI files -----------------------------------------------------------------------------------

COMMANDS = """<InitCmds><InitCmd><Transition>PS</Transition><Index>#x2000</Index>
<SubIndex>1</SubIndex><Data>05</Data></InitCmd></InitCmds></CoE>"""


def test_esi_files_add_to_the_configuration_and_check_it(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    files, rig, file = tmp_path / "esi", tmp_path / "rig.toml", tmp_path / "machine.toml"
    files.mkdir()
    coe = 'PdoConfig="1" CompleteAccess="0"'
    (files / "ax.xml").write_text(SAMPLE.replace(f"{coe}/>", f"{coe}>{COMMANDS}"))
    devices = f'[[slave]]\nesi = "{files / "ax.xml"}"\ntype = "AX2"\nrevision = 0x20001\n'
    rig.write_text(f'name = "m"\n[[slave]]\ndevice = "EK1100"\n{devices}')
    daemon = start_daemon(str(rig), config="[gateway]\nlisten = []\n")
    made = daemon.ctl("config", "init", "--esi", str(files), "-o", str(file))
    names(made.stderr, "EK1100", "esi")
    names(file.read_text(), "ax.xml", "AX2", "not with 0x1602", "AssignActivate 0x0700")
    assert daemon.ctl_json("sdo-read", "1", "0x2000", "1")["value"] != 5
    good = daemon.ctl("config", "check", str(file), "--esi", str(files))
    names(good.stdout, "2 slaves", str(file))
    assert daemon.stop() == 0

    text = file.read_text()
    daemon = start_daemon(str(rig), config=text)
    assert daemon.ctl_json("sdo-read", "AX2", "0x2000", "1")["value"] == 5
    bad = text.replace("pdos = [0x1600, 0x1601", "pdos = [0x1600, 0x1602")
    assert bad != text
    file.write_text(bad)
    found = daemon.ctl("config", "check", str(file), "--esi", str(files / "ax.xml"), check=False)
    assert found.returncode == 7
    (forbidden,) = [line for line in found.stdout.splitlines() if "forbidden" in line]
    names(forbidden, "slave 1", "AX2", "0x1600", "0x1602", "ax.xml")

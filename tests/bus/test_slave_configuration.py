"""What slaves are told at the start, and again whenever they come back: PDOs and parameters."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from test_bad_conditions import Bench
from test_recovery_power import in_op

from conftest import Daemon, names, one_line_error
from ecatd.etg.al import AlState
from ecatsim.control import Simulator

pytestmark = pytest.mark.bus

AXIS, DRIVE = 1, 2
RIG = """
name = "machine"
[[slave]]
device = "EK1100"
[[slave]]
device = "CiA402"
[[slave]]
device = "ElmoGold"
"""
CONFIG = """
[gateway]
listen = []
[recovery]
retry_s = 1.0
[[slave]]
position = 1
[[slave.pdo]]
index = "0x1A00"
entries = [
  { object = "0x6041:00", bits = 16 },
  { object = "0x6064:00", bits = 32 },
  { object = "0x6061:00", bits = 8 },
  { bits = 8 },
]
[[slave]]
position = 2
pdos = ["0x1605", "0x1A02", "0x1A0A"]
[[slave.startup]]
object = "0x6065:00"
type = "uint32"
value = 1234
[[slave.startup]]
object = "0x6060:00"
type = "int8"
value = 8
transition = "IP"
[[slave.startup]]
object = "0x6081:00"
hex = "10 27 00 00"
transition = "SO"
comment = "profile velocity of the homing run"
[[slave.startup]]
object = "0x5FFF:00"
type = "uint8"
value = 1
optional = true
"""

Start = Callable[[str], Bench]


@pytest.fixture
def rig(tmp_path: Path) -> str:
    file = tmp_path / "rig.toml"
    file.write_text(RIG)
    return str(file)


@pytest.fixture
def start(start_daemon: Callable[..., Daemon], rig: str) -> Iterator[Start]:
    benches: list[Bench] = []

    def start(config: str) -> Bench:
        benches.append(Bench(start_daemon(rig, config=config)))
        return benches[-1]

    yield start
    for bench in benches:
        bench.close()


def entries(daemon: Daemon, position: int, direction: str) -> list[tuple[str, list[str]]]:
    """The PDOs of a slave with the addresses of their entries."""
    slave = daemon.ctl_json("pdos")["slaves"][position]
    return [
        (f"0x{pdo['index']:04X}", [f"{e['index']:04X}:{e['subindex']:02X}" for e in pdo["entries"]])
        for pdo in slave[direction]
    ]


def value(daemon: Daemon, position: int, index: str, subindex: int = 0) -> int:
    """Reads an object from the slave itself."""
    found = daemon.ctl_json("sdo-read", str(position), index, str(subindex))
    return int(found["value"])


def check(daemon: Daemon) -> None:
    """The slaves have what the configuration tells them, by reading it from them."""
    assert value(daemon, DRIVE, "0x6065") == 1234
    assert value(daemon, DRIVE, "0x6060") == 8
    assert value(daemon, DRIVE, "0x6081") == 10000
    assert [value(daemon, DRIVE, "0x1C13", number) for number in (0, 1, 2)] == [2, 0x1A02, 0x1A0A]
    assert value(daemon, AXIS, "0x1A00", 2) == 0x60640020


def test_r06_slaves_are_told_at_the_start_and_when_they_come_back(start: Start) -> None:
    bench = start(CONFIG)
    daemon = bench.daemon
    check(daemon)
    assert entries(daemon, AXIS, "inputs") == [
        ("0x1A00", ["6041:00", "6064:00", "6061:00", "0000:00"])
    ]
    assert [index for index, _ in entries(daemon, DRIVE, "outputs")] == ["0x1605"]
    assert [index for index, _ in entries(daemon, DRIVE, "inputs")] == ["0x1A02", "0x1A0A"]
    names(daemon.log, "slave 2", "0x5FFF:00 = 1", "optional")
    bench.power(DRIVE, on=False)
    bench.wait_for(lambda: bench.health().slaves_found == DRIVE)
    bench.power(DRIVE, on=True)
    bench.wait_for_event("recovery", slave=DRIVE, state="recovered")
    in_op(bench)
    check(daemon)
    bench.power(AXIS, DRIVE, on=False)
    bench.wait_for(lambda: bench.health().slaves_found == AXIS)
    bench.power(DRIVE, AXIS, on=True)
    in_op(bench)
    check(daemon)
    with daemon.client() as client:
        assert [slave.al_state for slave in client.slaves()] == [AlState.OP] * 3


@pytest.mark.parametrize(
    ("table", "tokens"),
    [
        ("position = 2\npdos = ['0x16F0']", "slave 2 | 0x16F0 | 0x1600 | 0x1605"),
        pytest.param(
            "position = 2\n[[slave.pdo]]\nindex = 0x1605\n"
            "entries = [{ object = '0x6040:00', bits = 16 }]",
            "slave 2 | 0x1605",
            marks=pytest.mark.long,
        ),
        pytest.param(
            "position = 1\n[[slave.pdo]]\nindex = 0x1600\n"
            "entries = [{ object = '0x5FFF:00', bits = 16 }]",
            "slave 1 | 0x1600 | 0x5FFF:00",
            marks=pytest.mark.long,
        ),
        (
            "position = 2\n[[slave.startup]]\nobject = '0x6041:00'\ntype = 'uint16'\nvalue = 1",
            "slave 2 | 0x6041:00 = 1 | 0x06010002 | optional = true",
        ),
        pytest.param(
            "position = 2\n[[slave.startup]]\nobject = '0x6041:00'\ntype = 'uint16'\nvalue = 1\n"
            "transition = 'SO'",
            "slave 2 | 0x6041:00 = 1 | 0x06010002",
            marks=pytest.mark.long,
        ),
        pytest.param("position = 0\npdos = ['0x1600']", "slave 0 | 0x1600", marks=pytest.mark.long),
        (
            "position = 0\n[[slave.startup]]\nobject = '0x1000:00'\nhex = '00'",
            "slave 0 | CoE | [[slave.startup]]",
        ),
    ],
)
def test_what_a_slave_refuses_is_named(
    start_daemon: Callable[..., Daemon], rig: str, table: str, tokens: str
) -> None:
    daemon = start_daemon(rig, ready=False, config=f"[[slave]]\n{table}\n[gateway]\nlisten = []\n")
    status, log = daemon.wait_end()
    # What a slave without CoE cannot be told is a mistake in the file, whatever happens to the bus.
    assert status == (2 if "position = 0" in table else 7), log
    said = one_line_error(log, "ecatd")
    names(said, *tokens.split(" | "))
    assert re.search(rf"{daemon.config_file}:[1-9]+: slave\[0\]\.\w+", said), said


@pytest.mark.parametrize(
    ("position", "about", "keeps"),
    [(0, "0x1C12:00", True), (1, "0x1C13:00", True), (2, "0x1C12:01", False)],
)
def test_only_a_slave_that_has_lost_its_pdos_must_be_switched_off(
    start_daemon: Callable[..., Daemon], position: int, about: str, keeps: bool
) -> None:
    rig = Path(__file__).parents[1] / "rigs" / "refusing.py"
    table = f"[[slave]]\nposition = {position}\npdos = [0x1601, 0x1A01]\n"
    daemon = start_daemon(str(rig), ready=False, config=f"{table}[gateway]\nlisten = []\n")
    status, log = daemon.wait_end()
    assert status == 7, log
    said = one_line_error(log, "ecatd")
    names(said, f"slave {position}", about)
    assert ("power" not in said) == keeps


def test_a_silent_slave_holds_up_nobody(start_daemon: Callable[..., Daemon]) -> None:
    """It has a parameter for the way to OP, but stays in PREOP, since it does not answer."""
    rig = Path(__file__).parents[1] / "rigs" / "silent.py"
    table = "[[slave]]\nposition = 3\n[[slave.startup]]\nobject = '0x8000:01'\nhex = '00'\n"
    config = f"{table}transition = 'SO'\n[gateway]\nlisten = []\n"
    daemon = start_daemon(str(rig), config=config)
    states = [row["text"] for row in daemon.slave_rows("state")]
    assert (states[3], states[1]) == ("PREOP", "OP")


@pytest.mark.long
def test_slaves_are_told_on_the_way_down(start: Start) -> None:
    rows = [
        ("SO", "0x6083", 1000),
        ("SP", "0x6084", 3000),
        ("PS", "0x6085", 500),
        ("SP", "0x6085", 600),
        ("OS", "0x6041", 4),
        ("OS", "0x6083", 2000),
    ]
    config = "[gateway]\nlisten = []\n[[slave]]\nposition = 1\n" + "".join(
        f'[[slave.startup]]\nobject = "{index}:00"\ntype = "uint{16 if value < 100 else 32}"\n'
        f'value = {value}\ntransition = "{transition}"\n'
        for transition, index, value in rows
    )
    daemon = start(config).daemon

    def has(index: str) -> int:
        return int(daemon.ctl_json("sdo-read", str(AXIS), index, "0")["value"])

    def ask(state: str) -> tuple[int, int]:
        daemon.ctl("state", str(AXIS), state, "--yes")
        return has("0x6083"), has("0x6084")

    at_first = has("0x6084")
    assert has("0x6083") == 1000
    assert ask("SAFEOP") == (2000, at_first)
    assert ask("OP") == (1000, at_first)
    assert ask("PREOP") == (2000, 3000)
    daemon.ctl("sdo-write", str(AXIS), "0x6084", "0", "7")
    assert has("0x6085") == 600
    assert ask("OP") == (1000, 7)
    assert has("0x6085") == 500
    assert ask("PREOP") == (2000, 3000), "both on the way through SAFEOP"
    assert ask("OP") == (1000, 3000)
    # What is refused on the way down is told, and holds nobody up, also at the end.
    said = daemon.log.count("refuses its start-up parameter 0x6041:00 = 4")
    assert said == 3
    assert daemon.stop() == 0
    assert daemon.log.count("refuses its start-up parameter 0x6041:00 = 4") == said + 1


TOLD = """
[gateway]
listen = []
[recovery]
slaves = "none"
[[slave]]
position = 2
[[slave.startup]]
object = "0x6065:00"
type = "uint32"
value = 1234
[[slave.startup]]
object = "0x6081:00"
type = "uint32"
value = 77
transition = "SO"
"""


def restart(bench: Bench) -> None:
    """Switches the drive off and on; it has forgotten what it was told."""
    bench.power(DRIVE, on=False)
    bench.wait_for(lambda: bench.health().slaves_found == DRIVE)
    bench.power(DRIVE, on=True)
    bench.wait_for(lambda: bench.health().slaves_found == DRIVE + 1)


def told(bench: Bench) -> tuple[object, object]:
    """The values of its start-up parameters; it is in OP."""
    assert bench.daemon.slave_rows()[DRIVE]["state"] == "OP"
    return value(bench.daemon, DRIVE, "0x6065"), value(bench.daemon, DRIVE, "0x6081")


@pytest.mark.long
def test_a_slave_that_stopped_in_preop_is_told_on_the_way_up(start: Start) -> None:
    bench = start(TOLD)
    restart(bench)
    bench.daemon.ctl("state", str(DRIVE), "PREOP", "--yes")
    assert value(bench.daemon, DRIVE, "0x6065") != 1234
    bench.daemon.ctl("state", str(DRIVE), "OP")
    assert told(bench) == (1234, 77)
    # It keeps what is written to it in PREOP, when it has been told before.
    bench.daemon.ctl("state", str(DRIVE), "PREOP", "--yes")
    bench.daemon.ctl("sdo-write", str(DRIVE), "0x6065", "0", "5")
    bench.daemon.ctl("state", str(DRIVE), "OP")
    assert told(bench) == (5, 77)


@pytest.mark.long
def test_a_slave_that_was_not_told_everything_is_told_it_again(start: Start) -> None:
    bench = start(TOLD)
    restart(bench)
    bench.ctl("mailbox", str(DRIVE), "stuck")
    failed = bench.daemon.ctl("state", str(DRIVE), "OP", check=False)
    assert failed.returncode == 7
    names(one_line_error(failed.stderr, "ecatctl"), "slave 2", "mailbox")
    assert bench.daemon.slave_rows()[DRIVE]["state"] == "PREOP"
    bench.ctl("mailbox", str(DRIVE), "none")
    bench.daemon.ctl("state", str(DRIVE), "OP")
    assert told(bench) == (1234, 77)


@pytest.mark.long
def test_a_slow_slave_has_the_time_that_it_needs(start: Start) -> None:
    config = "[gateway]\nlisten = []\n[[slave]]\nposition = 1\nmailbox_timeout_ms = 9000\n"
    bench = start(config)
    daemon = bench.daemon
    for slave in (AXIS, DRIVE):
        bench.ctl("mailbox", str(slave), "slow", "--delay-s", "2.5")
    answer = daemon.ctl("sdo-read", str(AXIS), "0x1018", "1")
    names(answer.stdout, "0x0000FFFF")
    silent = daemon.ctl("sdo-read", str(DRIVE), "0x1018", "1", check=False)
    assert silent.returncode == 4, silent.stderr


def test_a_slave_is_asked_as_often_as_configured(start: Start) -> None:
    tables = f"[[slave]]\nposition = {AXIS}\nmailbox_tries = 1\n"
    bench = start(f'[gateway]\nlisten = []\n[log]\nmailbox = "debug"\n{tables}')
    bench.ctl("mailbox", str(AXIS), "stuck")
    silent = bench.daemon.ctl("sdo-read", str(AXIS), "0x1018", "1", check=False)
    assert silent.returncode == 4, silent.stderr
    bench.wait_for_log(f"slave {AXIS}, 0x1018:01: try 1 of 1:")
    bench.ctl("mailbox", str(AXIS), "none")
    assert value(bench.daemon, AXIS, "0x1018", 1) == 0xFFFF


def test_a_mailbox_is_looked_at_as_often_as_configured(start: Start) -> None:
    bench = start(
        f"[gateway]\nlisten = []\n[[slave]]\nposition = {AXIS}\nmailbox_poll_ms = 0\n"
        f"[[slave]]\nposition = {DRIVE}\nmailbox_poll_ms = 10\n"
    )
    with Simulator(str(bench.simulator)) as simulator:
        simulator.faults.emergency(AXIS, 0x3210, register=0x04)
        for code in (0x3220, 0x3221, 0x3222):
            simulator.faults.emergency(DRIVE, code, register=0x04)
            bench.wait_for_event("emergency", slave=DRIVE, code=code)
        assert f"slave {AXIS} (CiA402) sent an emergency" not in bench.daemon.log
        # It comes with the answer to a request.
        assert value(bench.daemon, AXIS, "0x1018", 1) == 0xFFFF
        bench.wait_for_event("emergency", slave=AXIS, code=0x3210)


def test_recovery_tells_a_slave_on_its_way_down(start: Start) -> None:
    config = f"""
[gateway]
listen = []
[[slave]]
position = {AXIS}
[[slave.startup]]
object = "0x6084:00"
type = "uint32"
value = 3000
transition = "SP"
"""
    bench = start(config)
    daemon = bench.daemon
    assert value(daemon, AXIS, "0x6084") != 3000
    # It says that it needs PREOP (ETG.1020), so recovery sets it up anew, from SAFEOP on.
    bench.ctl("al-error", str(AXIS), "0x0021", "--state", "SAFEOP")
    bench.wait_for_event("recovery", slave=AXIS, state="set_up")
    in_op(bench)
    assert value(daemon, AXIS, "0x6084") == 3000


@pytest.mark.long
def test_a_dead_mailbox_is_tried_once_at_the_end(start: Start) -> None:
    rows = [("OS", "0x6083"), ("SP", "0x6084")]
    config = f"[gateway]\nlisten = []\n[[slave]]\nposition = {AXIS}\n" + "".join(
        f'[[slave.startup]]\nobject = "{index}:00"\nhex = "01 00 00 00"\ntransition = "{name}"\n'
        for name, index in rows
    )
    bench = start(config)
    bench.ctl("mailbox", str(AXIS), "stuck")
    assert bench.daemon.stop() == 0
    assert bench.daemon.log.count("does not answer its mailbox") == 1
    assert "is killed" not in bench.daemon.log

"""Explicit device identification: it finds a slave wherever it stands, and when it comes back."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from test_bad_conditions import Bench

from conftest import Daemon, names, one_line_error, wait_for

pytestmark = pytest.mark.bus

DRIVE = "vendor = 0xFFFF\nproduct = 0x402\n"
CONFIG = f"""
[gateway]
listen = []
[recovery]
retry_s = 0.5
[[slave]]
identification = 42
name = "spindle"
{DRIVE}
[[slave.startup]]
object = "0x6065:00"
type = "uint32"
value = 4711
"""
SENSOR = """
[[slave]]
vendor = 0xF00D
product = 1
revision = 1
order = "Sensor"
device_id = 42
device_id_register = 0x0F80
[[slave.pdo]]
index = 0x1A00
entry = [{ index = 0x6000, subindex = 1, type = "UNSIGNED16" }]
"""

Start = Callable[..., Daemon]


def drive(identification: int | None = None) -> str:
    more = "" if identification is None else f"device_id = {identification}\n"
    return f'[[slave]]\ndevice = "CiA402"\n{more}'


COUPLER = '[[slave]]\ndevice = "EK1100"\n'


@pytest.fixture
def start(start_daemon: Callable[..., Daemon], tmp_path: Path) -> Start:
    def start(*slaves: str, config: str = CONFIG, ready: bool = True) -> Daemon:
        rig = tmp_path / "rig.toml"
        rig.write_text('name = "machine"\n' + "".join(slaves))
        return start_daemon(str(rig), config=config, ready=ready)

    return start


@pytest.fixture
def bench(start: Start) -> Iterator[Bench]:
    """Two equal drives with different identifications; the second one is meant."""
    bench = Bench(start(COUPLER, drive(7), drive(42)))
    yield bench
    bench.close()


def test_an_identification_finds_a_slave(start: Start) -> None:
    for slaves, place in (([COUPLER, drive(7), drive(42)], 2), ([drive(42), COUPLER, drive()], 0)):
        daemon = start(*slaves)
        assert daemon.slave_rows()[place]["given_name"] == "spindle"
        assert daemon.ctl_json("sdo-read", "spindle", "0x6065")["value"] == 4711
        wait_for(lambda: {row["state"] for row in daemon.slave_rows()} == {"OP"}, daemon)  # noqa: B023
        assert daemon.slave_rows()[place]["identification"] == 42
        names(daemon.ctl("slaves").stdout, "IDENT", "42")
        names(daemon.ctl("config", "init").stdout, "identification = 42", "identification 42")
        assert daemon.stop() == 0


def test_an_identification_may_be_in_a_register(start: Start) -> None:
    config = CONFIG[: CONFIG.index("[[slave.startup]]")].replace(DRIVE, "")
    daemon = start(COUPLER, SENSOR, config=config)
    rows = daemon.slave_rows()
    assert [row["given_name"] for row in rows] == ["", "spindle"]
    assert [row["identification"] for row in rows] == [0, 42]
    assert daemon.stop() == 0
    # Without a configuration, too, the EEPROM says where it is.
    daemon = start(COUPLER, SENSOR, config="[gateway]\nlisten = []\n")
    names(daemon.ctl("config", "init").stdout, "# identification = 42")


@pytest.mark.parametrize(
    ("slaves", "tokens"),
    [
        ([drive(42), drive(42)], ["slaves 0, 1", "the same identification", "42", "spindle"]),
        ([COUPLER, drive(41)], ["spindle", "missing", "tells the identification 42", "selector"]),
        pytest.param(
            [COUPLER, drive()],
            ["spindle", "missing", "slave 1 (CiA402) cannot tell any"],
            marks=pytest.mark.long,
        ),
        pytest.param(
            [drive(0)],
            ["spindle", "missing", "slave 0 (CiA402) cannot tell any"],
            marks=pytest.mark.long,
        ),
    ],
)
def test_who_is_meant_must_be_clear(start: Start, slaves: list[str], tokens: list[str]) -> None:
    status, log = start(*slaves, ready=False).wait_end()
    assert status == 7, log
    (line,) = [line for line in log.splitlines() if "bus not as expected" in line]
    names(line, "error", *tokens)


def test_differences_count_the_slaves_of_the_wire(start: Start) -> None:
    """Positions may be others: optional slaves that tell their identification come last."""
    wanted = CONFIG.replace('name = "spindle"', 'name = "spindle"\noptional = true')
    coupler = "[[slave]]\nposition = 0\nvendor = 2\nproduct = 0x044C2C52\n"
    expected = "[expected]\nunlisted = false\n"
    slaves = (COUPLER, drive(42), drive(7))
    _, log = start(*slaves, config=expected + coupler + wanted, ready=False).wait_end()
    names(one_line_error(log, "ecatd"), "slave 2 (CiA402)", "extra")
    daemon = start(*slaves, config=f'{expected}policy = "tolerant"\n{coupler}{wanted}')
    names(daemon.log, "not as expected: slave 2 (CiA402) is extra")
    rows = daemon.slave_rows("slaves")
    assert [row["state"] for row in rows] == ["OP", "PREOP", "OP"]
    assert [row["given_name"] for row in rows] == ["", "", "spindle"]


@pytest.mark.long
def test_a_slave_that_comes_back_must_tell_it_again(bench: Bench) -> None:
    daemon = bench.daemon
    for value, condition, text in (
        (7, "exchanged", "a device with the identification 7, not 42"),
        (0, "missing", "does not tell its identification, which must be 42"),
    ):
        bench.power(2, on=False)
        bench.wait_for(lambda: bench.health().slaves_found == 2)
        bench.ctl("identification", "2", str(value))
        bench.power(2, on=True)
        bench.wait_for_log(text)
        row = daemon.slave_rows()[2]
        assert (row["state"], row["recovery"]) == ("no answer", condition)
        assert daemon.slave_rows()[1]["state"] == "OP"
    bench.ctl("identification", "2", "42")  # it has its power, and is asked again
    bench.wait_for_log("slave 2 (spindle, CiA402): back in OP")
    assert daemon.ctl_json("sdo-read", "spindle", "0x6065")["value"] == 4711


@pytest.mark.long
def test_an_optional_slave_with_another_mark_is_told_once(start: Start, tmp_path: Path) -> None:
    wanted = CONFIG.replace('name = "spindle"', 'name = "spindle"\noptional = true')
    daemon = start(COUPLER, drive(42), config="[gateway]\nlisten = []\n")
    daemon.ctl("scan", "-o", str(tmp_path / "full.json"))
    assert daemon.stop() == 0
    described = f'[expected]\ndescription = "{tmp_path / "full.json"}"\n'
    bench = Bench(start(COUPLER, drive(42), config=described + wanted))
    try:
        for number, (change, text) in enumerate(
            (
                (("identification", "1", "7"), "the identification 7, not 42"),
                (("identification", "1", "0"), "does not tell its identification"),
                (("swap", "1", "EL2004"), "product 0x07D43052"),
            )
        ):
            bench.power(1, on=False)
            bench.ctl(*change)
            bench.power(1, on=True)
            bench.wait_for_log(text)
            row = bench.daemon.slave_rows("state")[1]
            assert (row["al_state"], row["recovery"]) == (
                0,
                "missing" if number == 1 else "exchanged",
            )
            names(row["recovery_text"], text)
        bench.wait_for_event("recovery", slave=1, state="exchanged")
        assert all(bench.daemon.log.count(text) == 1 for text in ("7, not 42", "0x07D43052"))
    finally:
        bench.close()

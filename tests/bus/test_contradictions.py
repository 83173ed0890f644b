"""Slaves whose witnesses contradict each other: who is believed, and who stays below SAFEOP.

The others come to OP in every case.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from conftest import Daemon, names, wait_for
from ecatd.shm.contract import WkcState

pytestmark = pytest.mark.bus

RIG = Path(__file__).parents[1] / "rigs" / "witnesses.py"
REFUSING_RIG = RIG.with_name("refusing_states.py")
OUT, PADDED, CHOSEN, DESCRIBED, HOLE, UNKNOWN, SHORT, UNSIZED, WORDLESS, EXCHANGED, STUCK = range(
    11
)
OVERLAPPING, SWAPPED, REFUSING, IN = range(11, 15)
BY_ITSELF = {
    PADDED: ("PREOP", "contradicted"),
    UNKNOWN: ("PREOP", "unreadable"),
    SHORT: ("PREOP", "unreadable"),
    STUCK: ("INIT+ERROR", "stuck"),
    OVERLAPPING: ("PREOP", "damaged"),
    REFUSING: ("PREOP", "stuck"),
}


def mapped(index: int, bit: int, word: int) -> str:
    return f"""
[[slave.pdo]]
index = 0x{index:04X}
entries = [
  {{ object = "0x{bit:04X}:01", bits = 1 }}, {{ object = "0x{bit:04X}:02", bits = 1 }},
  {{ bits = 6 }}, {{ object = "0x{word:04X}:00", bits = 16 }},
]
"""


TABLES = mapped(0x1600, 0x7000, 0x7016) + mapped(0x1A00, 0x6000, 0x6016)
CONFIG = f"""
[gateway]
listen = []
[expected]
policy = "tolerant"
[[slave]]
position = {CHOSEN}
pdo_source = "sii"
[[slave]]
position = {DESCRIBED}
pdo_source = "configuration"
{TABLES}
"""


@pytest.fixture(scope="module")
def daemon(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    daemon = Daemon(tmp_path_factory.mktemp("w"), str(RIG), config=CONFIG).wait_ready()
    yield daemon
    assert daemon.stop() == 0
    daemon.close()


def warning(daemon: Daemon, position: int) -> str:
    """The warnings about a slave."""
    lines = daemon.log.splitlines()
    return "\n".join(line for line in lines if f"warning: slave {position} (" in line)


def test_who_is_used(daemon: Daemon) -> None:
    rows: list[dict[str, Any]] = []
    expected = [BY_ITSELF.get(n, ("OP", "")) for n in range(IN + 1)]

    def are_as_expected() -> bool:
        rows[:] = daemon.slave_rows("slaves")
        return [(row["state"], row["recovery"]) for row in rows] == expected

    wait_for(are_as_expected, daemon)
    assert {
        n: len(row["contradictions"]) for n, row in enumerate(rows) if row["contradictions"]
    } == {
        PADDED: 2,
        CHOSEN: 2,
        DESCRIBED: 2,
    }
    assert [item["believed"] for item in rows[CHOSEN]["contradictions"]] == ["sii"] * 2
    checked = daemon.ctl("check", check=False)
    assert checked.returncode == 1
    names(checked.stdout, "slave 1 (Padded)", "0x7016:00 at bit 2", "the EEPROM at bit 8")


def test_the_log_says_who_says_what(daemon: Daemon) -> None:
    names(
        warning(daemon, PADDED),
        "PDO 0x1600: CoE places 0x7016:00 at bit 2, the EEPROM at bit 8",
        "PDO 0x1A00: CoE places 0x6016:00 at bit 2, the EEPROM at bit 8",
        "pdo_source",
    )
    for slave, who in ((CHOSEN, "the EEPROM"), (DESCRIBED, "the configuration")):
        told = [line for line in daemon.log.splitlines() if f"ecatd: slave {slave} (" in line]
        names("\n".join(told), "0x7016:00 at bit 2", f"{who} is believed")
    names(warning(daemon, HOLE), "0x1A01", "0x06020000", "taken from the EEPROM")
    names(warning(daemon, UNKNOWN), "PDO 0x1A01", "0x06020000", "EEPROM")
    names(warning(daemon, SHORT), "sync manager 3", "6 bytes", "has 4 by its EEPROM")
    names(warning(daemon, WORDLESS), "words 0x18 to 0x1B", "sync managers count", "with CoE")
    names(warning(daemon, EXCHANGED), "0x1C13:01 is 0x001A", "0x1A00")
    names(warning(daemon, STUCK), "PREOP", "0x0051")
    names(warning(daemon, OVERLAPPING), "sync managers 2 and 3 overlap", "SAFEOP", "0x001E")
    names(warning(daemon, REFUSING), "stays in PREOP", "SAFEOP", "0x001E")
    names(warning(daemon, SWAPPED), "usage is 3 (outputs)", "its PDOs count: inputs")
    assert not any(warning(daemon, n) for n in (OUT, CHOSEN, DESCRIBED, UNSIZED, IN))


def test_the_numbers_are_right(daemon: Daemon) -> None:
    with daemon.client() as client:
        for n in (CHOSEN, DESCRIBED, UNSIZED, SWAPPED):
            client.claim(n, lease=30)
        client.signal(CHOSEN, 0x7016, 0).raw = 1000
        client.signal(DESCRIBED, 0x7016, 0).raw = 2000
        client.signal(UNSIZED, 0x7000, 1).raw = 3000
        client.signal(SWAPPED, 0x7000, 1).raw = 4000
        client.commit()

        def read() -> list[float]:
            client.wait()
            client.sample()
            return [
                *(client.signal(n, 0x6016, 0).raw for n in (CHOSEN, DESCRIBED)),
                *(client.signal(n, 0x6000, 1).raw for n in (UNSIZED, SWAPPED)),
                *(client.signal(HOLE, 0x6000 + 16 * at, 1).raw for at in range(3)),
            ]

        expected = [1000 + 0x1234, 2000 + 0x1234, 3000, 4000, 0x1111, 0x2222, 0x3333]
        wait_for(lambda: read() == expected, daemon)


def test_uploads_without_a_size_have_that_of_their_type(daemon: Daemon) -> None:
    for arguments, value in (
        (("0x1018", "1"), 0xFFFF),
        (("0x7000", "1"), 0),
        (("0x1C12", "0"), 1),
        (("0x1C12", "1"), 0x1600),
        (("0x2000",), "ab"),
        (("0x2001",), "01 02 03"),
    ):
        found = daemon.ctl_json("sdo-read", str(UNSIZED), *arguments)
        assert found["value"] == value, found
    refused = daemon.ctl("sdo-write", str(UNSIZED), "0x1C12", "1", "0x1600", check=False)
    assert "0x1C12" in refused.stderr


def test_a_contradicted_slave_is_not_taken_to_op_by_hand(daemon: Daemon) -> None:
    for state in ("SAFEOP", "OP"):
        refused = daemon.ctl("state", str(PADDED), state, check=False)
        assert refused.returncode == 7
        names(refused.stderr, "CoE places 0x7016:00 at bit 2, the EEPROM at bit 8", "pdo_source")
    assert daemon.slave_rows("slaves")[PADDED]["state"] == "PREOP"


def test_a_slave_is_believed_in_the_same_way_when_it_comes_back(daemon: Daemon) -> None:
    for n in (CHOSEN, HOLE):
        daemon.ctl("state", str(n), "INIT", "--yes")
        daemon.ctl("state", str(n), "OP")
        assert daemon.slave_rows("slaves")[n]["state"] == "OP"


ESI = """<?xml version="1.0"?>
<EtherCATInfo><Vendor><Id>#xFFFF</Id><Name>V</Name></Vendor><Descriptions>
<Groups><Group><Type>G</Type><Name>G</Name></Group></Groups><Devices>
<Device Physics="YY"><Type ProductCode="#x863" RevisionNo="1">Padded</Type><Name>Padded</Name>
<GroupType>G</GroupType>
<Sm>MBoxOut</Sm><Sm>MBoxIn</Sm><Sm>Outputs</Sm><Sm>Inputs</Sm>
<TxPdo Fixed="1" Sm="3"><Index>#x1A00</Index><Name>In</Name>
<Entry><Index>#x6000</Index><SubIndex>1</SubIndex><BitLen>1</BitLen></Entry>
<Entry><Index>#x6000</Index><SubIndex>2</SubIndex><BitLen>1</BitLen></Entry>
<Entry><Index>0</Index><BitLen>6</BitLen></Entry>
<Entry><Index>#x6016</Index><BitLen>16</BitLen></Entry></TxPdo>
<Mailbox><CoE/></Mailbox></Device></Devices></Descriptions></EtherCATInfo>
"""


def test_config_check_says_it_in_advance(daemon: Daemon, tmp_path: Path) -> None:
    plain, chosen, esi = tmp_path / "plain.toml", tmp_path / "chosen.toml", tmp_path / "v.xml"
    plain.write_text(CONFIG)
    chosen.write_text(CONFIG + f'[[slave]]\nposition = {PADDED}\npdo_source = "sii"\n')
    esi.write_text(ESI)
    told = daemon.ctl("config", "check", str(plain), check=False)
    assert told.returncode == 7
    names(told.stdout, "slave 1 (Padded), PDO 0x1600: CoE places 0x7016:00 at bit 2", "pdo_source")
    told = daemon.ctl("config", "check", str(plain), "--esi", str(esi), check=False)
    assert (
        "CoE places 0x6016:00 at bit 2, the EEPROM and the ESI file at bit 8 (v.xml)" in told.stdout
    )
    assert 'pdo_source = "sii" in its [[slave]] table agrees with the ESI file' in told.stdout
    told = daemon.ctl("config", "check", str(chosen), "--esi", str(esi), check=False)
    assert "contradicting witnesses" not in told.stdout
    names(told.stdout, "believes the EEPROM")
    written = daemon.ctl("config", "init", "--esi", str(esi)).stdout
    assert 'pdo_source = "sii"' in written.partition(f"position = {PADDED}")[2].partition("[[")[0]


def test_a_strict_bus_does_not_start_without_a_slave_that_is_stuck(tmp_path: Path) -> None:
    daemon = Daemon(tmp_path, str(RIG))
    status, log = daemon.wait_end()
    daemon.close()
    assert status == 7
    names(log, "slave 10 (Stuck) does not reach PREOP", "0x0051", "tolerant")


def test_slaves_says_of_when_it_is(daemon: Daemon) -> None:
    daemon.ctl("alias", str(EXCHANGED), "77", "--yes")
    (before,) = [row for row in daemon.slave_rows("slaves") if row["position"] == EXCHANGED]
    assert before["alias"] == 0, "a slave uses a new alias when it is switched on again"
    daemon.ctl("reboot", str(EXCHANGED), "--yes")

    def is_back() -> bool:
        row = daemon.slave_rows("slaves")[EXCHANGED]
        return (row["state"], row["alias"]) == ("OP", 77)

    wait_for(is_back, daemon)
    last = daemon.ctl("slaves").stdout.splitlines()[-1]
    names(last, "STATE", "ALIAS", "read")


CLOCKS = """
cycle_time_us = 10000
[gateway]
listen = []
[dc]
lock_us = 400.0
timeout_s = 30.0
[[dc.slave]]
slave = 0
[[dc.slave]]
slave = 1
[expected]
policy = "POLICY"
"""


def test_slaves_that_only_the_exchange_can_try(start_daemon: Callable[..., Daemon]) -> None:
    """They are left out of it, so the values of the others are good."""
    daemon = start_daemon(str(REFUSING_RIG), config=CLOCKS.replace("POLICY", "tolerant"))
    rows = daemon.slave_rows("state")
    left_out = ("PREOP", "stuck")
    assert [(row["text"], row["recovery"]) for row in rows] == [
        ("OP", ""),
        left_out,
        left_out,
        ("OP", ""),
    ]
    why = "AL status 0x0036: DC: SYNC0 cycle time does not fit the application"
    names(rows[1]["recovery_text"], "PREOP", "SAFEOP", why)
    names(warning(daemon, 1), "without it", why, "restart ecatd")
    names(warning(daemon, 2), "OP", "SAFEOP+ERROR", "AL status 0x001D: Invalid output")
    names(daemon.ctl("check", check=False).stdout, "2 of 4 slaves in OP", "slave 1 (Slow)", why)
    with daemon.client() as client:
        client.wait()
        client.sample()
        assert client.domain(0).wkc_state == WkcState.COMPLETE


def test_they_end_a_strict_start(start_daemon: Callable[..., Daemon]) -> None:
    config = CLOCKS.replace("POLICY", "strict")
    status, log = start_daemon(str(REFUSING_RIG), config=config, ready=False).wait_end()
    assert status == 7
    names(log, "slave 1 (Slow) does not reach SAFEOP", "0x0036", 'policy = "tolerant"')

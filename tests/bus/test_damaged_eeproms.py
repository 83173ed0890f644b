"""Slaves with damaged EEPROMs: they are named, and the others come to OP."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from conftest import Daemon, names, run_module, wait_for
from ecatsim.control import Simulator

pytestmark = pytest.mark.bus

RIG = Path(__file__).parents[1] / "rigs" / "damaged.py"
IN, CUT_OUT, WITHOUT_END, WITHOUT_TEXT, MISPLACED, ERASED, MUTE, OUT = range(8)
USED, LEFT_OUT = ("OP", "damaged"), ("PREOP", "damaged")


@pytest.fixture(scope="module")
def damaged(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    daemon = Daemon(tmp_path_factory.mktemp("damaged"), str(RIG)).wait_ready()
    yield daemon
    assert daemon.stop() == 0
    daemon.close()


def warning(daemon: Daemon, slave: str) -> str:
    """The one warning of the daemon about a slave; the simulator warns about its image, too."""
    lines = [line for line in daemon.log.splitlines() if not line.startswith("ecatsim: ")]
    (line,) = [line for line in lines if f"warning: {slave}" in line]
    return line


def test_r32_which_slaves_take_part(damaged: Daemon) -> None:
    rows: list[dict[str, Any]] = []
    expected = [
        ("OP", ""),
        LEFT_OUT,
        USED,
        ("OP", ""),
        USED,
        LEFT_OUT,
        LEFT_OUT,
        ("OP", ""),
    ]

    def are_as_expected() -> bool:
        rows[:] = damaged.slave_rows("slaves")
        return [(row["state"], row["recovery"]) for row in rows] == expected

    wait_for(are_as_expected, damaged)
    sizes = [(row["output_bytes"], row["input_bytes"]) for row in rows]
    assert sizes == [(0, 1), (0, 0), (0, 2), (0, 2), (0, 2), (0, 0), (0, 0), (1, 0)]
    lines = run_module("ecatsim", "check", str(RIG)).stdout.splitlines()[2:]
    counted = [tuple(map(int, line.split()[2:4])) for line in lines]
    # What `Mute` has cannot be seen from outside; all others are counted as the master does.
    assert counted[:MUTE] + counted[OUT:] == sizes[:MUTE] + sizes[OUT:]


def test_the_log_says_what_is_wrong_and_what_is_done(damaged: Daemon) -> None:
    cut = warning(damaged, f"slave {CUT_OUT} (vendor 0x0000FFFF, product 0x00000031): its EEPROM")
    names(cut, "claims", "PREOP", "no process data", "write")
    endless = warning(damaged, f"slave {WITHOUT_END} (Endless): its EEPROM is damaged: byte 0x")
    names(endless, "category 60", "is used", "write")
    nameless = warning(damaged, f"slave {WITHOUT_TEXT} (Nameless): ")
    names(nameless, "EEPROM", "string 99")
    misplaced = warning(damaged, f"slave {MISPLACED} (Misplaced): its EEPROM is damaged: byte 0x")
    first, _, second = misplaced.partition("0x1A02")
    names(first, "TxPDO 0x1A01", "sync manager 1")
    names(second, "sync manager 9")
    assert "never written" in warning(damaged, f"slave {ERASED} (vendor 0xFFFF")
    mute = warning(damaged, f"slave {MUTE} (Mute): ")
    names(mute, "PREOP", "0x1A00", "sync manager 3", "describes 2", "write")
    about_eeproms = [line for line in damaged.log.splitlines() if "EEPROM" in line]
    assert not [n for n in (IN, OUT) for line in about_eeproms if f"warning: slave {n} " in line]


def test_the_slaves_are_shown_with_what_is_wrong(damaged: Daemon) -> None:
    rows = damaged.slave_rows("slaves")
    assert [len(row["problems"]) for row in rows] == [0, 2, 1, 1, 3, 1, 1, 0]
    wait_for(lambda: " PREOP, damaged " in damaged.ctl("slaves").stdout, damaged)
    shown = damaged.ctl("slaves").stdout
    assert " OP, damaged " in shown
    for row in rows:
        for problem in row["problems"]:
            name = f"slave {row['position']}" + (f" ({row['name']})" if row["name"] else "")
            assert f"\n{name}: EEPROM, {problem}\n" in shown
    names(damaged.ctl("state").stdout, "PREOP", "takes no part")
    assert (
        damaged.ctl_json("pdos")["slaves"][WITHOUT_END]["problems"]
        == (rows[WITHOUT_END]["problems"])
    )


def test_the_others_are_exchanged(damaged: Daemon) -> None:
    with damaged.client() as client, Simulator(str(damaged.child_pid("ecatsim"))) as simulator:
        signals = {s.slave: s for s in client.signals()}
        assert signals.keys() == {IN, WITHOUT_END, WITHOUT_TEXT, MISPLACED, OUT}
        client.claim(OUT, lease=30)
        client.signal(OUT, 0x7000, 1).raw = 1
        client.commit()

        def arrived() -> bool:
            client.wait()
            client.sample()
            return simulator.registers(OUT, 0x0F00, 1)[0] == 1

        wait_for(arrived, damaged)


def test_a_damaged_slave_can_be_taken_to_op_by_hand(damaged: Daemon) -> None:
    damaged.ctl("state", str(ERASED), "OP")
    assert damaged.slave_rows("slaves")[ERASED]["state"] == "OP"
    damaged.ctl("state", str(ERASED), "PREOP", "--yes")

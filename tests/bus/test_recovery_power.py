"""Devices that lose their power: couplers with terminals, branches, drives with settings, rings."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from test_bad_conditions import Bench

from conftest import Daemon, names, one_line_error
from ecatd.etg.al import AlState

pytestmark = [pytest.mark.bus, pytest.mark.long]

CYCLE_TIME_US = 1000
"""These tests count cycles."""

LONG_LINE = Path(__file__).parent.parent / "rigs" / "long_line.py"
CONFIG = "state_timeout_s = 10.0\n[gateway]\nlisten = []\n[recovery]\nretry_s = 1.0\n"
CONFIG += "[outputs]\nlease_max_ms = 60000\n"
DRIVE = 2

FORGETFUL = """
from ecatsim import Rig
from ecatsim.devices.generic import Loopback
from ecatsim.devices.generic_drive import CiA402Drive


class Forgetful(CiA402Drive):
    '''Forgets with its power what a tool had set up.'''

    def reset(self):
        super().reset()
        {forget}
        self._process_data.rebuild()


def rig():
    return Rig("forgetful", [Loopback(), Loopback(), Forgetful(), Loopback()])
"""

Start = Callable[[str], Bench]


@pytest.fixture
def start(start_daemon: Callable[..., Daemon]) -> Iterator[Start]:
    benches: list[Bench] = []

    def start(rig: str) -> Bench:
        bench = Bench(start_daemon(rig, config=CONFIG))
        benches.append(bench)
        bench.wait_for_data()
        return bench

    yield start
    for bench in benches:
        bench.close()


def conditions(bench: Bench) -> dict[int, str]:
    """What is said of slaves that are not in OP."""
    rows = bench.daemon.ctl_json("state")["slaves"]
    return {row["position"]: row["recovery"] for row in rows if row["recovery"]}


def in_op(bench: Bench) -> None:
    bench.wait_for_op()
    bench.wait_for_data()
    bench.wait_for(lambda: conditions(bench) == {})


ASSIGNMENT = (
    "self[0x1C12, 0], self[0x1C12, 1] = 1, 0x1601",
    "its outputs are other PDOs than at the start (0x1601 with 48 bits, not 0x1600 with 112 bits)",
    [("0x1C12", "0", "0"), ("0x1C12", "1", "0x1600"), ("0x1C12", "0", "1")],
)
MAPPING = (
    "self[0x1A00, 4], self[0x1A00, 5] = 0x606C0020, 0x60640020",
    "its PDO 0x1A00 carries other entries than at the start (entry 4 is 0x606C:00 with 32 bits, "
    "not 0x6064:00 with 32 bits)",
    [
        ("0x1A00", "0", "0"),
        ("0x1A00", "4", "0x60640020"),
        ("0x1A00", "5", "0x606C0020"),
        ("0x1A00", "0", "8"),
    ],
)
SHORTER = (
    "self[0x1600, 0] = 5",
    "its PDO 0x1600 carries other entries than at the start (5 entries, not 6)",
    [("0x1600", "0", "6")],
)


@pytest.mark.parametrize(
    ("forget", "text", "writes"),
    [ASSIGNMENT, MAPPING, SHORTER],
    ids=["assignment", "mapping", "shorter"],
)
def test_other_process_data_than_at_the_start(
    start: Start, tmp_path: Path, forget: str, text: str, writes: list[tuple[str, str, str]]
) -> None:
    rig = tmp_path / "forgetful.py"
    rig.write_text(FORGETFUL.format(forget=forget))
    bench = start(str(rig))
    with bench.daemon.client() as client:
        output, value = client.signal(3, 0x7000, 1), client.signal(3, 0x6000, 1)
        bench.power(DRIVE, on=False)
        bench.wait_for(lambda: conditions(bench).keys() == {2, 3})  # 3 is behind it
        bench.power(DRIVE, on=True)
        bench.wait_for_log(f"slave 2 (CiA402): {text}")
        bench.wait_for_event("recovery", slave=DRIVE, state="refused")
        bench.wait_for(lambda: conditions(bench) == {DRIVE: "refused"})
        states = [slave.al_state for slave in client.slaves()]
        assert states == [AlState.OP, AlState.OP, AlState.PREOP, AlState.OP]

        def arrives(number: int) -> bool:
            output.raw = number
            client.commit()
            client.wait()
            client.sample()
            return value.raw == number

        # Asked for OP as it is, it is refused by the same sentence.
        refused = bench.daemon.ctl("state", "2", "OP", check=False)
        assert (refused.returncode, refused.stderr.count("\n")) == (7, 1)
        assert f"slave 2 (CiA402): {text}" in refused.stderr
        for index, subindex, data in writes:
            kind = "uint32" if len(data) == len("0x60640020") else "uint16"
            kind = kind if subindex != "0" else "uint8"
            bench.daemon.ctl("sdo-write", "2", index, subindex, data, "--type", kind)
        bench.daemon.ctl("state", "2", "OP")
        client.claim(3, lease=20)  # only now: the commands above take long on a busy machine
        bench.wait_for(lambda: arrives(77))
        in_op(bench)
    # Once when it came back, and once as the reason why the request has failed.
    told = [line for line in bench.daemon.log.splitlines() if text in line]
    assert ["change from" in line for line in told] == [False, True]


def test_a_coupler_with_its_terminals(start: Start) -> None:
    """They get their power back in any order; the drive in front of them goes on."""
    bench = start("troll")
    terminals = range(1, 8)
    bench.power(*terminals, on=False)
    bench.wait_for(lambda: conditions(bench) == dict.fromkeys(terminals, "missing"))
    with bench.daemon.client() as client:
        assert client.slaves()[0].al_state == AlState.OP
    bench.power(5, 7, 1, 3, 2, 6, 4, on=True)
    in_op(bench)
    with bench.daemon.client() as client:
        constant = client.signal(5, 0x6010, 0x11)
        client.wait()
        client.sample()
        assert constant.raw == pytest.approx(-4 / 10 * 32767, abs=1)
    assert "another device" not in bench.daemon.log


JUNCTION, FIRST, SECOND, LAST = 3, (4, 5, 6), (7, 8, 9), 10


@pytest.mark.parametrize(
    "lost",
    [(5,), FIRST, SECOND, (JUNCTION,), (JUNCTION, *FIRST, *SECOND, LAST), tuple(range(11))],
    ids=["terminal", "first", "second", "junction", "all behind it", "all"],
)
def test_branches_behind_a_junction(start: Start, lost: tuple[int, ...]) -> None:
    bench = start("branches")
    bench.power(*lost, on=False)
    bench.wait_for(lambda: conditions(bench).keys() >= set(lost))
    bench.power(*reversed(lost), on=True)
    in_op(bench)
    assert "another device" not in bench.daemon.log


@pytest.mark.parametrize(("first", "then"), [(FIRST, SECOND), (SECOND, FIRST)])
def test_two_alike_branches_of_which_one_comes_back_first(
    start: Start, first: tuple[int, ...], then: tuple[int, ...]
) -> None:
    """Both begin with the same coupler; the terminals behind it tell them apart."""
    bench = start("branches")
    bench.power(*FIRST, *SECOND, on=False)
    bench.wait_for(lambda: conditions(bench) == dict.fromkeys((*FIRST, *SECOND), "missing"))
    bench.power(*first, on=True)
    bench.wait_for(lambda: conditions(bench) == dict.fromkeys(then, "missing"))
    bench.power(*then, on=True)
    in_op(bench)


def test_asking_by_hand_sets_up_a_slave_that_forgot_its_address(
    start_daemon: Callable[..., Daemon],
) -> None:
    """Where nobody else does."""
    config = CONFIG.replace("retry_s = 1.0", 'slaves = "none"').replace("= 10.0", "= 5.0")
    bench = Bench(start_daemon("troll", config=config))
    bench.wait_for_data()
    bench.power(4, 5, on=False)
    bench.wait_for(lambda: conditions(bench).keys() == {4, 5, 6, 7})
    result = bench.daemon.ctl("state", "5", "PREOP", "--yes", check=False)
    assert result.returncode == 7
    assert result.stderr.count("\n") == 1
    said = one_line_error(result.stderr, "ecatctl")
    names(said, "slave 5 (EL3008)", "no answer")
    bench.power(4, 5, on=True)
    bench.wait_for_log("no answer from slaves 4-5 at their address, though 8 slaves are there")
    bench.daemon.ctl("state", "5", "PREOP", "--yes")
    assert bench.daemon.ctl("sdo-read", "5", "0x1018", "1").stdout.startswith("0x00000002")
    assert conditions(bench).get(4) == "missing"
    bench.daemon.ctl("state", "OP")
    in_op(bench)
    bench.close()


def test_asking_by_hand_for_another_device(start: Start) -> None:
    bench = start("troll")
    bench.ctl("swap", "3", "EL2004")
    bench.wait_for_event("recovery", slave=3, state="exchanged")
    result = bench.daemon.ctl("state", "3", "OP", check=False)
    assert result.returncode == 7
    names(one_line_error(result.stderr, "ecatctl"), "slave 3 (EL2008)", "another device")
    bench.ctl("swap", "3", "original")
    in_op(bench)


def test_all_slaves_of_the_longest_line(start_daemon: Callable[..., Daemon]) -> None:
    """199 slaves lose their power and come back one after the other; the cycle goes on."""
    bench = Bench(start_daemon(str(LONG_LINE), config="cycle_time_us = 4000\n" + CONFIG))
    bench.wait_for_data()
    everybody = range(199)
    bench.power(*reversed(everybody), on=False)
    bench.wait_for(lambda: bench.health().slaves_found == 0)
    bench.power(*everybody, on=True)
    in_op(bench)
    bench.wait_for_event("recovery", slave=198, state="recovered")
    assert "another device" not in bench.daemon.log
    bench.close()


RING = "name = 'ring'\nring = true\n" + "[[slave]]\ndevice = 'Loopback32'\n" * 6


@pytest.fixture
def ring(start: Start, tmp_path: Path) -> Bench:
    rig = tmp_path / "ring.toml"
    rig.write_text(RING)
    bench = start(str(rig))
    bench.wait_for_log("the ring is closed")
    return bench


@pytest.mark.parametrize("lost", [(1,), (2,), (3,), (5,), (3, 4), (3, 4, 5), (0, 1)])
def test_power_lost_on_a_ring_that_is_broken(ring: Bench, lost: tuple[int, ...]) -> None:
    """Slaves on either side of the break, and at its ends; the break is still there afterwards."""
    ring.ctl("break-link", "3")
    ring.wait_for_log("the ring is broken between slave 2 (Loopback32) and slave 3 (Loopback32)")
    ring.wait_for_data()
    ring.power(*lost, on=False)
    ring.wait_for(lambda: conditions(ring).keys() >= set(lost))
    ring.power(*lost, on=True)
    in_op(ring)
    ring.ctl("heal-link", "3")
    ring.wait_for_log("the ring is closed", 2)
    in_op(ring)


@pytest.mark.parametrize("broken", [False, True])
def test_the_whole_ring_was_without_power(ring: Bench, broken: bool) -> None:
    everybody = tuple(range(6))
    ring.power(*everybody, on=False)
    ring.wait_for(lambda: conditions(ring) == dict.fromkeys(everybody, "missing"))
    if broken:
        ring.ctl("break-link", "2")
    ring.power(*everybody[::2], *everybody[1::2], on=True)
    in_op(ring)
    assert "another EtherCAT master" not in ring.daemon.log

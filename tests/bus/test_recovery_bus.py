"""Slaves that come back by themselves, on the real daemon: the others, and the cycle, go on."""

import contextlib
import threading
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest
from test_bad_conditions import Bench

from conftest import SHM, Daemon
from ecatd.etg.al import AlState
from ecatd.shm import contract as shm

pytestmark = [pytest.mark.bus, pytest.mark.long]

CYCLE_TIME_US = 1000
"""These tests count cycles."""

SLAVES = 7
MAILBOX = 1  # with CoE, as the last one
DOMAINS = "".join(f"[[domain]]\nname = 'd{i}'\nslaves = [{i}]\n" for i in range(1, SLAVES))
CONFIG = f"[[domain]]\nname = 'd0'\n{DOMAINS}[gateway]\nlisten = []\n[recovery]\nretry_s = 1.0\n"
CONFIG += "[outputs]\nlease_max_ms = 60000\n"
SIGNALS = "".join(f"[[dc.slave]]\nslave = {i}\n" for i in (0, 2, 3, 4, 5))
CLOCKS = f"[dc]\nenabled = true\nlock_us = 400.0\ntimeout_s = 30.0\n{SIGNALS}"

Start = Callable[..., Bench]


@pytest.fixture
def start(start_daemon: Callable[..., Daemon], tmp_path: Path) -> Iterator[Start]:
    """Starts six slaves, each in a domain of its own, so that each has a working counter."""
    benches: list[Bench] = []

    def start(*, clocks: bool = False, ring: bool = False, config: str = CONFIG) -> Bench:
        rig = tmp_path / "rig.toml"
        names = ["EL3008" if i in (MAILBOX, SLAVES - 1) else "Loopback32" for i in range(SLAVES)]
        devices = "".join(f"[[slave]]\ndevice = '{name}'\n" for name in names)
        rig.write_text(f"name = 'r'\nring = {str(ring).lower()}\n{devices}")
        bench = Bench(start_daemon(str(rig), config=config + (CLOCKS if clocks else "")))
        benches.append(bench)
        return bench

    yield start
    for bench in benches:
        bench.close()


@contextlib.contextmanager
def undisturbed(bench: Bench, positions: Iterable[int]) -> Iterator[None]:
    """Meanwhile the cycle goes on, outputs of these slaves arrive, and an SDO client reads."""
    positions = [position for position in positions if position not in (MAILBOX, SLAVES - 1)]
    over = threading.Event()
    wrong: list[str] = []
    rounds = [0]

    def exchange() -> None:
        with bench.daemon.client() as client:
            outputs = {i: client.signal(i, 0x7000, 1) for i in positions}
            inputs = {i: client.signal(i, 0x6000, 1) for i in positions}
            for i in positions:
                client.claim(i, lease=20)
            while not over.is_set():
                rounds[0] += 1
                for i in positions:
                    outputs[i].raw = rounds[0] % 200 + i
                client.commit()
                for _ in range(200):
                    client.wait()
                    client.sample()
                    if all(inputs[i].raw == rounds[0] % 200 + i for i in positions):
                        break
                else:
                    wrong.append(f"outputs of {positions} do not arrive")
                    return

    def read() -> None:
        while not over.is_set():
            result = bench.daemon.ctl("sdo-read", str(MAILBOX), "0x1018", "1", check=False)
            if result.returncode:
                wrong.append(result.stderr)

    before = cycle(bench)
    threads = [threading.Thread(target=work) for work in (exchange, read)]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        over.set()
        for thread in threads:
            thread.join()
    assert not wrong
    assert rounds[0] > 10
    assert "another EtherCAT master" not in bench.daemon.log
    assert cycle(bench) > before + 100


def cycle(bench: Bench) -> int:
    return int(header(bench).cycle)


def header(bench: Bench) -> Any:
    data = (SHM / bench.daemon.bus).read_bytes()
    return shm.struct("ecat_shm_header").from_buffer_copy(data)


def in_op(bench: Bench) -> None:
    """All slaves are in OP and take part, and nobody is being recovered."""
    bench.wait_for_op()

    def fine() -> bool:
        rows = bench.daemon.ctl_json("slaves")["slaves"]
        return all(row["state"] == "OP" and row["recovery"] == "" for row in rows)

    bench.wait_for(fine)
    with bench.daemon.client() as client:

        def complete() -> bool:
            client.wait()
            client.sample()
            return all(client.domain(i).wkc_state == shm.WkcState.COMPLETE for i in range(SLAVES))

        bench.wait_for(complete)


def condition(bench: Bench, position: int) -> str:
    return str(bench.daemon.ctl_json("slaves")["slaves"][position]["recovery"])


both = pytest.mark.parametrize("clocks", [False, True], ids=["", "dc"])
everywhere = pytest.mark.parametrize(
    ("clocks", "ring"), [(False, False), (True, True)], ids=["line", "ring with dc"]
)


@everywhere
def test_r06_a_slave_that_was_without_power(start: Start, clocks: bool, ring: bool) -> None:
    bench = start(clocks=clocks, ring=ring)
    in_op(bench)
    last = SLAVES - 1
    with undisturbed(bench, range(last)):
        bench.power(last, on=False)
        bench.wait_for(lambda: condition(bench, last) == "missing")
        bench.wait_for_event("recovery", slave=last, state="fallen")
        bench.power(last, on=True)
        bench.wait_for_log(f"slave {last} (EL3008): back in OP after")
        in_op(bench)
    bench.wait_for_event("recovery", slave=last, state="set_up")
    bench.wait_for_event("recovery", slave=last, state="recovered")
    cables = bench.daemon.ctl_json("errors")["links"]
    assert len(cables) == SLAVES + ring  # that of the second interface, too
    assert {row["verdict"] for row in cables} <= {"good", "unknown"}, cables  # no cable is blamed
    assert not any(row["lost_links"] for row in cables), cables


@everywhere
def test_slaves_in_the_middle_that_were_without_power(
    start: Start, clocks: bool, ring: bool
) -> None:
    """As a coupler with its terminals: all behind it are gone, and come back in any order."""
    bench = start(clocks=clocks, ring=ring)
    in_op(bench)
    with undisturbed(bench, range(3)):
        bench.power(3, 4, 5, 6, on=False)
        bench.wait_for(lambda: bench.health().slaves_found == 3)
        bench.power(5, 3, 6, 4, on=True)
        in_op(bench)


@both
def test_r06_the_whole_line_was_without_power(start: Start, clocks: bool) -> None:
    bench = start(clocks=clocks)
    in_op(bench)
    before = cycle(bench)
    bench.power(*range(SLAVES), on=False)
    bench.wait_for(lambda: bench.health().slaves_found == 0)
    bench.power(*range(SLAVES), on=True)
    in_op(bench)
    assert cycle(bench) > before


@both
def test_r05_a_cable_that_was_pulled_for_seconds(start: Start, clocks: bool) -> None:
    bench = start(clocks=clocks)
    in_op(bench)
    with undisturbed(bench, range(3)):
        bench.ctl("break-link", "3")
        bench.wait_for(lambda: condition(bench, 5) == "missing")
        bench.ctl("heal-link", "3")
        in_op(bench)


@pytest.mark.parametrize("code", ["0x001A", "0x001B", "0x002C", "0x0033", "0x0034", "0x0035"])
def test_a_slave_that_lacked_something(start: Start, code: str) -> None:
    bench = start(
        clocks=code != "0x001B"
    )  # the watchdog needs no clocks, the others are about them
    in_op(bench)
    with undisturbed(bench, range(3)):
        bench.ctl("al-error", "4", code)
        bench.wait_for_event("recovery", slave=4, state="asked")
        bench.wait_for_event("recovery", slave=4, state="recovered")
        in_op(bench)


@pytest.mark.parametrize("state", ["INIT", "PREOP"])
def test_a_slave_that_fell_further(start: Start, state: str) -> None:
    bench = start()
    in_op(bench)
    with undisturbed(bench, range(3)):
        bench.ctl("al-error", "4", "0x001B", "--state", state)
        bench.wait_for_event("recovery", slave=4, state="set_up")
        in_op(bench)


@pytest.mark.parametrize("code", ["0x0011", "0x001D", "0x001E", "0x8001"])
def test_r08_a_slave_with_a_reason_of_its_own(start: Start, code: str) -> None:
    bench = start()
    in_op(bench)
    with undisturbed(bench, range(3)):
        bench.ctl("al-error", "4", code)
        bench.wait_for_log(f"slave 4 (Loopback32) stays out of OP: AL status {code}")
        bench.wait_for_event("recovery", slave=4, state="refused")
        assert condition(bench, 4) == "refused"
    assert bench.daemon.log.count("stays out of OP") == 1
    assert not any(event.get("state") == "asked" for event in bench.events)
    said = bench.daemon.ctl("state", "4", "OP").stdout
    assert "waiting" not in said
    in_op(bench)


def test_r07_another_device_is_left_alone(start: Start) -> None:
    bench = start()
    in_op(bench)
    with undisturbed(bench, range(4)):
        bench.ctl("swap", "4", "EL2008")
        bench.wait_for_log("is in its place")
        bench.wait_for_event("recovery", slave=4, state="exchanged")
        bench.wait_for(lambda: condition(bench, 4) == "exchanged")
        line = next(
            line for line in bench.daemon.ctl("info").stdout.splitlines() if "exchanged" in line
        )
        assert "slave 4" in line
        # The one behind it comes back all the same, as far as its power goes.
        bench.wait_for(lambda: condition(bench, 5) == "")
        bench.ctl("swap", "4", "original")
        in_op(bench)
    # It is not told again and again; once more, if frames get lost meanwhile.
    assert bench.daemon.log.count("is in its place") <= 3


def test_a_state_that_a_user_wants_is_respected(start: Start) -> None:
    bench = start()
    in_op(bench)
    bench.daemon.ctl("state", "2", "PREOP", "--yes")
    bench.ctl("al-error", "4", "0x001B")
    bench.wait_for_event("recovery", slave=4, state="recovered")
    rows = bench.daemon.slave_rows("state")
    assert [row["text"] for row in rows] == ["OP", "OP", "PREOP", "OP", "OP", "OP", "OP"]
    bench.daemon.ctl("state", "2", "OP")
    in_op(bench)


def test_nothing_comes_back_where_that_is_not_wanted(start: Start) -> None:
    bench = start(config=CONFIG.replace("retry_s = 1.0", 'slaves = "none"'))
    in_op(bench)
    bench.power(5, on=False)
    bench.ctl("al-error", "4", "0x001B")
    bench.wait_for(lambda: condition(bench, 5) == "missing")
    bench.power(5, on=True)
    bench.wait_for_log("switched off and on, or exchanged; `ecatctl state 5 OP`")
    with bench.daemon.client() as client:
        slaves = client.slaves()
        assert slaves[4].al_state == AlState.SAFEOP | 0x10
        assert slaves[5].al_state == 0


def test_outputs_of_an_owner_go_on_when_its_slave_is_back(start: Start) -> None:
    bench = start()
    in_op(bench)
    with bench.daemon.client() as client:
        output, value = client.signal(5, 0x7000, 1), client.signal(5, 0x6000, 1)
        client.claim(5, lease=20)

        def arrives(number: int) -> bool:
            output.raw = number
            client.commit()
            client.wait()
            client.sample()
            return value.raw == number

        bench.wait_for(lambda: arrives(11))

        def is_away() -> bool:
            return not arrives(12) and client.domain(5).wkc_state == shm.WkcState.ZERO

        bench.power(5, on=False)
        bench.wait_for(is_away)
        bench.power(5, on=True)
        bench.wait_for(lambda: arrives(13))  # never claimed again

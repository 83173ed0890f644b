"""Each process of the daemon is killed, and gets each signal, while a drive turns.

The simulator is a process of its own here, which does not end with the daemon.
"""

import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from test_safe_stop import SPEED
from turning_drive import BUS, GATEWAY, MAIN, Machine, runs, turning_drive

from conftest import PATIENCE, SHM, names, wait_for

pytestmark = [pytest.mark.bus, pytest.mark.long]


@pytest.fixture
def machine(tmp_path: Path) -> Iterator[Machine]:
    with turning_drive(tmp_path) as machine:
        yield machine


def test_the_death_of_the_main_process_brakes_the_drive(machine: Machine) -> None:
    server = machine.pid(BUS)
    machine.send(MAIN, signal.SIGKILL)
    assert machine.speed_when_op_ends() < SPEED / 50
    machine.daemon.process.wait(PATIENCE)
    end = time.monotonic() + PATIENCE
    while runs(server):
        assert time.monotonic() < end, "the bus server does not end"
        time.sleep(0.02)
    assert not list(SHM.glob(f"{machine.daemon.bus}*"))


def test_r17_only_the_death_of_the_bus_server_is_left_to_the_watchdog(machine: Machine) -> None:
    machine.send(BUS, signal.SIGKILL)
    assert machine.speed_when_op_ends() > SPEED / 2
    status, log = machine.daemon.wait_end()
    assert status != 0
    names(log, "bus server", "signal 9")


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGQUIT])
def test_r18_the_gateway_ends_and_the_bus_goes_on(machine: Machine, number: int) -> None:
    before = machine.pid(GATEWAY)
    machine.send(GATEWAY, number)

    def there_is_another() -> bool:
        try:
            return machine.pid(GATEWAY) != before
        except AssertionError:
            return False

    wait_for(there_is_another, machine.daemon)
    assert machine.turns


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGQUIT])
def test_r23_signals_that_end_the_daemon(machine: Machine, number: int) -> None:
    machine.send(MAIN, number)
    assert machine.speed_when_op_ends() < SPEED / 50
    status, log = machine.daemon.wait_end()
    assert status == 0
    assert "Traceback" not in log
    assert not list(SHM.glob(f"{machine.daemon.bus}*"))


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGQUIT])
def test_signals_that_end_the_bus_server_brake_the_drive(machine: Machine, number: int) -> None:
    machine.send(BUS, number)
    assert machine.speed_when_op_ends() < SPEED / 50
    status, log = machine.daemon.wait_end()
    assert status == 7
    names(log, "bus server", "unexpectedly")
    assert not list(SHM.glob(f"{machine.daemon.bus}*"))


@pytest.mark.parametrize(
    ("process", "number"),
    [
        *((process, signal.SIGPIPE) for process in (MAIN, BUS, GATEWAY)),
        *((child, number) for child in (BUS, GATEWAY) for number in (signal.SIGINT, signal.SIGHUP)),
        (MAIN, signal.SIGHUP),
    ],
)
def test_signals_that_end_nothing(machine: Machine, process: str, number: int) -> None:
    pids = [machine.pid(one) for one in (MAIN, BUS, GATEWAY)]
    machine.send(process, number)
    if (process, number) == (MAIN, signal.SIGHUP):
        wait_for(lambda: "configuration read again" in machine.daemon.log, machine.daemon)
    machine.daemon.ctl("info")
    assert [machine.pid(one) for one in (MAIN, BUS, GATEWAY)] == pids
    assert machine.turns


def test_who_goes_first_without_memory(machine: Machine) -> None:
    scores = [
        int(Path(f"/proc/{machine.pid(one)}/oom_score_adj").read_text())
        for one in (GATEWAY, MAIN, BUS)
    ]
    assert scores[0] > scores[1] >= scores[2]

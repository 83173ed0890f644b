"""Each process of the daemon is killed, and gets each signal, while a drive turns.

The simulator is a process of its own here, which does not end with the daemon.
"""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from test_safe_stop import SPEED, Drive, stop_rule

from conftest import PATIENCE, SHM, Daemon, names, wait_for
from ecatd.network_namespace import join
from ecatsim.control import Simulator

pytestmark = [pytest.mark.bus, pytest.mark.long]

MAIN, BUS, GATEWAY = "main", "ecatd.bus", "ecatd.gateway"
VELOCITY, STATUS_WORD = 0x606C, 0x6041
NO_WATCHDOG = """
[[slave]]
position = 0
watchdog_ms = 300
"""


class Machine:
    """A daemon with a drive that turns, and the simulator beside it."""

    def __init__(self, daemon: Daemon, simulator: Simulator) -> None:
        self.daemon = daemon
        self.simulator = simulator

    def pid(self, process: str) -> int:
        return self.daemon.process.pid if process == MAIN else self.daemon.child_pid(process)

    def send(self, process: str, number: int) -> None:
        os.kill(self.pid(process), number)

    @property
    def speed(self) -> int:
        return abs(self.simulator.get(0, VELOCITY))

    @property
    def turns(self) -> bool:
        return self.speed > 0.9 * SPEED

    def speed_when_op_ends(self) -> int:
        """Speed of the drive when it leaves OP, or has come to a stop before."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            speed = self.speed
            if self.simulator.status().slaves[0].state != "OP" or speed == 0:
                return speed
        raise AssertionError(f"the drive stays in OP, and turns:\n{self.daemon.log}")


def runs(pid: int) -> bool:
    """Whether a process has not ended; one that nobody waits for has."""
    try:
        return bool(Path(f"/proc/{pid}/cmdline").read_bytes())
    except OSError:
        return False


@pytest.fixture
def machine(tmp_path: Path) -> Iterator[Machine]:
    read, write = os.pipe()
    rig = subprocess.Popen(
        [
            *(sys.executable, "-m", "ecatsim", "run", "troll", "--ready-fd", str(write)),
            *("--", "sleep", "infinity"),
        ],
        pass_fds=(write,),
    )
    os.close(write)
    daemon = None
    try:
        with os.fdopen(read) as ready:
            at = json.loads(ready.readline())
        with Simulator(str(rig.pid)) as simulator:
            daemon = Daemon(
                tmp_path,
                "",
                *("--interface", at["interface"]),
                config=stop_rule("quick_stop", NO_WATCHDOG),
                preexec=lambda: join(at["pid"]),
            ).wait_ready()
            with Drive(daemon) as drive:
                drive.brake_slowly()
                drive.run()
                yield Machine(daemon, simulator)
    finally:
        if daemon is not None:
            daemon.close()
        rig.terminate()
        rig.wait(PATIENCE)


def test_the_death_of_the_main_process_brakes_the_drive(machine: Machine) -> None:
    server = machine.pid(BUS)
    machine.send(MAIN, signal.SIGKILL)
    assert machine.speed_when_op_ends() < SPEED / 50
    machine.daemon.process.wait(PATIENCE)
    end = time.monotonic() + PATIENCE
    while runs(server):
        assert time.monotonic() < end, "the bus server does not end"
        time.sleep(0.02)
    assert not list(SHM.glob(f"ecat.{machine.daemon.bus}*"))


def test_only_the_death_of_the_bus_server_is_left_to_the_watchdog(machine: Machine) -> None:
    machine.send(BUS, signal.SIGKILL)
    assert machine.speed_when_op_ends() > SPEED / 2
    status, log = machine.daemon.wait_end()
    assert status != 0
    names(log, "bus server", "signal 9")


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGQUIT])
def test_the_gateway_ends_and_the_bus_goes_on(machine: Machine, number: int) -> None:
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
def test_signals_that_end_the_daemon(machine: Machine, number: int) -> None:
    machine.send(MAIN, number)
    assert machine.speed_when_op_ends() < SPEED / 50
    status, log = machine.daemon.wait_end()
    assert status == 0
    assert "Traceback" not in log
    assert not list(SHM.glob(f"ecat.{machine.daemon.bus}*"))


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGQUIT])
def test_signals_that_end_the_bus_server_brake_the_drive(machine: Machine, number: int) -> None:
    machine.send(BUS, number)
    assert machine.speed_when_op_ends() < SPEED / 50
    status, log = machine.daemon.wait_end()
    assert status == 7
    names(log, "bus server", "unexpectedly")
    assert not list(SHM.glob(f"ecat.{machine.daemon.bus}*"))


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

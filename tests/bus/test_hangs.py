"""Processes and threads of the daemon that hang while a drive turns, and what systemd is told.

A process is stopped by a signal, a single thread of it by `ptrace`.
"""

import ctypes
import os
import signal
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import pytest
from test_safe_stop import SPEED
from turning_drive import BUS, GATEWAY, Machine, turning_drive

from conftest import PATIENCE, Daemon, names, wait_for
from ecatsim.control import Simulator

pytestmark = pytest.mark.bus

SEIZE, INTERRUPT = 0x4206, 0x4207  # of ptrace(2)
WALL = 0x40000000  # of waitpid(2): threads, too


@pytest.fixture
def machine(tmp_path: Path) -> Iterator[Machine]:
    with turning_drive(tmp_path) as machine:
        yield machine


def thread_of(process: int, name: str) -> int:
    """The number of a thread."""
    tasks = Path(f"/proc/{process}/task").iterdir()
    (found,) = (task.name for task in tasks if (task / "comm").read_text().strip() == name)
    return int(found)


def stop_thread(thread: int) -> None:
    """Stops one thread of a process, and none of the others."""
    libc = ctypes.CDLL(None, use_errno=True)
    libc.ptrace.argtypes = [ctypes.c_long, ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p]
    for request in (SEIZE, INTERRUPT):
        assert libc.ptrace(request, thread, None, None) == 0, ctypes.get_errno()


def wait_end(machine: Machine, thread: int) -> tuple[int, str]:
    """Exit status and log of a daemon with a stopped thread, whose end its tracer has to see."""
    deadline = time.monotonic() + PATIENCE
    while machine.daemon.process.poll() is None:
        assert time.monotonic() < deadline, machine.daemon.log
        with suppress(ChildProcessError):
            os.waitpid(thread, os.WNOHANG | WALL)
        time.sleep(0.02)
    return machine.daemon.wait_end()


def see_it_replaced(machine: Machine, before: int, stopped: Sequence[int] = ()) -> None:
    """Waits for another gateway than `before`, whose threads `stopped` this process has stopped."""

    def there_is_another() -> bool:
        assert machine.turns
        for thread in stopped:  # their tracer has to see their end
            with suppress(ChildProcessError):
                os.waitpid(thread, os.WNOHANG | WALL)
        try:
            return machine.pid(GATEWAY) != before
        except AssertionError:
            return False

    wait_for(there_is_another, machine.daemon)
    names(machine.daemon.log, "gateway", "not answered", "starts it again", "bus goes on")
    wait_for(lambda: machine.daemon.ctl("check", check=False).returncode == 0, machine.daemon)
    assert machine.turns


@pytest.mark.long
def test_r18_a_gateway_that_hangs_is_replaced_and_the_bus_goes_on(machine: Machine) -> None:
    before = machine.pid(GATEWAY)
    machine.send(GATEWAY, signal.SIGSTOP)
    see_it_replaced(machine, before)


@pytest.mark.long
def test_r18_a_gateway_whose_zenoh_hangs_is_replaced(machine: Machine) -> None:
    """Its event loop goes on, but nobody gets an answer."""
    before = machine.pid(GATEWAY)
    tasks = [*Path(f"/proc/{before}/task").iterdir()]
    threads = [int(t.name) for t in tasks if (t / "comm").read_text().startswith("rx-")]
    for thread in threads:
        stop_thread(thread)
    see_it_replaced(machine, before, threads)


@pytest.mark.long
def test_r19_a_bus_server_that_is_stopped_ends_the_daemon(machine: Machine) -> None:
    machine.send(BUS, signal.SIGSTOP)
    status, log = machine.daemon.wait_end()
    assert status == 7
    names(log, "bus server", "not answered", "is killed", "starts ecatd again")
    assert "Traceback" not in log


@pytest.mark.long
@pytest.mark.parametrize("thread", ["main", "worker"])
def test_r19_the_engine_brakes_the_drive_if_nobody_controls_it(
    machine: Machine, thread: str
) -> None:
    server = machine.pid(BUS)
    stopped = server if thread == "main" else thread_of(server, "ecat-worker")
    stop_thread(stopped)
    assert machine.speed_when_op_ends() < SPEED / 50
    status, log = wait_end(machine, stopped)
    assert status == 7
    names(log, "bus server", "not answered", "is killed", "starts ecatd again")


@pytest.mark.long
def test_r18_a_main_process_that_hangs_is_told(machine: Machine) -> None:
    """Without systemd, whose watchdog would end it. The bus goes on meanwhile."""
    daemon = machine.daemon
    os.kill(daemon.process.pid, signal.SIGSTOP)
    wait_for(lambda: daemon.ctl("check", check=False).returncode == 1, daemon)
    names(daemon.ctl("check", check=False).stdout, "degraded", "main process", "restart ecatd")
    assert machine.turns
    machine.send(GATEWAY, signal.SIGKILL)  # the service will write to a process that is gone
    os.kill(daemon.process.pid, signal.SIGCONT)
    wait_for(lambda: daemon.ctl("check", check=False).returncode == 0, daemon)
    assert machine.turns
    assert daemon.stop() == 0
    assert "Traceback" not in daemon.log


@pytest.mark.long
def test_r19_an_engine_that_stands_still_is_noticed(machine: Machine) -> None:
    stopped = thread_of(machine.pid(BUS), "ecat-cyclic")
    stop_thread(stopped)
    status, log = wait_end(machine, stopped)
    assert status == 7
    names(log, "engine", "stood still", "starts ecatd again")


@pytest.mark.long
def test_systemd_is_told_how_the_slaves_are(tmp_path: Path) -> None:
    daemon = Daemon(tmp_path, "line:4").wait_ready()
    try:
        well = daemon.status
        names(well, "4 slaves", "in OP")
        with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
            simulator.faults.power_off(3)
            wait_for(lambda: "slave 3" in daemon.status, daemon)
            names(daemon.status, "3 of 4 slaves in OP", "missing", "since")
            simulator.faults.power_on(3)
            wait_for(lambda: daemon.status == well, daemon)
    finally:
        daemon.close()

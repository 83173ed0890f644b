"""The daemon dies, and another one takes its place: what its clients do, and what it heals.

`ECAT_RESTARTS=200` (`make death`) has it killed so often; without it a few times.
"""

import os
import random
import signal
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import PATIENCE, SHM, Daemon, wait_for
from handle import EBUSY, EDOWN, ELEASE, ESTALE, ETIMEOUT, Handle

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged, pytest.mark.long]

EL2008, DRIVE = 3, 0
"""Positions in the rig `troll`."""
RESTARTS = int(os.environ.get("ECAT_RESTARTS", "15"))
OWN = 1
"""Slave of `line:4` that the surviving writer owns."""


def restart(start_daemon: Callable[..., Daemon], daemon: Daemon) -> Daemon:
    again = start_daemon("troll", "--bus", daemon.bus)
    again.bus = daemon.bus
    return again


def test_r30_a_writer_goes_on_after_a_new_claim(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    with Handle(daemon.bus) as handle:
        before = handle.instance
        output = handle.bind(EL2008, 0x7000, 1, 1)
        assert handle.claim(EL2008, 30.0) == 0
        assert handle.write(output, 1.0) == 0
        assert handle.commit() == 0
        requests = [handle.sdo_start(DRIVE, 0x1018, 1, None, 0) for _ in range(2)]
        daemon.kill_all()
        while (code := handle.commit()) == 0:
            pass
        assert (code, "the daemon has ended" in handle.error) == (ELEASE, True)
        assert handle.write(output, 1.0) == ELEASE
        assert handle.sample() == EDOWN
        assert handle.commit() == ELEASE
        daemon = restart(start_daemon, daemon)
        while (code := handle.wait(1, 30.0)) == EDOWN:
            pass
        assert code == 0
        assert handle.instance != before
        assert handle.write(output, 1.0) == ELEASE
        assert handle.commit() == ELEASE
        for request in requests:
            # One may have been answered by the daemon that is gone, but nobody had asked for it.
            assert handle.poll(request, None, 0, None, None) == EDOWN
        assert handle.claim(EL2008, 30.0) == 0
        assert handle.write(output, 1.0) == 0
        assert handle.commit() == 0
        request = handle.sdo_start(DRIVE, 0x1018, 1, None, 0)
        while (code := handle.poll(request, None, 0, None, None)) == EBUSY:
            assert handle.wait(1, 30.0) == 0
            handle.sample()
        assert code == 0
        for _ in range(100):  # the exchange that is under way may have begun before the write
            assert handle.wait(1, 30.0) == 0
            assert handle.sample() == 0
            if handle.value(output) == 1:
                break
        assert handle.value(output) == 1
    assert daemon.stop() == 0


@pytest.mark.parametrize("command", ["ecatd.server", "ecatd.gateway tnobody"])
@pytest.mark.parametrize("said", ["", '{"config": {"bus'])
def test_a_child_whose_service_is_killed_at_once_ends_without_a_word(
    command: str, said: str
) -> None:
    child = subprocess.run(
        [sys.executable, "-m", *command.split()],
        input=said,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (child.returncode, child.stdout, child.stderr) == (0, "", "")


class Survivor(threading.Thread):
    """A client in a loop that no daemon's end stops.

    Attributes:
        down: CLOCK_MONOTONIC in s of the first call that said that the daemon is gone; None: up.
        instance: The daemon that it is connected to.
        rounds: Loops with this daemon in which everything was done.
    """

    def __init__(self, bus: str) -> None:
        super().__init__()
        self.handle = Handle(bus)
        self.down: float | None = None
        self.instance = self.handle.instance
        self.rounds = 0
        self.codes: set[int] = set()
        self.end = threading.Event()
        self.failed: BaseException | None = None

    def run(self) -> None:
        try:
            while not self.end.is_set():
                self._step()
        except BaseException as error:
            self.failed = error
        finally:
            self.handle.close()

    def _step(self) -> None:
        code = self.handle.wait(1, 1.0) or self.handle.sample()
        now = time.monotonic()
        self.codes.add(code)
        assert code in (0, EDOWN, ETIMEOUT, ESTALE), self.handle.error
        if code == EDOWN and self.down is None:
            self.down = now
        if code == 0:
            if self.handle.instance != self.instance:
                assert self.down is not None, "a new daemon, but nobody told that the old one ended"
                self.instance, self.rounds = self.handle.instance, 0
                self.begin()
            self.down = None
            self.rounds += self.work()

    def begin(self) -> None:
        """With a new daemon."""

    def work(self) -> bool:
        """In a cycle; whether all is as it should be."""
        return True

    def stop(self) -> None:
        self.end.set()
        self.join(PATIENCE)


class Writer(Survivor):
    """Claims again whenever it is told to, and only then."""

    def __init__(self, bus: str) -> None:
        super().__init__(bus)
        self.outputs = [self.handle.bind(OWN, 0x7000, n + 1, 1) for n in range(32)]
        self.value = 0
        assert self.handle.claim(OWN, 20.0) == 0

    def begin(self) -> None:
        assert self.handle.write(self.outputs[0], 1.0) == ELEASE
        assert self.handle.commit() == ELEASE

    def work(self) -> bool:
        self.value = self.value % 255 + 1
        for output in self.outputs:
            if self.handle.write(output, float(self.value)) != 0:
                break
        code = self.handle.commit()
        self.codes.add(code)
        if code == ELEASE:
            code = self.handle.claim(OWN, 20.0)
            assert code in (0, EDOWN, ESTALE), self.handle.error
            if code == EDOWN:  # told by this call, so perhaps by no other
                self.down = time.monotonic()
            return False
        return code == 0


def leftovers(daemon: Daemon) -> list[str]:
    """Processes of a daemon that was killed."""
    mark = f"ECATD_RUNTIME_DIR={daemon.env['ECATD_RUNTIME_DIR']}".encode()
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if mark in (folder / "environ").read_bytes().split(b"\0"):
                found.append((folder / "cmdline").read_text().replace("\0", " "))
        except OSError:
            continue
    return found


def power_cut(daemon: Daemon) -> None:
    """Kills one process of the daemon, or all of them, and waits for the end of all."""
    victim = random.choice(["all", "all", "bus", "supervisor"])
    if victim == "all":
        daemon.kill_all()
    elif victim == "supervisor":
        os.kill(daemon.process.pid, signal.SIGKILL)
    else:
        try:
            os.kill(daemon.child_pid("ecatd.server"), signal.SIGKILL)
        except (AssertionError, OSError):  # it has not started one yet
            daemon.kill_all()
    daemon.process.wait()
    end = time.monotonic() + PATIENCE
    while left := leftovers(daemon):
        assert time.monotonic() < end, left
        time.sleep(0.005)


@pytest.mark.timeout(600 + 4 * RESTARTS)
def test_r30_clients_survive_a_daemon_that_is_killed_at_any_point(tmp_path: Path) -> None:
    random.seed(int(os.environ.get("ECAT_SEED", "1")))
    daemon = Daemon(tmp_path, "line:4").wait_ready()
    bus = daemon.bus
    files = {bus, f"{bus}.out"}

    def start(before: Daemon) -> Daemon:
        before._socket.close()
        made = Daemon(tmp_path, "line:4", "--bus", bus)
        made.bus = bus
        return made

    clients = [Survivor(bus), Writer(bus)]
    for client in clients:
        client.start()

    def at_work() -> bool:
        assert not any(client.failed for client in clients), [c.failed for c in clients]
        return all(client.rounds > 20 for client in clients)

    told: list[float] = []
    early = 0
    try:
        for number in range(RESTARTS):
            if number % 2:  # while it starts; sometimes after that
                time.sleep(random.uniform(0, 1))
                early += any(client.down for client in clients)
                power_cut(daemon)
            else:
                if number > 0:
                    daemon.wait_ready()
                assert {path.name for path in SHM.glob(f"*{bus}*")} == files
                wait_for(at_work, daemon)
                time.sleep(random.uniform(0, 0.05))
                begin = time.monotonic()
                daemon.kill_all()
                end = time.monotonic() + PATIENCE
                while not all(client.down for client in clients):
                    assert time.monotonic() < end
                    time.sleep(0.001)
                told += [client.down - begin for client in clients if client.down]
            assert "Traceback" not in daemon.log, daemon.log
            assert not any(client.failed for client in clients), [c.failed for c in clients]
            daemon = start(daemon)
        daemon.wait_ready()
        wait_for(at_work, daemon)
        assert daemon.stop() == 0
    finally:
        for client in clients:
            client.stop()
        daemon.close()
    assert not any(client.failed for client in clients), [c.failed for c in clients]
    assert ELEASE in clients[1].codes
    assert early > 0
    print(f"{early} starts were killed before all clients were there again")
    print(f"told after {max(told):.3f} s at most, {statistics.median(told):.3f} s as a rule")
    assert not list(SHM.glob(f"*{bus}*"))
    assert not list((tmp_path / "r").iterdir())

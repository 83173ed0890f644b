"""A daemon with a drive that turns, and its simulator beside it, which does not end with it."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from test_safe_stop import SPEED, Drive, stop_rule

from conftest import PATIENCE, Daemon
from ecatd.base.network_namespace import join
from ecatsim.control import Simulator

MAIN, BUS, GATEWAY = "main", "ecatd.server", "ecatd.gateway"
VELOCITY, STATUS_WORD = 0x606C, 0x6041


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


@contextmanager
def simulator_beside(rig: str) -> Iterator[tuple[Simulator, str, Callable[[], None]]]:
    """A simulator that no daemon ends, its interface, and what leads a process to that."""
    read, write = os.pipe()
    process = subprocess.Popen(
        [
            *(sys.executable, "-m", "ecatsim", "run", rig, "--ready-fd", str(write)),
            *("--", "sleep", "infinity"),
        ],
        pass_fds=(write,),
    )
    os.close(write)
    try:
        with os.fdopen(read) as ready:
            at = json.loads(ready.readline())
        with Simulator(str(process.pid)) as simulator:
            yield simulator, at["interface"], lambda: join(at["pid"])
    finally:
        process.terminate()
        process.wait(PATIENCE)


@contextmanager
def turning_drive(tmp_path: Path) -> Iterator[Machine]:
    with simulator_beside("troll") as (simulator, interface, enter):
        daemon = Daemon(
            *(tmp_path, "", "--interface", interface),
            config=stop_rule("quick_stop"),
            preexec=enter,
        )
        try:
            daemon.wait_ready()
            with Drive(daemon) as drive:
                drive.brake_slowly()
                drive.run()
                yield Machine(daemon, simulator)
        finally:
            daemon.close()

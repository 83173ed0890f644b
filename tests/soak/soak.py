"""A bus at 1 kHz with random faults, whose invariants are checked: `soak.py SECONDS SEED`.

Frames get lost, come late, twice or damaged, cables break, slaves lose their power, fail, or do not
answer; clients and the gateway are killed or stopped; the time of day jumps; the room for shared
memory and that for files fill up. Checked:

- outputs: no output of an owner is lost or comes twice (`writer.py`);
- grid: each deadline is on the grid of the cycle, however many were missed;
- log: each broken cable, loss of a slave and emergency is told once, and each return once;
- growth: no process needs more memory, descriptors or threads than after the warm-up;
- at the end, all slaves are in OP, and the daemon ends with status 0.
"""

import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from conftest import Daemon
from ecatd.base.errors import EcatError
from ecatd.shm.statistics import Snapshot, read
from ecatsim.control import Simulator
from time_of_day import TimeOfDay

RIG = """\
name = "soak"
{devices}
"""
DEVICES = [*["Loopback32"] * 6, "EL3008"]
WRITERS = (0, 2, 4)
MAILBOX = 6
CONFIG = """\
cycle_time_us = 1000
[gateway]
listen = []
publish_hz = 20
[recovery]
retry_s = 0.5
[outputs]
lease_max_ms = 60000
wkc_limit = 20
"""
FILES = """\
audit_file = "{files}/audit"
"""
CAPTURE = """\
[flight_recorder]
folder = "{files}"
memory_mb = 1
disk_mb = 20
"""
HEAL_S = 120.0
GROWTH = {"RSS": 6144, "descriptors": 3, "threads": 2}
"""Most that a process may grow after the warm-up; memory in KiB, as allocators keep some."""
GRID_CYCLES = 2


def named(line: str) -> set[int]:
    """The slaves that a line of the log is about, such as `slave 3 (...)` or `slaves 1, 3-5`."""
    found = {int(number) for number in re.findall(r"\bslave (\d+)", line)}
    for group in re.findall(r"\bslaves ([\d, -]+)", line):
        for first, last in re.findall(r"(\d+)(?:-(\d+))?", group):
            found.update(range(int(first), int(last or first) + 1))
    return found


@dataclass
class Soak:
    """A bus, what disturbs it, and what must hold."""

    daemon: Daemon
    simulator: Simulator
    dice: random.Random
    time_of_day: TimeOfDay
    files: Path
    writers: dict[int, "subprocess.Popen[bytes]"] = field(default_factory=dict)
    done: Counter[str] = field(default_factory=Counter)
    sizes: dict[str, dict[str, int]] = field(default_factory=dict)
    origin: Snapshot | None = None

    # --- what is checked -----------------------------------------------------------------------

    def check(self) -> None:
        """What holds at any time."""
        assert self.daemon.process.poll() is None, self.daemon.log[-3000:]
        for slave, writer in list(self.writers.items()):
            status = writer.poll()
            assert status is None or status == -signal.SIGKILL, f"writer of {slave}: {status}"
            if status is not None:
                self.write(slave)
        now = read(self.daemon.bus)
        if self.origin is None:
            self.origin = now
        since = now - self.origin
        elapsed = (now.cycle_end_ns - self.origin.cycle_end_ns) / now.cycle_time_ns
        # The end of a cycle may be away from its deadline, on a busy machine.
        late = (since.times["wakeup"].max_ns + since.times["cycle"].max_ns) / now.cycle_time_ns
        cycles = now.cycle_number - self.origin.cycle_number
        assert abs(elapsed - cycles) < GRID_CYCLES + late, (elapsed, cycles, late)

    def heal(self) -> None:
        """Waits until all slaves are in OP again, and the log says that all answer.

        What comes and goes in quick succession is told together, so the next fault waits for it.
        """
        end = time.monotonic() + HEAL_S
        while True:
            self.check()
            states = [slave.state for slave in self.simulator.status().slaves]
            counted = re.findall(r"slave count changed|slaves answer, and no", self.daemon.log)
            if set(states) == {"OP"} and counted[-1:] != ["slave count changed"]:
                return
            assert time.monotonic() < end, (states, self.daemon.log[-3000:])
            time.sleep(0.05)

    def measure(self) -> dict[str, dict[str, int]]:
        """Memory, descriptors and threads of each process that has not been started anew."""
        pids = {
            "main": self.daemon.process.pid,
            "bus server": self.daemon.child_pid("ecatd.server"),
        }
        sizes = {}
        for name, pid in pids.items():
            status = Path(f"/proc/{pid}/status").read_text()
            values = dict(re.findall(r"^(\w+):\s+(\d+)", status, re.MULTILINE))
            handles = len(list(Path(f"/proc/{pid}/fd").iterdir()))
            sizes[name] = {
                "RSS": int(values["VmRSS"]),
                "descriptors": handles,
                "threads": int(values["Threads"]),
            }
        return sizes

    # --- what happens --------------------------------------------------------------------------

    def write(self, slave: int) -> None:
        """Starts a client that owns the outputs of a slave."""
        program = str(Path(__file__).with_name("writer.py"))
        command = [sys.executable, program, self.daemon.bus, str(slave)]
        self.writers[slave] = subprocess.Popen(command, env=self.daemon.env)

    def told(self, slave: int, words: str, since: int) -> int:
        """How many lines of the log are about this slave, and have one of these words."""
        lines = self.daemon.log[since:].splitlines()
        return sum(slave in named(line) and bool(re.search(words, line)) for line in lines)

    def check_told_once(self, slave: int, words: str, since: int) -> None:
        """Once, and at most once more for each time that no slave at all answered meanwhile.

        That hides how the slaves are, so it is told anew. It happens when the simulator gets no
        processor for as long as the master waits for an answer.
        """
        outages = self.daemon.log[since:].count("no slave answers")
        assert 1 <= self.told(slave, words, since) <= 1 + outages, self.daemon.log[since:]

    def frames(self) -> None:
        """Frames are lost, late, twice or damaged, or have a wrong working counter.

        None has wrong bits and a good checksum: no master could tell.
        """
        faults, count = self.simulator.faults, self.dice.randrange(1, 60)
        self.dice.choice(
            [
                lambda: faults.drop(count=count),
                lambda: faults.drop(count=count, way_back=True, all_frames=True),
                lambda: faults.delay(self.dice.randrange(500, 5000), count=count),
                lambda: faults.duplicate(count=count),
                lambda: faults.noise(self.dice.randrange(7), count=count),
                lambda: faults.wkc(self.dice.choice((-3, -1, 1, 2)), count=count),
            ]
        )()
        time.sleep(0.2)

    def cable(self) -> None:
        """A cable breaks."""
        at, since = self.dice.randrange(1, 7), len(self.daemon.log)
        broken, whole = f"no answer from slave {at} ", f"all {len(DEVICES)} slaves answer"
        self.simulator.faults.break_link(at, 0)
        self.wait_for(lambda: broken in self.daemon.log[since:])
        time.sleep(self.dice.uniform(0, 1))
        self.simulator.faults.heal_link(at, 0)
        self.heal()
        self.wait_for(lambda: whole in self.daemon.log[since:])
        self.check_told_once(at, broken, since)
        outages = self.daemon.log[since:].count("no slave answers")
        assert self.daemon.log[since:].count(whole) <= 1 + outages, self.daemon.log[since:]

    def loose_contact(self) -> None:
        """A cable breaks for a moment, which may be too short to be seen."""
        at = self.dice.randrange(1, 7)
        self.simulator.faults.break_link(at, 0)
        time.sleep(self.dice.uniform(0.05, 0.5))
        self.simulator.faults.heal_link(at, 0)

    def power(self) -> None:
        """A slave loses its power, and the ones behind it are not reached meanwhile."""
        slave, since = self.dice.randrange(1, 7), len(self.daemon.log)
        self.simulator.faults.power_off(slave)
        self.wait_for(lambda: self.told(slave, "no answer|does not answer|missing|lost", since) > 0)
        self.simulator.faults.power_on(slave)
        self.heal()
        self.wait_for(lambda: self.told(slave, "back in OP", since) > 0)
        self.check_told_once(slave, "back in OP", since)
        assert self.told(slave, "switched off and on", since) <= 1, self.daemon.log[since:]

    def fails(self) -> None:
        """A slave leaves OP by itself; unless that was its watchdog, a person brings it back."""
        slave, since = self.dice.randrange(7), len(self.daemon.log)
        code = self.dice.choice((0x001B, 0x001D))
        self.simulator.faults.al_error(slave, code=code)
        self.wait_for(lambda: self.told(slave, f"0x{code:04X}", since) > 0)
        if code != 0x001B:
            self.daemon.ctl("state", str(slave), "OP")
        self.heal()
        self.check_told_once(slave, r": SAFEOP\+ERROR", since)

    def mailbox(self) -> None:
        """A mailbox is slow or silent, and somebody asks it."""
        kind = self.dice.choice(("stuck", "full", "garbage"))
        self.simulator.faults.mailbox(MAILBOX, kind)
        self.daemon.ctl("sdo-read", str(MAILBOX), "0x1018", "1", check=False)
        self.simulator.faults.mailbox(MAILBOX, "none")

    def emergency(self) -> None:
        """A slave sends an emergency."""
        code, since = 0x8000 + self.dice.randrange(256), len(self.daemon.log)
        sent = f"sent an emergency: error code 0x{code:04X}"
        self.simulator.faults.emergency(MAILBOX, code)
        self.wait_for(lambda: self.told(MAILBOX, sent, since) > 0)
        time.sleep(0.5)
        assert self.told(MAILBOX, sent, since) == 1, self.daemon.log[since:]

    def client_dies(self) -> None:
        """A client is killed while it owns outputs."""
        self.dice.choice(list(self.writers.values())).kill()
        time.sleep(0.1)

    def client_hangs(self) -> None:
        """A client is stopped for longer than its lease."""
        writer = self.dice.choice(list(self.writers.values()))
        writer.send_signal(signal.SIGSTOP)
        time.sleep(1.0)
        writer.send_signal(signal.SIGCONT)

    def gateway_dies(self) -> None:
        """The gateway is killed, and comes back."""
        before = self.gateway()
        with suppress(ProcessLookupError):
            os.kill(before, signal.SIGKILL)
        self.wait_for(lambda: self.gateway() not in (0, before))
        self.wait_for(lambda: self.daemon.ctl("info", check=False).returncode == 0)

    def gateway(self) -> int:
        with suppress(AssertionError, OSError):  # it, or a thread that starts it, ends just now
            return self.daemon.child_pid("ecatd.gateway")
        return 0

    def gateway_hangs(self) -> None:
        """The gateway is stopped; the daemon notices, and starts another one."""
        before = self.gateway()
        with suppress(ProcessLookupError):
            os.kill(before, signal.SIGSTOP)
        self.wait_for(lambda: self.gateway() not in (0, before))
        self.wait_for(lambda: self.daemon.ctl("info", check=False).returncode == 0)

    def clock(self) -> None:
        """The time of day jumps by minutes to days, forward or back."""
        self.time_of_day.jump(self.dice.choice((-1, 1)) * self.dice.randrange(60, 200_000))
        self.daemon.ctl("sdo-read", str(MAILBOX), "0x1018", "1")

    def room(self) -> None:
        """Nothing more fits into /dev/shm for a moment; clients still come."""
        file = _fill(Path("/dev/shm"))
        self.dice.choice(list(self.writers.values())).kill()
        time.sleep(0.5)
        self.check()
        file.unlink()

    def disk(self) -> None:
        """Nothing more fits on the disk when a fault is to be written, and a change."""
        file = _fill(self.files)
        self.fails()
        self.daemon.ctl("log-level", "dc", self.dice.choice(("debug", "info")))
        file.unlink()

    def wait_for(self, condition: Callable[[], bool]) -> None:
        end = time.monotonic() + HEAL_S
        while not condition():
            self.check()
            assert time.monotonic() < end, self.daemon.log[-3000:]
            time.sleep(0.05)

    # --- all of it -----------------------------------------------------------------------------

    def run(self, seconds: float, *, own_memory: bool) -> None:
        """Disturbs and checks for some seconds."""
        disturb = [self.frames] * 3 + [self.cable, self.loose_contact, self.power, self.fails]
        disturb += [self.mailbox, self.emergency, self.client_dies, self.client_hangs]
        disturb += [self.gateway_dies, self.gateway_hangs, self.clock]
        if own_memory:
            disturb += [self.room, self.disk]
        for slave in WRITERS:
            self.write(slave)
        began = time.monotonic()
        while (passed := time.monotonic() - began) < seconds:
            if passed > seconds / 4 and not self.sizes:
                self.sizes = self.measure()
            one = self.dice.choice(disturb)
            since = len(self.daemon.log)
            one()
            self.heal()
            self.done[one.__name__] += 1
            if os.environ.get("ECAT_VERBOSE"):
                print(f"=== {one.__name__}\n{self.daemon.log[since:]}", flush=True)
        self.heal()
        self.check_growth()

    def check_growth(self) -> None:
        """Nothing has grown since the warm-up."""
        for name, now in self.measure().items():
            for what, value in now.items():
                grown = value - self.sizes[name][what]
                print(f"{name}: {what} {value}, {grown:+d} since the warm-up", flush=True)
                assert grown <= GROWTH[what], (name, what, self.sizes[name][what], value)

    def report(self) -> None:
        """Prints what was done."""
        now = read(self.daemon.bus)
        print(f"disturbances: {dict(sorted(self.done.items()))}")
        print(
            f"{now.cycle_number} cycles,",
            ", ".join(f"{name} {count}" for name, count in now.counters.items()),
            flush=True,
        )


def _fill(folder: Path) -> Path:
    """Fills the file system of a folder up, with the file that is returned."""
    file = folder / "full"
    with suppress(OSError), file.open("wb", buffering=0) as full:
        while True:
            full.write(b"\0" * 65536)
    return file


def main(seconds: float, seed: int) -> None:
    """Runs it.

    Raises:
        AssertionError: An invariant does not hold.
    """
    own_memory = os.environ.get("ECAT_OWN_SHM") == "1"
    with tempfile.TemporaryDirectory(prefix="ecatd-soak-") as name:
        folder = Path(name)
        rig = folder / "rig.toml"
        devices = "\n".join(f"[[slave]]\ndevice = '{device}'" for device in DEVICES)
        rig.write_text(RIG.format(devices=devices))
        files = folder / "files"
        files.mkdir()
        if own_memory:  # also for files, in the mount namespace of the test
            mount = ["mount", "-t", "tmpfs", "-o", "size=16m", "none", str(files)]
            subprocess.run(mount, check=True)
        time_of_day = TimeOfDay(folder)
        os.environ |= time_of_day.env
        config = FILES.format(files=files) + CONFIG + CAPTURE.format(files=files)
        daemon = Daemon(folder, str(rig), config=config)
        try:
            daemon.wait_ready()
            with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
                soak = Soak(daemon, simulator, random.Random(seed), time_of_day, files)
                try:
                    soak.run(seconds, own_memory=own_memory)
                    soak.report()
                finally:
                    for writer in soak.writers.values():
                        writer.kill()
                        writer.wait()
            assert daemon.stop() == 0, daemon.log[-3000:]
        finally:
            with suppress(EcatError):
                daemon.close()
            if own_memory:
                subprocess.run(["umount", str(files)], check=True)


if __name__ == "__main__":
    main(float(sys.argv[1]), int(sys.argv[2]))

"""Bridges between a terminal and other CAN interfaces: `ecatctl can bridge` and `can.bridge`.

The kernels of build machines have no CAN. So a pair of sockets stands for a CAN interface of Linux
here; it carries the same bytes. `tests/system` has the real one.
"""

import select
import signal
import socket
import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from test_can import CONFIG as SLOW
from test_can import (
    ENDED,
    LEFT,
    NMT_STOP,
    RIG,
    RIGHT,
    Channel,
    channel,
    contents,
    simulator,
    wait_for_line,
)

from conftest import PATIENCE, Daemon, names, stop_process, wait_for
from ecatd.cli.can_bridge import Bridge
from ecatd.client.can import CanFrame, frame
from ecatd.shm.contract import CanState

pytestmark = pytest.mark.bus

CYCLE_TIME_US = 1000
CONFIG = SLOW.replace("receive_queue = 30\n", "").replace("_second = 1000", "_second = 6000")
"""For all frames of the bus: what a queue has no room for is lost in the terminal."""
EXTENDED, REMOTE, ERROR = 1 << 31, 1 << 30, 1 << 29
MANY = 2000
KINDS = [
    frame(0x123, b"\1\2\3"),
    frame(0x000, b"\2\0"),
    frame(0x123, b"\xff" * 8, extended=True),
    frame(0x1FFFFFFF),
    frame(0x321, remote=True, length=4),
    frame(0x18FF0001, remote=True),
]


def packed(one: CanFrame) -> bytes:
    """`struct can_frame` of Linux."""
    word = one.identifier | EXTENDED * one.extended | REMOTE * one.remote
    return word.to_bytes(4, sys.byteorder) + bytes([one.length, 0, 0, 0]) + one.data.ljust(8, b"\0")


def word_of(data: bytes) -> int:
    return int.from_bytes(data[:4], sys.byteorder)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("bridge") / "pair.toml"
    file.write_text(RIG)
    return file


@pytest.fixture(scope="module")
def daemon(start_shared: Callable[..., Daemon], rig: Path) -> Daemon:
    return start_shared(str(rig), config=CONFIG)


class Interface:
    """The other end of a bridge at the left terminal: what programs on the interface have."""

    def __init__(self, end: socket.socket, told: list[str]) -> None:
        self._end, self.told = end, told
        end.settimeout(PATIENCE)

    def send(self, one: CanFrame) -> None:
        self._end.send(packed(one))

    def receive(self, count: int) -> list[bytes]:
        return [self._end.recv(16) for _ in range(count)]

    def receive_until(self, enough: Callable[[bytes], bool]) -> list[bytes]:
        found = self.receive(1)
        while not enough(found[-1]):
            found += self.receive(1)
        return found

    def wait_for_told(self, *words: str) -> None:
        end = time.monotonic() + PATIENCE
        while not self.told:
            assert time.monotonic() < end
            time.sleep(0.01)
        names(self.told[0], *words)

    def nothing_waits(self) -> bool:
        return not select.select([self._end], [], [], 0)[0]


@contextmanager
def bridge(daemon: Daemon) -> Iterator[Interface]:
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    told: list[str] = []
    over = threading.Event()
    with here, there:
        one = Bridge(daemon.bus, LEFT, there, "vcan0", True, told.append)
        thread = threading.Thread(target=one.run, args=(over.is_set,))
        thread.start()
        try:
            yield Interface(here, told)
        finally:
            over.set()
            thread.join()


@contextmanager
def ended(process: subprocess.Popen[str]) -> Iterator[subprocess.Popen[str]]:
    """Kills a process at the end of the test."""
    with process:
        try:
            yield process
        finally:
            process.kill()


def sends(client: Channel, frames: list[CanFrame]) -> None:
    """Sends so many that the queue is full now and then."""
    left = frames
    while left:
        before = client.can.info.waiting
        room = 256 - before
        if room:
            client.can.send_all(left[:room])
            left = left[room:]
        client.client.wait()


# --- ecatctl can bridge -----------------------------------------------------------------------


def test_all_kinds_of_frames_pass_both_ways(daemon: Daemon) -> None:
    with bridge(daemon) as vcan, channel(daemon, RIGHT) as right:
        for one in KINDS:
            vcan.send(one)
        assert list(map(packed, right.receive(len(KINDS)))) == list(map(packed, KINDS))
        right.can.claim()
        right.can.send_all(KINDS)
        assert vcan.receive(len(KINDS)) == list(map(packed, KINDS))
        assert vcan.nothing_waits()  # no echo
        right.can.release()


def test_frames_of_other_programs_on_the_channel_are_on_the_interface(daemon: Daemon) -> None:
    with bridge(daemon) as vcan, channel(daemon, LEFT) as other:
        other.can.claim()
        other.can.send(0x111, b"hello")
        assert vcan.receive(1) == [packed(frame(0x111, b"hello"))]
        other.can.release()


def test_many_frames_pass_both_ways_in_order(daemon: Daemon) -> None:
    there = [frame(0x18FF0000, n.to_bytes(4, "little")) for n in range(MANY)]
    back = [frame(0x18FE0000, n.to_bytes(4, "little")) for n in range(MANY)]
    with bridge(daemon) as vcan, channel(daemon, RIGHT) as right:
        sender = threading.Thread(target=lambda: [vcan.send(one) for one in there])
        found: list[bytes] = []
        receiver = threading.Thread(target=lambda: found.extend(vcan.receive(MANY)))
        sender.start()
        receiver.start()
        right.can.claim()
        sends(right, back)
        arrived = right.receive(MANY)
        sender.join()
        receiver.join()
        right.can.release()
        assert [one.data for one in arrived] == [one.data for one in there]
        assert found == list(map(packed, back))
        assert not vcan.told


def test_states_of_the_controller_are_error_frames(daemon: Daemon) -> None:
    bus_off, again = 0x40, 0x40  # of byte 1: active
    with bridge(daemon) as vcan:
        simulator(daemon, "can-bus-off", str(LEFT))
        vcan.receive_until(lambda f: word_of(f) & ERROR > 0 and word_of(f) & bus_off > 0)
        vcan.receive_until(lambda f: word_of(f) & (ERROR | 0x4) == ERROR | 0x4 and f[9] == again)
        vcan.send(frame(0x101))
        with channel(daemon, LEFT) as left:
            wait_for(lambda: left.can.info.state == CanState.ACTIVE, daemon)


def test_a_reserved_identifier_is_told_and_the_others_go_on(daemon: Daemon) -> None:
    with bridge(daemon) as vcan, channel(daemon, LEFT) as owner, channel(daemon, RIGHT) as right:
        owner.can.claim(reserve=[0x180])
        vcan.send(frame(0x180))
        vcan.send(frame(0x181))
        assert [one.identifier for one in right.receive(1)] == [0x181]
        vcan.wait_for_told("1 frame dropped", "0x180", "reserved")
        owner.can.release()


def test_it_goes_on_when_the_daemon_is_back(start_daemon: Callable[..., Daemon], rig: Path) -> None:
    first = start_daemon(str(rig), config=CONFIG)
    with bridge(first) as vcan:
        vcan.send(frame(0x101))
        first.stop()
        vcan.send(frame(0x102))
        vcan.wait_for_told("1 frame dropped")
        start_daemon(str(rig), "--bus", first.bus, config=CONFIG)
        with channel(first, RIGHT) as right:
            right.can.claim()
            right.can.send(0x103, b"back")
            vcan.receive_until(lambda data: data == packed(frame(0x103, b"back")))
            vcan.send(frame(0x104, b"there"))
            assert contents(right.receive(1)) == [(0x104, b"there")]
            right.can.release()


def test_it_sends_what_waits_when_it_ends_in_order(daemon: Daemon) -> None:
    with channel(daemon, LEFT) as watcher, channel(daemon, RIGHT) as right:
        with bridge(daemon) as vcan:
            vcan.send(frame(0x202))  # which has a safe frame for its end
            for number in range(100):
                vcan.send(frame(0x400, bytes([number])))
            arrived = right.receive(1)
            assert vcan.nothing_waits()
        found = watcher.take(lambda seen: ENDED in contents([f for f in seen if f.safe]))
        assert NMT_STOP not in contents([f for f in found if f.safe])
        numbers = [f.data[0] for f in arrived + right.can.read() if f.identifier == 0x400]
        assert numbers == list(range(len(numbers)))


def test_frames_that_are_old_are_not_sent(daemon: Daemon) -> None:
    """While the bridge was stopped, the safe frames were sent."""
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    text = f"""
        import socket
        from ecatd.cli.can_bridge import Bridge
        def tell(text):
            print(text, flush=True)
        with socket.socket(fileno={there.fileno()}) as there:
            one = Bridge({daemon.bus!r}, {LEFT}, there, "vcan0", True, tell)
            print("ready", flush=True)
            one.run(lambda: False)
    """
    command = [sys.executable, "-c", textwrap.dedent(text)]
    with (
        here,
        channel(daemon, LEFT) as watcher,
        ended(
            subprocess.Popen(
                command,
                env=daemon.env,
                stdout=subprocess.PIPE,
                text=True,
                pass_fds=[there.fileno()],
            )
        ) as process,
    ):
        there.close()
        vcan = Interface(here, [])
        wait_for_line(process)
        vcan.send(frame(0x301))
        watcher.take(lambda seen: 0x301 in [f.identifier for f in seen])
        stop_process(process.pid)
        watcher.take(lambda seen: NMT_STOP in contents([f for f in seen if f.safe]))
        vcan.send(frame(0x302))
        vcan.send(frame(0x302))
        process.send_signal(signal.SIGCONT)
        assert process.stdout is not None
        names(process.stdout.readline(), "2 frames dropped", "left")
        vcan.send(frame(0x303))
        seen = watcher.take(lambda seen: 0x303 in [f.identifier for f in seen])
        assert 0x302 not in [f.identifier for f in seen]


def test_an_interface_that_is_none_is_refused(daemon: Daemon) -> None:
    """Without CAN in the kernel, the message says that."""
    found = daemon.ctl("can", "bridge", "left", "nocan0", check=False)
    assert found.returncode in (2, 7)
    names(found.stderr, "CAN", "modprobe can-raw" if found.returncode == 7 else "nocan0")


@pytest.mark.parametrize("arguments", [["left"], ["left", "vcan0", "vcan1"]])
def test_wrong_arguments_are_explained(daemon: Daemon, arguments: list[str]) -> None:
    found = daemon.ctl("can", "bridge", *arguments, check=False)
    assert found.returncode == 2
    names(found.stderr, "bridge", "vcan0")


# --- python -m can.bridge ---------------------------------------------------------------------

PYTHON_CAN = """
import sys, threading, can, can.bridge
places = ["--bus1-interface", "ecatd", "--bus1-channel", sys.argv[1]]
places += ["--bus2-interface", "virtual", "--bus2-channel", "desk"]
def desk():
    sys.stdin.readline()
    bus.send(can.Message(arbitration_id=0x123, is_extended_id=True, data=b"there"))
    for found in bus:
        print(f"{found.arbitration_id:X} {found.data.hex()}", flush=True)
bus = can.Bus(interface="virtual", channel="desk")
threading.Thread(target=desk, daemon=True).start()
sys.argv = ["can.bridge", *places]
can.bridge.main()
"""


def test_the_bridge_of_python_can(daemon: Daemon) -> None:
    """To the virtual bus of python-can, which is in one process."""
    command = [sys.executable, "-u", "-c", PYTHON_CAN, f"{daemon.bus}/{LEFT}"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with (
        channel(daemon, LEFT) as watcher,
        channel(daemon, RIGHT) as right,
        ended(subprocess.Popen(command, env=daemon.env, text=True, **pipes)) as process,
    ):
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stdout.readline().startswith("CAN Bridge")
        process.stdin.write("\n")
        process.stdin.flush()
        assert contents(right.receive(1)) == [(0x123, b"there")]
        right.can.claim()
        right.can.send(0x321, b"back")
        assert process.stdout.readline() == f"321 {b'back'.hex()}\n"
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 0
        right.can.release()
        assert not [f for f in watcher.can.read() if f.safe], "it has ended in order"

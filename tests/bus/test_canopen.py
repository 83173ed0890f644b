"""The package `canopen` is a CANopen master of nodes behind the terminals of `troll-can`."""

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import canopen
import pytest

from conftest import PATIENCE, Daemon
from ecatsim.can.nodes.drive import EDS

pytestmark = pytest.mark.bus

CONFIG = Path(__file__).parents[2] / "examples/troll/troll-can.toml"
CYCLE_TIME_US = 1000
DRIVES, OTHERS = 6, 7
DRIVE, IO, MASTER = 5, 2, 1
HEARTBEAT_LOST = 0x8130


@pytest.fixture(scope="module")
def daemon(start_shared: Callable[..., Daemon]) -> Daemon:
    return start_shared("troll-can", config=CONFIG.read_text())


@contextmanager
def network(daemon: Daemon, slave: int) -> Iterator[canopen.Network]:
    master = canopen.Network()
    master.connect(interface="ecatd", channel=f"{daemon.bus}/{slave}")
    try:
        yield master
    finally:
        master.disconnect()


@contextmanager
def drive(daemon: Daemon) -> Iterator[tuple[canopen.Network, canopen.RemoteNode]]:
    with network(daemon, DRIVES) as master:
        node = master.add_node(canopen.RemoteNode(DRIVE, str(EDS)))
        node.sdo.RESPONSE_TIMEOUT = PATIENCE
        node.nmt.state = "PRE-OPERATIONAL"
        yield master, node


def eventually(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, "it did not come about"
        time.sleep(0.01)


@pytest.mark.parametrize(("slave", "node"), [(DRIVES, DRIVE), (OTHERS, IO)])
def test_a_scan_finds_the_node(daemon: Daemon, slave: int, node: int) -> None:
    with network(daemon, slave) as master:
        master.scanner.search()
        eventually(lambda: node in master.scanner.nodes)
        assert master.scanner.nodes == [node]


def test_objects_are_read_and_written(daemon: Daemon) -> None:
    with drive(daemon) as (_, node):
        assert node.sdo[0x1000].raw == 0x00020192
        assert node.sdo[0x1008].raw == "CANopen drive"  # in segments
        for value in (123456, 654321):
            node.sdo[0x6083].raw = value
            assert node.sdo[0x6083].raw == value
        with pytest.raises(canopen.SdoAbortedError) as caught:
            node.sdo.download(0x6041, 0, b"\0\0")
        assert caught.value.code == 0x06010002  # read only


def test_pdos_nmt_and_heartbeats(daemon: Daemon) -> None:
    """The outputs of the node return as its inputs, while it is operational."""
    with network(daemon, OTHERS) as master:
        node = master.add_node(canopen.RemoteNode(IO, canopen.ObjectDictionary()))
        node.sdo.RESPONSE_TIMEOUT = PATIENCE
        node.nmt.state = "OPERATIONAL"
        node.nmt.wait_for_heartbeat(PATIENCE)
        eventually(lambda: node.nmt.state == "OPERATIONAL")
        inputs = []
        master.subscribe(0x180 + IO, lambda _id, data, _time: inputs.append(bytes(data)))
        for value in (0x5A, 0xA5):
            master.send_message(0x200 + IO, bytes([value]))
            eventually(lambda: bytes([value]) in inputs)  # noqa: B023
        assert node.sdo.upload(0x6000, 1) == b"\xa5"
        node.nmt.state = "PRE-OPERATIONAL"
        eventually(lambda: node.sdo.upload(0x6000, 1) == b"\0")
        node.nmt.wait_for_heartbeat(PATIENCE)
        eventually(lambda: node.nmt.state == "PRE-OPERATIONAL")


def test_mapped_pdos(daemon: Daemon) -> None:
    with drive(daemon) as (master, node):
        node.tpdo.read()
        node.rpdo.read()
        node.nmt.state = "OPERATIONAL"
        master.sync.start(0.02)
        node.rpdo[1][0x6060].raw = 9
        node.rpdo[1].transmit()
        for word, wanted in ((6, 0x21), (7, 0x23), (15, 0x27)):
            node.rpdo[3][0x6040].raw, node.rpdo[3][0x60FF].raw = word, 0
            node.rpdo[3].transmit()
            eventually(lambda: node.tpdo[2][0x6041].raw & 0x6F == wanted)  # noqa: B023
        node.rpdo[3][0x60FF].raw = 655_360
        node.rpdo[3].transmit()
        eventually(lambda: abs(node.tpdo[3][0x606C].raw - 655_360) < 20_000)
        master.sync.stop()


def test_an_emergency(daemon: Daemon) -> None:
    """The drive misses the heartbeat of its master."""
    with drive(daemon) as (master, node):
        node.emcy.reset()
        master.send_message(0x700 + MASTER, b"\5")
        node.sdo[0x1016][1].raw = MASTER << 16 | 1000
        master.send_message(0x700 + MASTER, b"\5")
        found = node.emcy.wait(HEARTBEAT_LOST, PATIENCE)
        assert found is not None
        assert found.code == HEARTBEAT_LOST
        node.sdo[0x1016][1].raw = 0


PROGRAM = """
import signal, sys, canopen
master = canopen.Network()
master.connect(interface="ecatd", channel=sys.argv[1])
master.send_message(0, bytes([1, int(sys.argv[2])]))
if sys.argv[3] == "commands":
    master.send_message(0x200 + int(sys.argv[2]), bytes([6, 0]))
master.bus.flush_tx_buffer()
print("ready", flush=True)
sys.stdin.read()
master.disconnect()
"""


@pytest.mark.parametrize(
    ("does", "end", "state"),
    [
        ("watches", "killed", "OPERATIONAL"),  # the safe frames are about senders of RPDOs
        ("commands", "orderly", "STOPPED"),
        ("commands", "killed", "STOPPED"),
    ],
)
def test_the_drive_stops_when_its_master_has_ended(
    daemon: Daemon, does: str, end: str, state: str
) -> None:
    with network(daemon, DRIVES) as watcher:
        node = watcher.add_node(canopen.RemoteNode(DRIVE, str(EDS)))
        command = [sys.executable, "-c", PROGRAM, f"{daemon.bus}/{DRIVES}", str(DRIVE), does]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        with subprocess.Popen(command, env=daemon.env, text=True, **pipes) as program:
            assert program.stdout is not None
            assert program.stdout.readline() == "ready\n"
            node.nmt.wait_for_heartbeat(PATIENCE)
            eventually(lambda: node.nmt.state == "OPERATIONAL")
            if end == "killed":
                program.kill()
        assert program.returncode == (-signal.SIGKILL if end == "killed" else 0)
        node.nmt.wait_for_heartbeat(PATIENCE)
        node.nmt.wait_for_heartbeat(PATIENCE)
        eventually(lambda: node.nmt.state == state)

"""Virtual ECUs (FMI-LS-BUS) on the CAN bus behind a terminal of the simulated rig."""

import os
import signal
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip("fmpy", reason="FMPy is not installed (extra 'test')")

from conftest import Daemon, names, run_module
from ls_bus_importer import (
    ACK_ERROR,
    ARBITRATION,
    BUFFER_AND_RETRANSMIT,
    BUS_ERROR,
    BUS_OFF,
    CONFIGURATION,
    CONFIRM,
    DISCARD_AND_NOTIFY,
    ERROR_ACTIVE,
    FORMAT_ERROR,
    PRIMARY,
    SECONDARY,
    STATUS,
    TRANSMIT,
    TRANSMIT_FD,
    WAKEUP,
    Importer,
    arbitration,
    baud_rate,
    operation,
    transmit,
)
from player import BEAR, Model, Player

pytestmark = pytest.mark.bus

CYCLE_TIME_US = 1000
TERMINAL = 6
CONFIG = """
[gateway]
listen = []

[[slave]]
position = 6
name = "can"

[slave.can]
bit_rate = 1000
identifiers = 29
frames_per_second = 3000

[[slave.can.safe]]
id = 0x77
data = "02 00"
"""
DEVICE_TYPE = bytes.fromhex("4000100000000000")
"""Of SDO: read 0x1000:00."""
NODES = ("CANopen drive 5", "torque sensor")
ASK_DRIVE, DRIVE_ANSWERS = 0x605, 0x585
CAN_STOPPED, CAN_ACTIVE, CAN_PASSIVE = 1, 2, 4  # CanState


@pytest.fixture(scope="module")
def rig(start_shared: Callable[..., Daemon]) -> Daemon:
    return start_shared("troll-can", config=CONFIG)


def fmu_of(daemon: Daemon, folder: Path, *options: str) -> Model:
    daemon.ctl("generate", "CanBus", str(folder), "--ls-bus", "can", *options)
    return Model(folder / "CanBus.fmu")


@pytest.fixture(scope="module")
def model(rig: Daemon, tmp_path_factory: pytest.TempPathFactory) -> Model:
    return fmu_of(rig, tmp_path_factory.mktemp("fmu"), "--ls-bus-ecus", "2")


@pytest.fixture
def bus(model: Model) -> Iterator[Importer]:
    with Importer(model, **BEAR) as importer:
        importer.start()
        yield importer
        importer.fmu.terminate()


def test_an_ecu_talks_to_the_drive(bus: Importer) -> None:
    ecu, other = bus.ecus
    ecu.send(baud_rate(1_000_000), arbitration(BUFFER_AND_RETRANSMIT))
    ecu.send(transmit(ASK_DRIVE, DEVICE_TYPE))
    bus.until(lambda: DRIVE_ANSWERS in dict(ecu.frames()))
    assert ecu.codes(CONFIRM) == [struct.pack("<I", ASK_DRIVE)]
    answer = dict(ecu.frames())[DRIVE_ANSWERS]
    assert answer[:4] == bytes.fromhex("43001000")
    assert struct.unpack("<H", answer[4:6]) == (402,)
    assert ASK_DRIVE not in dict(ecu.frames())
    mutual = dict(other.frames())
    assert mutual[ASK_DRIVE] == DEVICE_TYPE
    assert mutual[DRIVE_ANSWERS] == answer
    assert not other.codes(CONFIRM)
    assert not ecu.codes(FORMAT_ERROR)
    assert bus.get("framesSent") == 1
    assert bus.get("framesReceived") > 1
    assert bus.get("can.canState") == CAN_ACTIVE
    assert not bus.warnings()


def test_frames_of_all_kinds(bus: Importer, rig: Daemon) -> None:
    """Extended ones of the sensor, remote ones of an ECU, and those of another client."""
    ecu, other = bus.ecus
    ecu.send(
        transmit(0x18ABCDEF, b"\1\2", extended=True),
        transmit(0x123, bytes(4), remote=True),
        transmit(0x7FF),
    )
    bus.until(lambda: len(ecu.codes(CONFIRM)) == 3)
    sent = [struct.pack("<I", identifier) for identifier in (0x18ABCDEF, 0x123, 0x7FF)]
    assert ecu.codes(CONFIRM) == sent
    seen = [item for item in other.codes(TRANSMIT) if item[:4] in sent]
    assert seen == [
        struct.pack("<IBBH", 0x18ABCDEF, 1, 0, 2) + b"\1\2",
        struct.pack("<IBBH", 0x123, 0, 1, 4) + bytes(4),
        struct.pack("<IBBH", 0x7FF, 0, 0, 0),
    ]
    sensor = next(item for item in ecu.codes(TRANSMIT) if item[:4] == struct.pack("<I", 0x18FF0000))
    assert sensor[4] == 1  # Ide
    rig.ctl("can", "send", "6", "321#AABB")
    bus.until(lambda: 0x321 in dict(ecu.frames()))
    assert dict(ecu.frames())[0x321] == b"\xaa\xbb"
    assert not ecu.codes(FORMAT_ERROR)


def test_none_is_lost_or_doubled(bus: Importer) -> None:
    """Two hundred frames of each ECU at once; together more than the queue of a client has."""
    frames = {0x100: [], 0x101: []}
    for number, (ecu, identifier) in enumerate(zip(bus.ecus, frames, strict=True)):
        frames[identifier] = [struct.pack("<II", number, count) for count in range(200)]
        ecu.send(*(transmit(identifier, data) for data in frames[identifier]))
    bus.until(lambda: all(len(ecu.codes(CONFIRM)) == 200 for ecu in bus.ecus))
    for ecu, identifier in zip(bus.ecus, (0x101, 0x100), strict=True):
        assert [data for one, data in ecu.frames() if one == identifier] == frames[identifier]
        assert not ecu.codes(FORMAT_ERROR)
    assert bus.get("operationsLost") == 0


def test_what_cannot_be_is_refused(bus: Importer) -> None:
    ecu, other = bus.ecus
    wrong = [
        transmit(0x800),  # 11 bits
        transmit(0x20000000, extended=True),
        transmit(1, bytes(9)),
        transmit(1, b"\1")[:-1] + b"",  # shorter than it says, and the rest of this event with it
    ]
    for item in wrong[:-1]:
        ecu.send(item)
    ecu.send(
        operation(TRANSMIT, bytes([1, 0, 0, 0, 2, 0, 0, 0])),  # Ide is no Boolean
        operation(TRANSMIT, bytes([1, 0, 0, 0, 0, 0, 1, 0])),  # the lengths contradict each other
        operation(TRANSMIT_FD, bytes(9)),
        operation(CONFIRM, bytes(4)),
        operation(0x4711),
        operation(STATUS, b"\x07"),
        operation(CONFIGURATION, b"\x09\x00"),
        operation(FORMAT_ERROR, bytes(2)),  # never answered
        wrong[-1],
    )
    bus.until(lambda: len(ecu.codes(FORMAT_ERROR)) == 11)
    answers = [item[2:] for item in ecu.codes(FORMAT_ERROR)]
    assert answers[:3] == wrong[:3]
    assert answers[-1] == wrong[-1]
    assert all(
        struct.unpack("<H", item[:2]) == (len(item) - 2,) for item in ecu.codes(FORMAT_ERROR)
    )
    assert not other.codes(FORMAT_ERROR)
    assert bus.get("operationsRefused") == 11
    (said, its_error) = bus.warnings()  # once, however many there are
    names(said, "Ecu1", "Format Error", "more bits")
    names(its_error, "Ecu1", "answers")
    ecu.send(transmit(0x10))  # and it goes on
    bus.until(lambda: ecu.codes(CONFIRM))


def test_what_no_terminal_can_is_refused_in_words(bus: Importer) -> None:
    ecu, other = bus.ecus
    ecu.send(
        baud_rate(250_000),
        baud_rate(0),
        arbitration(DISCARD_AND_NOTIFY),
        operation(CONFIGURATION, b"\2" + struct.pack("<I", 2_000_000)),
        operation(WAKEUP),
    )
    bus.until(lambda: len(ecu.codes(FORMAT_ERROR)) == 4 and other.codes(WAKEUP))
    assert [item[2:][8] for item in ecu.codes(FORMAT_ERROR)] == [1, 1, ARBITRATION, 2]
    assert not ecu.codes(WAKEUP)
    said = "\n".join(bus.warnings())
    names(said, "250000 bit/s", "1000000 bit/s", "arbitration", "CAN FD", "Wakeup")


def test_an_ecu_that_is_bus_off_sends_nothing(bus: Importer) -> None:
    ecu, _ = bus.ecus
    ecu.send(operation(STATUS, bytes([BUS_OFF])), transmit(0x50))
    bus.until(lambda: ecu.codes(FORMAT_ERROR))
    ecu.send(operation(STATUS, bytes([ERROR_ACTIVE])), transmit(0x51))
    bus.until(lambda: ecu.codes(CONFIRM))
    assert ecu.codes(CONFIRM) == [struct.pack("<I", 0x51)]


def test_reserved_identifiers(bus: Importer, rig: Daemon) -> None:
    ecu, _ = bus.ecus
    with rig.client() as client:
        client.can("can").claim(reserve=[(0x200, 0x20F)])
        ecu.send(transmit(0x201), transmit(0x210))
        bus.until(lambda: ecu.codes(CONFIRM))
        assert ecu.codes(CONFIRM) == [struct.pack("<I", 0x210)]
        assert [item[2:] for item in ecu.codes(FORMAT_ERROR)] == [transmit(0x201)]
    names("\n".join(bus.warnings()), "0x201", "reserved")


def fault(rig: Daemon, name: str, *arguments: str) -> None:
    simulator = str(rig.child_pid("ecatsim"))
    command = ("ctl", "--name", simulator, f"can-{name}", str(TERMINAL), *arguments)
    assert run_module("ecatsim", *command).returncode == 0


@pytest.fixture
def alone(rig: Daemon) -> Iterator[None]:
    """Nobody else is on the CAN bus, so nobody acknowledges a frame."""
    for node in NODES:
        fault(rig, "node", node, "off")
    yield
    for node in NODES:
        fault(rig, "node", node, "on")


def test_nobody_acknowledges(bus: Importer, rig: Daemon, alone: None) -> None:
    """The terminal becomes error passive: each ECU is told as many errors as it takes to follow."""
    ecu, other = bus.ecus
    ecu.send(transmit(0x42))
    bus.until(lambda: bus.get("can.canState") == CAN_PASSIVE)
    bus.until(lambda: len(ecu.codes(BUS_ERROR)) == len(other.codes(BUS_ERROR)) == 128 // 8)
    assert set(ecu.codes(BUS_ERROR)) == {struct.pack("<IBBB", 0x42, ACK_ERROR, PRIMARY, 1)}
    assert set(other.codes(BUS_ERROR)) == {struct.pack("<IBBB", 0x42, ACK_ERROR, SECONDARY, 0)}
    assert bus.get("can.canSendErrors") >= 128
    ecu.send(*(transmit(0x43) for _ in range(1000)))
    bus.until(lambda: ecu.codes(FORMAT_ERROR))
    waiting = 1001 - bus.get("operationsRefused")
    fault(rig, "node", NODES[0], "on")
    bus.until(lambda: len(ecu.codes(CONFIRM)) == waiting)
    names("\n".join(bus.warnings()), "error passive", "frames wait", "Format Error")


def test_bus_off(bus: Importer, rig: Daemon, alone: None) -> None:
    """What the terminal had taken is told as an error, and ECUs go on when it is back."""
    ecu, other = bus.ecus
    ecu.send(transmit(0x42))
    bus.until(lambda: bus.get("can.canState") == CAN_PASSIVE)
    before = len(ecu.codes(BUS_ERROR))
    fault(rig, "bus-off")
    bus.until(lambda: len(ecu.codes(BUS_ERROR)) > before)
    assert {item[4:] for item in ecu.codes(BUS_ERROR)} == {bytes([ACK_ERROR, PRIMARY, 1])}
    assert {item[4:] for item in other.codes(BUS_ERROR)} == {bytes([ACK_ERROR, SECONDARY, 0])}
    fault(rig, "node", NODES[0], "on")
    bus.until(lambda: bus.get("can.canState") == CAN_ACTIVE)
    ecu.send(transmit(0x44))
    bus.until(lambda: struct.pack("<I", 0x44) in ecu.codes(CONFIRM))
    assert struct.pack("<I", 0x42) not in ecu.codes(CONFIRM)
    names("\n".join(bus.warnings()), "bus-off")


VICTIM = """
import sys
from pathlib import Path
from ls_bus_importer import Importer, transmit
from player import Model
with Importer(Model(Path(sys.argv[1])), lease=0.5) as bus:
    bus.start()
    while True:
        bus.ecus[0].send(transmit(0x300))
        bus.advance()
        print(len(bus.ecus[0].codes(0x20)), flush=True)
"""


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_a_dying_importer_leaves_safe_frames(
    bus: Importer, model: Model, tmp_path: Path, how: signal.Signals
) -> None:
    ecu, _ = bus.ecus
    copy = tmp_path / "CanBus.fmu"
    copy.write_bytes(model.path.read_bytes())
    path = os.pathsep.join([str(Path(__file__).parents[1]), *sys.path])
    process = subprocess.Popen(
        [sys.executable, "-c", VICTIM, str(copy)],
        env={**os.environ, "PYTHONPATH": path},
        stdout=subprocess.PIPE,
    )
    assert process.stdout is not None
    while int(process.stdout.readline()) < 10:
        bus.advance()
    assert 0x77 not in dict(ecu.frames())
    process.send_signal(how)
    bus.until(lambda: 0x77 in dict(ecu.frames()))
    assert dict(ecu.frames())[0x77] == b"\2\0"
    process.kill()
    process.wait()
    process.stdout.close()


def test_the_daemon_starts_again(start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    daemon = start_daemon("troll-can", config=CONFIG)
    model = fmu_of(daemon, tmp_path)
    with Importer(model, **BEAR) as bus, Importer(model, lease=30.0) as strict:
        bus.start()
        strict.start()
        (ecu,) = bus.ecus
        ecu.send(transmit(ASK_DRIVE, DEVICE_TYPE))
        bus.until(lambda: DRIVE_ANSWERS in dict(ecu.frames()))
        assert daemon.stop() == 0
        with pytest.raises(Exception, match="fmi3DoStep"):
            strict.until(lambda: False)
        names(strict.errors()[-1], f"'{daemon.bus}'")
        bus.until(lambda: not bus.get("connected"))
        assert bus.get("can.canState") == CAN_STOPPED
        ecu.send(transmit(ASK_DRIVE, DEVICE_TYPE))  # it is not sent later
        bus.until(lambda: ecu.codes(BUS_ERROR))
        start_daemon("troll-can", "--bus", daemon.bus, config=CONFIG)
        bus.until(lambda: bus.get("can.canState") == CAN_ACTIVE)
        ecu.got.clear()
        ecu.send(transmit(ASK_DRIVE, DEVICE_TYPE))
        bus.until(lambda: DRIVE_ANSWERS in dict(ecu.frames()))
        assert ecu.codes(CONFIRM) == [struct.pack("<I", ASK_DRIVE)]


def test_triggered_clocks(rig: Daemon, tmp_path: Path) -> None:
    """There is an event only when there is something for an ECU."""
    model = fmu_of(rig, tmp_path, "--ls-bus-clock", "triggered")
    assert "interval" not in model.variables
    with Importer(model, **BEAR) as bus:
        bus.start()
        (ecu,) = bus.ecus
        ecu.send(transmit(ASK_DRIVE, DEVICE_TYPE))
        bus.until(lambda: DRIVE_ANSWERS in dict(ecu.frames()))
        assert ecu.codes(CONFIRM) == [struct.pack("<I", ASK_DRIVE)]
        assert bus.empty_ticks == 0


def test_it_says_what_it_needs(model: Model, rig: Daemon, tmp_path: Path) -> None:
    with pytest.raises(Exception, match="instantiate"):
        Player(model)
    other = fmu_of(rig, tmp_path, "--ls-bus-ecus", "1")
    with Importer(other, bus="nosuch") as bus, pytest.raises(Exception, match="fmi3"):
        bus.start()
    refused = rig.ctl("generate", "Digital", str(tmp_path), "--ls-bus", "3", check=False)
    assert refused.returncode == 2
    names(refused.stderr, "--ls-bus 3", "EL2008", "no CAN terminal", "[slave.can]")

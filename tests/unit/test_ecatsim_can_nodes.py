"""CAN nodes that come with the simulator; the package `canopen` is the judge of CANopen nodes."""

import threading
import time
from contextlib import contextmanager

import can
import canopen
import pytest
from can_bench import MBIT, Bus, Keeper

from conftest import naming
from ecatd.base.errors import UsageError
from ecatsim.can import CanBus, CanFrame, CanNode
from ecatsim.can.canopen import NmtState
from ecatsim.can.eds import eds
from ecatsim.can.nodes.drive import EDS, CanopenDrive
from ecatsim.can.nodes.io import CanopenIO
from ecatsim.can.nodes.library import NODES, make
from ecatsim.can.nodes.sensor import TorqueSensor, sensor_traffic
from ecatsim.can.python_can import SimulatedBus
from ecatsim.devices.cia402 import PowerState
from ecatsim.rigs.library import make as make_rig

STEP = 1_000_000


def eventually(condition, seconds=20.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not come"
        time.sleep(0.01)


@contextmanager
def network(*nodes):
    """A running bus with nodes, and a CANopen master on it."""
    bus = CanBus(MBIT)
    for node in nodes:
        bus.add(node)
    ended = threading.Event()

    def run():
        while not ended.wait(0.001):
            bus.run(time.monotonic())

    thread = threading.Thread(target=run)
    thread.start()
    master = canopen.Network(SimulatedBus(bus, "master"))
    master.connect()
    try:
        yield master
    finally:
        master.disconnect()
        ended.set()
        thread.join()


# --- with the package `canopen` ------------------------------------------------------------------


def test_a_scan_finds_the_nodes():
    with network(CanopenDrive(5), CanopenIO(7)) as master:
        master.scanner.search()
        eventually(lambda: sorted(master.scanner.nodes) == [5, 7])


def test_sdo_transfers_and_aborts():
    with network(CanopenDrive(5)) as master:
        node = master.add_node(canopen.RemoteNode(5, str(EDS)))
        assert node.sdo[0x1000].raw == 0x00020192
        assert node.sdo[0x1008].raw == "CANopen drive"  # in segments
        node.sdo[0x6083].raw = 123456
        assert node.sdo[0x6083].raw == 123456
        for index, subindex, code in ((0x6041, 0, 0x06010002), (0x5000, 0, 0x06020000)):
            with pytest.raises(canopen.SdoAbortedError) as caught:
                node.sdo.download(index, subindex, b"\0\0")
            assert caught.value.code == code


def test_a_master_turns_the_motor_and_stops_it_by_nmt():
    drive = CanopenDrive(5)
    with network(drive) as master:
        node = master.add_node(canopen.RemoteNode(5, str(EDS)))
        node.nmt.wait_for_heartbeat()
        assert node.nmt.state == "PRE-OPERATIONAL"
        node.tpdo.read()
        node.rpdo.read()
        node.nmt.state = "OPERATIONAL"
        master.sync.start(0.01)
        node.rpdo[1][0x6060].raw = 9
        node.rpdo[1].transmit()

        def command(word, speed):
            node.rpdo[3][0x6040].raw, node.rpdo[3][0x60FF].raw = word, speed
            node.rpdo[3].transmit()

        for word, wanted in ((6, 0x21), (7, 0x23), (15, 0x27)):
            command(word, 0)
            eventually(lambda: node.tpdo[1][0x6041].raw & 0x6F == wanted)  # noqa: B023
        command(15, 655_360)
        eventually(lambda: abs(node.tpdo[3][0x606C].raw - 655_360) < 20_000)
        node.nmt.state = "STOPPED"
        eventually(lambda: drive.motor.speed == 0.0)
        eventually(lambda: drive.power_state == PowerState.SWITCH_ON_DISABLED)
        assert drive.state == NmtState.STOPPED


def test_a_mapping_of_the_master():
    drive = CanopenDrive(5)
    with network(drive) as master:
        node = master.add_node(canopen.RemoteNode(5, str(EDS)))
        node.tpdo.read()
        pdo = node.tpdo[4]
        pdo.clear()
        pdo.add_variable(0x6077)
        pdo.add_variable(0x6078)
        pdo.trans_type = 255
        pdo.event_timer = 20
        pdo.enabled = True
        node.tpdo.save()
        node.nmt.state = "OPERATIONAL"
        assert pdo.wait_for_reception(20) is not None
        assert len(pdo.data) == 4


def test_an_emergency_comes_and_goes():
    drive = CanopenDrive(5)
    with network(drive) as master:
        node = master.add_node(canopen.RemoteNode(5, str(EDS)))
        node.nmt.wait_for_heartbeat()
        drive.emergency(0x2310, 0x02)
        assert node.emcy.wait(timeout=20).code == 0x2310
        eventually(lambda: node.sdo[0x1003][1].raw == 0x2310)
        drive.emergency(0, 0)
        eventually(lambda: not node.emcy.active)


def test_a_node_of_the_package_runs_as_a_simulated_device():
    bus = CanBus(MBIT)
    ended = threading.Event()

    def run():
        while not ended.wait(0.001):
            bus.run(time.monotonic())

    thread = threading.Thread(target=run)
    thread.start()
    there, here = (canopen.Network(SimulatedBus(bus, name)) for name in ("device", "master"))
    try:
        there.connect()
        here.connect()
        device = there.add_node(canopen.LocalNode(9, str(EDS)))
        device.sdo[0x1017].raw = 100
        device.nmt.state = "PRE-OPERATIONAL"
        node = here.add_node(canopen.RemoteNode(9, str(EDS)))
        node.nmt.wait_for_heartbeat(20)
        device.sdo[0x6083].raw = 77
        assert node.sdo[0x6083].raw == 77
        device.nmt.stop_heartbeat()
    finally:
        here.disconnect()
        there.disconnect()
        ended.set()
        thread.join()


def test_frames_through_python_can():
    bus = CanBus(MBIT)
    one, other = SimulatedBus(bus, "one"), SimulatedBus(bus, "other")
    sent = [
        can.Message(arbitration_id=0x123, data=b"abc", is_extended_id=False),
        can.Message(arbitration_id=0x1234567, is_extended_id=True),
        can.Message(arbitration_id=5, is_extended_id=False, is_remote_frame=True, dlc=3),
    ]
    for message in sent:
        one.send(message)
    for message in sent:
        got = other.recv(20)
        assert got.equals(message, timestamp_delta=None, check_channel=False, check_direction=False)
        assert abs(got.timestamp - time.time()) < 60
    assert other.recv(0) is None
    other.set_filters([{"can_id": 7, "can_mask": 0x7FF, "extended": False}])
    for number in (6, 7):
        one.send(can.Message(arbitration_id=number, is_extended_id=False))
    assert other.recv(20).arbitration_id == 7
    assert other.state == can.BusState.ACTIVE
    other.shutdown()
    one.shutdown()


# --- in the time of the test ---------------------------------------------------------------------


class Watch(Keeper):
    """Keeps frames, and sends what a master sends."""

    def nmt(self, command, node):
        self.send(CanFrame(0, bytes([command, node])))

    def of(self, identifier):
        return [frame.data for frame in self.frames if frame.id == identifier]


@pytest.fixture
def bench():
    bus = Bus()
    node, master = CanopenIO(2, heartbeat_ms=10), Watch()
    bus.add(master)
    bus.add(node)
    bus.run_ns(2 * STEP, STEP)
    return bus, node, master


def test_boot_up_and_heartbeats(bench):
    bus, node, master = bench
    assert master.of(0x702)[0] == b"\0"
    bus.run_ns(100 * STEP, STEP)
    assert 9 <= len(master.of(0x702)[1:]) <= 11
    assert set(master.of(0x702)[1:]) == {b"\x7f"}
    master.nmt(1, 0)
    bus.run_ns(100 * STEP, STEP)
    assert master.of(0x702)[-1] == b"\x05"
    master.nmt(2, 3)  # another node
    bus.run_ns(20 * STEP, STEP)
    assert node.state == NmtState.OPERATIONAL
    master.nmt(2, 2)
    bus.run_ns(20 * STEP, STEP)
    assert master.of(0x702)[-1] == b"\x04"
    master.nmt(129, 2)
    bus.run_ns(20 * STEP, STEP)
    assert master.of(0x702).count(b"\0") == 2


def test_outputs_return_as_inputs_and_fall_when_it_is_stopped(bench):
    bus, _, master = bench
    master.send(CanFrame(0x202, b"\x55"))
    bus.run_ns(5 * STEP, STEP)
    assert master.of(0x182) == []  # not in PRE-OPERATIONAL
    master.nmt(1, 2)
    master.send(CanFrame(0x202, b"\x55"), CanFrame(0x302, b"\1\2\3\4"))
    bus.run_ns(5 * STEP, STEP)
    assert master.of(0x182)[-1] == b"\x55"
    assert master.of(0x282)[-1] == b"\1\2\3\4"
    count = len(master.frames)
    bus.run_ns(5 * STEP, STEP)
    assert len(master.frames) <= count + 1  # nothing has changed, but for a heartbeat
    master.nmt(2, 2)
    bus.run_ns(5 * STEP, STEP)
    master.nmt(1, 2)
    bus.run_ns(5 * STEP, STEP)
    assert master.of(0x182)[-1] == b"\0"


def test_synchronous_pdos():
    bus = Bus()
    drive, master = bus.add(CanopenDrive(5, heartbeat_ms=0)), bus.add(Watch())
    bus.run_ns(2 * STEP, STEP)
    master.nmt(1, 5)
    for _ in range(4):
        master.send(CanFrame(0x80))
        bus.run_ns(2 * STEP, STEP)
    assert len(master.of(0x285)) == len(master.of(0x385)) == 4
    write = b"\x2f\x01\x18\x02\x02\0\0\0"  # TPDO 2 with every second SYNC
    master.send(CanFrame(0x605, write))
    bus.run_ns(2 * STEP, STEP)
    for _ in range(4):
        master.send(CanFrame(0x80))
        bus.run_ns(2 * STEP, STEP)
    assert len(master.of(0x285)) == 6
    assert drive.status.refused == 0


def test_a_heartbeat_that_is_missing():
    bus = Bus()
    drive, master = bus.add(CanopenDrive(5)), bus.add(Watch())
    bus.run_ns(2 * STEP, STEP)
    master.send(CanFrame(0x605, b"\x23\x16\x10\x01" + (0x7F << 16 | 50).to_bytes(4, "little")))
    master.nmt(1, 5)
    for _ in range(10):
        master.send(CanFrame(0x77F, b"\x05"))
        bus.run_ns(30 * STEP, STEP)
    assert drive.state == NmtState.OPERATIONAL
    bus.run_ns(60 * STEP, STEP)
    assert drive.state == NmtState.PRE_OPERATIONAL
    assert master.of(0x85)[-1][:3] == b"\x30\x81\x11"


@pytest.mark.parametrize(
    ("option", "state"),
    [
        (0, PowerState.OPERATION_ENABLED),
        (1, PowerState.FAULT),
        (2, PowerState.SWITCH_ON_DISABLED),
        (3, PowerState.SWITCH_ON_DISABLED),
    ],
)
def test_what_a_drive_does_that_is_stopped(option, state):
    bus = Bus()
    drive, master = bus.add(CanopenDrive(5)), bus.add(Watch())
    bus.run_ns(2 * STEP, STEP)
    master.send(CanFrame(0x605, b"\x2b\x07\x60\x00" + bytes([option, 0, 0, 0])))
    master.nmt(1, 5)
    master.send(CanFrame(0x205, b"\x06\0\x09"))
    for word in (6, 7, 15, 15):
        bus.run_ns(5 * STEP, STEP)
        master.send(CanFrame(0x405, bytes([word, 0]) + (200_000).to_bytes(4, "little")))
    bus.run_ns(500 * STEP, STEP)
    assert drive.motor.speed > 10
    master.nmt(2, 5)
    bus.run_ns(700 * STEP, STEP)
    assert drive.power_state == state
    assert (drive.motor.speed > 10) == (option == 0)


def test_a_drive_without_power():
    bus = Bus()
    drive, master = bus.add(CanopenDrive(5)), bus.add(Watch())
    bus.run_ns(2 * STEP, STEP)
    master.nmt(1, 5)
    bus.run_ns(2 * STEP, STEP)
    drive.power(False)
    assert drive.power_state == PowerState.SWITCH_ON_DISABLED
    before = len(master.frames)
    bus.run_ns(500 * STEP, STEP)
    assert len(master.frames) == before
    drive.power(True)
    bus.run_ns(2 * STEP, STEP)
    assert master.frames[-1].data in (b"\0", b"\x7f")
    assert drive.state == NmtState.PRE_OPERATIONAL


def test_the_torque_sensor_sends_1800_frames_a_second():
    bus = Bus()
    sensor = bus.add(TorqueSensor())
    judge = bus.add(CanNode("judge", checks=sensor_traffic(0x18FF0000)))
    bus.run_ns(1_000_000_000)
    assert abs(sensor.status.sent - 1800) <= 14
    assert all(found.received > 95 and not found.lost for found in judge.check_results)


# --- files and names -----------------------------------------------------------------------------


def test_the_data_sheet_is_that_of_the_drive():
    text = eds(CanopenDrive(), EDS.name, "CANopen drive")
    assert EDS.read_text() == text, f"python -m ecatsim.can.eds {EDS.name}"


def test_the_data_sheet_has_every_object():
    dictionary = canopen.import_od(str(EDS), node_id=5)
    node = CanopenDrive(5)
    for item in node.dictionary:
        for subindex, entry in item.entries.items():
            found = dictionary.get_variable(item.index, subindex)
            assert found is not None, hex(item.index)
            assert found.data_type == entry.type
            if isinstance(entry.value, int):
                assert found.default == entry.value, (hex(item.index), subindex)


def test_nodes_by_name():
    assert type(make("canopendrive", node_id=9)) is CanopenDrive
    assert set(NODES) == {"CanopenDrive", "CanopenIO", "TorqueSensor"}
    with pytest.raises(UsageError, match=naming("CanopenDriv", "CanopenDrive")):
        make("CanopenDriv")
    with pytest.raises(UsageError, match=naming("node_id", "127", "200")):
        make("CanopenDrive", node_id=200)
    with pytest.raises(UsageError, match=naming("colour", "node_id")):
        make("CanopenIO", colour=1)


def test_the_rig_has_its_buses():
    rig = make_rig("troll-can")
    assert [bus.places for bus in rig.can] == [
        ["EL6751", "CANopen drive 5", "torque sensor"],
        ["EL6751", "CANopen I/O 2"],
    ]
    assert [device.order for device in rig.devices[6:]] == ["EL6751", "EL6751"]

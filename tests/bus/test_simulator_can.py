"""CAN terminals with a real master on a real interface. This file is a rig file as well."""

import time
from pathlib import Path

import pytest
from masters import open_pysoem, run, to_op

from ecatd.etg.can_terminals import PROFILE_29, Settings
from ecatsim.can import CanBus, CanFrame, CanNode, Traffic
from ecatsim.control import Simulator
from ecatsim.devices.can_terminals import EL6751CAN
from ecatsim.devices.library import make
from ecatsim.rig import Rig

pytestmark = pytest.mark.bus

FRAMES = 4000
QUEUE = 32
THERE = Traffic(0x10000, extended=True, rate=2000, count=FRAMES, delay=5.0)
BACK = Traffic(0x20000, extended=True)
ECHO = 0x20000  # so the identifier of an echo wins
# A busy machine gives the master no time now and then. Real terminals keep 100 frames.
KEPT = 20_000


def rig():
    bus = CanBus(1_000_000)
    bus.add(CanNode("sensor", traffic=[THERE], checks=[BACK]))
    bus.add(CanNode("echo", echo=ECHO))
    result = Rig("can", [make("EK1100"), EL6751CAN(bus, kept=KEPT)])
    result.can.append(bus)
    return result


def set_up(master):
    settings = Settings(1000, 1000, 29, QUEUE, QUEUE, flags=8)
    for item in EL6751CAN.told.written(settings):
        master.slaves[1].sdo_write(item.index, item.subindex, item.data, item.complete)


def master_exchange():
    from can_handshake import Handshake  # of the folder above, which a rig file does not have

    master = open_pysoem(set_up)
    slave, can = master.slaves[1], Handshake(PROFILE_29, QUEUE, QUEUE)
    to_op(master)
    can.begin(slave.input)
    can.pending = [CanFrame(BACK.id, n.to_bytes(8, "little"), extended=True) for n in range(FRAMES)]
    numbers, echoes, end = [], 0, time.monotonic() + 100
    while (len(numbers) < FRAMES or echoes < FRAMES) and time.monotonic() < end:
        for frame in can.cycle(slave.input):
            number = int.from_bytes(frame.data, "little")
            if frame.id == THERE.id:
                numbers.append(number)
            elif frame.id == BACK.id ^ ECHO:
                echoes += number == echoes
        slave.output = bytes(can.outputs)
        master.send_processdata()
        master.receive_processdata(10_000)
        time.sleep(0.0005)
    with Simulator() as simulator:
        (bus,) = simulator.can()
    return {"numbers": numbers, "echoes": echoes, "bus": bus}


def test_many_frames_each_way_with_pysoem():
    found = run(Path(__file__), master_exchange)
    sensor, echo, terminal = found["bus"]["nodes"]
    assert found["numbers"] == list(range(FRAMES))
    assert found["echoes"] == FRAMES
    (check,) = sensor["checks"]
    assert check == {"received": FRAMES, "lost": 0, "doubled": 0, "wrong": 0}
    assert terminal["overflowed"] == terminal["refused"] == echo["refused"] == 0
    assert terminal["sent"] == FRAMES
    assert found["bus"]["error_frames"] == sensor["failed"]

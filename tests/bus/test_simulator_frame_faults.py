"""Late and doubled frames on a real interface, as `ecatsim run` serves it."""

import socket
import struct

import pytest
from test_simulator_topology import FIRST, SECOND, run

pytestmark = pytest.mark.bus

LATE = 500_000  # µs: long enough for a busy machine to send some frames meanwhile
ROOM = 64


def frame(index, command=12):
    """One LRW (or another command) of four bytes with an index to be known by."""
    datagram = struct.pack("<BBIHH4xH", command, index, 0, 4, 0, 0)
    head = b"\xff" * 6 + b"\x02\0\0\0\0\1" + b"\x88\xa4"
    return (head + struct.pack("<H", 0x1000 | len(datagram)) + datagram).ljust(60, b"\0")


def opened(name):
    wire = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(0x88A4))
    wire.bind((name, 0x88A4))
    wire.settimeout(60)
    return wire


def receive(wire, count):
    """Indices of the answers that come; what we sent ourselves is left out."""
    found = []
    while len(found) < count:
        data, (_, _, kind, *_) = wire.recvfrom(2048)
        if kind != socket.PACKET_OUTGOING:
            found.append(data[17])
    return found


def is_silent(wire):
    wire.settimeout(0.1)
    try:
        receive(wire, 1)
    except TimeoutError:
        return True
    return False


def master_late(interface_back):
    from ecatsim.control import Simulator

    there = opened(FIRST)
    back = opened(interface_back) if interface_back != FIRST else there
    with Simulator() as simulator:
        simulator.faults.delay(LATE)
        simulator.faults.duplicate(at_cycle=3)
        for index in range(4):
            there.send(frame(index))
        found = receive(back, 5)
        return [found, is_silent(back)]


@pytest.mark.parametrize(("options", "back"), [([], FIRST), (["--ring"], SECOND)])
def test_a_late_frame_is_overtaken_and_a_doubled_one_comes_twice(options, back):
    assert run("line:2", master_late, back, options=options) == [[1, 2, 2, 3, 0], True]


def master_many():
    from ecatsim.control import Simulator

    wire = opened(FIRST)
    with Simulator() as simulator:
        simulator.faults.delay(4 * LATE, count=100)
        for index in range(100):
            wire.send(frame(index))
        return [receive(wire, ROOM), is_silent(wire)]


def test_late_frames_beyond_the_room_for_them_are_lost():
    assert run("line:1", master_many) == [list(range(ROOM)), True]

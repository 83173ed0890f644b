"""A second opinion: kickcat, a master that shares no code with SOEM.

This file is a rig file as well.
"""

import os
import socket
import struct
import time
from pathlib import Path

import pytest
from masters import INTERFACE, pattern, run

from ecatsim import Rig
from ecatsim.devices.beckhoff import EK1100
from ecatsim.devices.generic import Loopback

pytestmark = [pytest.mark.bus, pytest.mark.long]

HERE = Path(__file__)
MOST = 63  # slaves with inputs and outputs: kickcat 2.5 maps all at once, with 255 datagrams
BRD, AL_STATUS = 7, 0x0130


def rig():
    """A line; what is more than kickcat can map are couplers."""
    count = int(os.environ["SLAVES"])
    couplers = max(0, count - MOST)
    slaves = [EK1100() for _ in range(couplers)] + [Loopback() for _ in range(count - couplers)]
    return Rig("kickcat", slaves)


def broadcast(command, register, data):
    """Sends one broadcast datagram of our own; its data and working counter."""
    body = struct.pack("<BBHHHH", command, 0, 0, register, len(data), 0) + data + bytes(2)
    header = b"\xff" * 6 + b"judge!" + b"\x88\xa4" + struct.pack("<H", 0x1000 | len(body))
    with socket.socket(socket.AF_PACKET, socket.SOCK_RAW) as wire:
        wire.bind((INTERFACE, 0x88A4))
        wire.send((header + body).ljust(60, b"\0"))
        while True:
            frame = wire.recv(2048)
            if frame[7:12] == header[7:12] and frame[6] & 2:
                end = 26 + len(data)
                return frame[26:end], struct.unpack_from("<H", frame, end)[0]


def started_kickcat(*, mapped=False):
    """A bus of kickcat in PREOP. Some of its time-outs are fixed, so it may take another try."""
    import kickcat

    for left in reversed(range(5)):
        link = kickcat.create_link(INTERFACE, "")
        link.set_timeout(0.02)  # seconds; each scan waits some hundred times this long
        bus = kickcat.Bus(link)
        try:
            bus.init(0.0)  # no watchdogs, for the same reason
            if mapped:
                bus.create_mapping()
        except RuntimeError:
            if not left:
                raise
        else:
            return bus
    raise AssertionError


def master_kickcat():
    """Process data of all slaves in OP; kickcat itself raises where a working counter is wrong."""
    import kickcat

    bus = started_kickcat(mapped=True)
    bus.request_state(kickcat.State.SAFE_OP)
    bus.wait_for_state(kickcat.State.SAFE_OP, 60.0)
    slaves = list(bus.slaves())
    for slave in slaves:
        slave.set_output_bytes(bytes(slave.output_size))
    bus.request_state(kickcat.State.OPERATIONAL)
    bus.wait_for_state(kickcat.State.OPERATIONAL, 60.0, bus.process_data)
    for i, slave in enumerate(slaves):
        slave.set_output_bytes(pattern(i, 5, slave.output_size))
    for _ in range(50):
        bus.process_data()
        time.sleep(0.001)
    state, counter = broadcast(BRD, AL_STATUS, bytes(1))
    return {
        "states": [state[0], counter],
        "data": [[s.output_size, bytes(s.input_data)[: s.input_size].hex()] for s in slaves],
    }


def test_kickcat_brings_troll_to_op():
    found = run("troll", master_kickcat)
    assert found["states"] == [8, 8]
    assert [size for size, _ in found["data"]] == [16, 0, 0, 1, 0, 0, 0, 0]
    assert [len(data) // 2 for _, data in found["data"]] == [16, 0, 1, 0, 32, 32, 0, 0]
    wired = pattern(3, 5, 1)[0] & 0x0F
    assert int(found["data"][2][1], 16) & 0x0F == wired, "the EL1018 sees the EL2008"


@pytest.mark.parametrize("count", [1, 200])
def test_kickcat_exchanges_with_lines(count, monkeypatch):
    monkeypatch.setenv("SLAVES", str(count))
    found = run(HERE, master_kickcat)
    assert found["states"] == [8, count]
    couplers = max(0, count - MOST)
    expected = [[32, pattern(i, 5, 32).hex()] for i in range(couplers, count)]
    assert found["data"] == [[0, ""]] * couplers + expected

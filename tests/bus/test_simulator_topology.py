"""Branches and rings on the bus: what real masters make of them, and of cables that break."""

import contextlib
import json
import struct
import subprocess
import sys
import time
from pathlib import Path

import pytest
from masters import new_master

from ecatd.etg.pdo import Entry, Pdo
from ecatsim.devices.beckhoff import EK1100, EK1122
from ecatsim.esc import Chip
from ecatsim.rig import Rig
from ecatsim.slave.device import Device

pytestmark = pytest.mark.bus

HERE = Path(__file__)
FIRST, SECOND = "ecat-master", "ecat-master2"
PREOP, SAFEOP, OP = 2, 4, 8


def run(rig, master, *arguments, options=()):
    """Runs a function of a file of this folder beside a rig and returns what it found."""
    folders = [str(HERE.parent), str(HERE.parent.parent)]  # the latter for `conftest`
    code = (
        f"import sys, json; sys.path[:0] = {folders!r}; "
        f"import {master.__module__} as t; "
        f"print('found', json.dumps(t.{master.__name__}(*{arguments!r})))"
    )
    command = [sys.executable, "-m", "ecatsim", "run", str(rig), *options]
    result = subprocess.run(
        [*command, "--", sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr + result.stdout
    (found,) = [line for line in result.stdout.splitlines() if line.startswith("found ")]
    return json.loads(found.removeprefix("found "))


def open_ring(count, second=SECOND):
    """A bus in OP with pysoem, without watchdogs, which a busy machine could let expire."""

    master = new_master()
    master.open(FIRST, second)
    assert master.config_init() == count
    for slave in master.slaves:
        slave._fpwr(0x0420, b"\x00\x00")
    master.config_map()
    assert master.state_check(SAFEOP, 5_000_000) == SAFEOP
    cycle(master)
    master.state = OP
    master.write_state()
    for _ in range(2000):
        cycle(master)
        if master.read_state() == OP:
            return master
    raise AssertionError([hex(slave.state) for slave in master.slaves])


def cycle(master, count=1):
    """Exchanges process data; the last working counter."""
    for _ in range(count):
        master.send_processdata()
        counter = master.receive_processdata(20_000)
        time.sleep(0.001)
    return counter


def echoes(master, value):
    """The slaves that return what they get, by position; and the last working counter."""
    for slave in master.slaves:
        slave.output = bytes([value]) * 32
    for _ in range(200):
        counter = cycle(master)
        good = [i for i, s in enumerate(master.slaves) if bytes(s.input) == bytes([value]) * 32]
        if len(good) == len(master.slaves):
            break
    return [good, counter]


# --- ring: pysoem ----------------------------------------------------------------------------


def master_ring(count):
    from ecatsim.control import Simulator

    master = open_ring(count)
    found = {"whole": echoes(master, 1), "broken": [], "healed": [], "states": []}
    with Simulator() as simulator:
        for i in range(count + 1):
            where = (i, 0) if i < count else (count - 1, 1)
            simulator.faults.break_link(*where)
            found["broken"].append(echoes(master, 10 + i))
            found["states"].append(master.read_state())
            simulator.faults.heal_link(*where)
            found["healed"].append(echoes(master, 100 + i))
    return found


def test_pysoem_loses_no_slave_wherever_the_ring_breaks():
    found = run("line:5", master_ring, 5, options=["--ring"])
    everything = [[0, 1, 2, 3, 4], 15]
    assert found["whole"] == everything
    assert found["broken"] == [everything] * 6
    assert found["healed"] == [everything] * 6
    assert found["states"] == [OP] * 6


def master_line(count):
    from ecatsim.control import Simulator

    master = open_ring(count, None)
    with Simulator() as simulator:
        simulator.faults.break_link(2, 0)
        lost = echoes(master, 1)
        simulator.faults.heal_link(2, 0)
        return [lost, echoes(master, 2)]


def test_a_line_loses_what_is_behind_the_break():
    assert run("line:5", master_line, 5) == [[[0, 1], 6], [[0, 1, 2, 3, 4], 15]]


# --- ring: kickcat ---------------------------------------------------------------------------


def master_kickcat(count):
    import kickcat

    from ecatsim.control import Simulator

    link = kickcat.create_link(FIRST, SECOND)
    link.set_timeout(0.2)  # seconds; for a busy machine
    bus = kickcat.Bus(link)
    bus.init(0.0)
    bus.create_mapping()
    bus.request_state(kickcat.State.SAFE_OP)
    bus.wait_for_state(kickcat.State.SAFE_OP, 60.0)
    slaves = list(bus.slaves())
    for slave in slaves:
        slave.set_output_bytes(bytes(slave.output_size))
    bus.request_state(kickcat.State.OPERATIONAL)
    bus.wait_for_state(kickcat.State.OPERATIONAL, 60.0, bus.process_data)
    found = []
    with Simulator() as simulator:
        for broken in (None, 2, None, 0, None):
            if broken is not None:
                simulator.faults.break_link(broken, 0)
            value = 20 + len(found)
            for slave in slaves:
                slave.set_output_bytes(bytes([value]) * slave.output_size)
            for _ in range(50):
                with contextlib.suppress(Exception):  # until it knows that the ring is broken
                    bus.process_data()
                time.sleep(0.001)
            found.append([set(bytes(s.input_data)[: s.input_size]) == {value} for s in slaves])
            if broken is not None:
                simulator.faults.heal_link(broken, 0)
    return found


@pytest.mark.long
def test_kickcat_loses_no_slave_when_the_ring_breaks():
    found = run("line:5", master_kickcat, 5, options=["--ring"])
    assert found == [[True] * 5] * 5


# --- branches --------------------------------------------------------------------------------


class Box(Device):
    """A box with two Ethernet ports and four bytes each way."""

    vendor, product, revision, order = 0x0000FFFF, 7, 1, "Box"
    rx_pdos = (Pdo(0x1600, "Out", 0, [Entry(0x7000, 1, "Out", 7, 32)]),)
    tx_pdos = (Pdo(0x1A00, "In", 1, [Entry(0x6000, 1, "In", 7, 32)]),)

    def step(self, now):
        self[0x6000, 1] = self[0x7000, 1]


class Terminal(Box):
    """The same on the E-bus."""

    product, order = 8, "Terminal"
    chip = Chip(ports=0x0A)


def rig():
    """A coupler, a terminal, a junction and a terminal; boxes at the sockets of both."""
    coupler, junction, terminals = EK1100(), EK1122(), [Terminal(), Terminal()]
    boxes = [Box() for _ in range(4)]
    result = Rig("branches", [coupler, terminals[0], junction, terminals[1], *boxes])
    result.connect(boxes[0], coupler, 2)
    result.connect(boxes[1], junction, 1)
    result.connect(boxes[3], junction, 3)
    return result


def master_branches():

    master = new_master()
    master.open(FIRST)
    master.config_init()
    found = {
        "names": [slave.name for slave in master.slaves],
        "status": [int.from_bytes(slave._fprd(0x0110, 2), "little") for slave in master.slaves],
    }
    for slave in master.slaves:
        slave._fpwr(0x0420, b"\x00\x00")
    master.config_map()
    assert master.state_check(SAFEOP, 5_000_000) == SAFEOP
    master.state = OP
    master.write_state()
    for _ in range(2000):
        cycle(master)
        if master.read_state() == OP:
            break
    with_data = [slave for slave in master.slaves if len(slave.output)]
    for number, slave in enumerate(with_data):
        slave.output = struct.pack("<I", 1000 + number)
    cycle(master, 50)
    found["echoes"] = [struct.unpack("<I", slave.input)[0] for slave in with_data]
    return found


def open_ports(status):
    """Ports with communication and an open loop, as a master finds out the topology."""
    return [port for port in range(4) if status >> (8 + 2 * port) & 3 == 2]


def test_branches_at_a_coupler_and_a_junction():
    found = run(HERE, master_branches)
    names = ["EK1100", "Terminal", "EK1122", "Box", "Box", "Box", "Terminal", "Box"]
    assert found["names"] == names
    assert [open_ports(status) for status in found["status"]] == [
        [0, 1, 2],
        [0, 1],
        [0, 1, 2, 3],
        [0],
        [0, 1],
        [0],
        [0],
        [0],
    ]
    assert found["echoes"] == [1000 + i for i in range(6)]


# --- the command -----------------------------------------------------------------------------


def ecatsim(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "ecatsim", "run", *arguments],
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["line:2", "--second", "eth1"], "--second | --interface"),
        (["line:2", "--ring", "--interface", "lo"], "--interface lo | --second"),
        (["line:2", "--interface", "lo", "--second", "lo"], "ring | two"),
        (["empty", "--ring"], "ring | one slave"),
    ],
)
def test_wrong_rings_are_explained(arguments, message):
    result = ecatsim(*arguments)
    assert (result.returncode, result.stdout) == (2, "")
    for token in message.split(" | "):
        assert token in result.stderr
    assert result.stderr.count("\n") == 1


def test_both_ends_of_a_ring_may_exist_already():
    """A simulator inside the namespace of another one, which serves the far ends of two pairs."""
    inner = [sys.executable, "-m", "ecatsim", "run", "line:3", "--interface", FIRST]
    code = "import os; print(sorted(n for n in os.listdir('/sys/class/net') if 'ecat' in n))"
    result = ecatsim(
        *("line:1", "--ring", "--"),
        *(*inner, "--second", SECOND, "--ready-fd", "1", "--", sys.executable, "-c", code),
    )
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout.splitlines()[0])["second"] == SECOND

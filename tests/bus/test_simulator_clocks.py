"""Distributed clocks with a real master: SOEM measures the delays, synchronises and starts SYNC0.

The clocks that are judged are those of the simulated slaves themselves, at one moment.
"""

import json
import struct
import subprocess
import sys
import time
from pathlib import Path

import pytest
from masters import new_master
from test_simulator_masters import INTERFACE, OP, cycle, open_pysoem, to_op

from ecatd.base import network_namespace as namespace
from ecatsim.esc import Chip
from ecatsim.net import netlink
from ecatsim.rigs import library as rigs
from ecatsim.simulation import Simulation

pytestmark = pytest.mark.bus

HERE = Path(__file__)
SIMULATOR_END = "ecat-sim"
SLAVES = 8
HOP = 400  # ns from a slave of a line to the next
DRIFTS = (3, 50, -50, 20, -20, 50, -50, 0)
CYCLE0, CYCLE1 = 1_000_000, 3_000_000


def python(function, *arguments):
    """The command that calls a function of this file."""
    code = (
        f"import sys; sys.path.insert(0, {str(HERE.parent)!r}); import {HERE.stem} as t; "
        f"t.{function.__name__}(*{arguments!r})"
    )
    return [sys.executable, "-c", code]


def simulate(master, rig, without_dc):
    """Simulates drifting slaves beside a master; prints what both have found."""
    namespace.enter_new()
    netlink.create_veth(SIMULATOR_END, INTERFACE)
    what = rigs.make(rig)
    for position in without_dc:
        what.devices[position].chip = Chip(dc=False)
    simulation = Simulation(what)
    segment = simulation.segment
    for position, drift in enumerate(DRIFTS[: len(what.devices)]):
        segment.set_clock(position, drift_ppm=drift, offset_ns=position * 1_234_567_890)
    segment.start(SIMULATOR_END)
    child = subprocess.Popen(python(globals()[master]), stdout=subprocess.PIPE, text=True)
    simulation.run(lambda: child.poll() is not None)
    times = [clock.system_ns for clock in segment.clocks()]
    lines = child.stdout.read().splitlines()
    found = [line.removeprefix("found ") for line in lines if line.startswith("found ")]
    result = {
        "master": json.loads(found[0]),
        "ahead": [time - times[0] for time in times],
        "delays": [clock.delay_ns for clock in segment.clocks()],
    }
    simulation.close()
    assert child.wait() == 0
    print("found", json.dumps(result))


def run(master, rig=f"line:{SLAVES}", without_dc=()):
    """What simulator and master have found."""
    result = subprocess.run(
        python(simulate, master.__name__, rig, without_dc),
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr + result.stdout
    (found,) = [line for line in result.stdout.splitlines() if line.startswith("found ")]
    return json.loads(found.removeprefix("found "))


def register(slave, address, size):
    return int.from_bytes(slave._fprd(address, size), "little")


def differences(master):
    """Register 0x092C of all slaves but the reference clock."""
    return [register(slave, 0x092C, 4) & 0x7FFFFFFF for slave in master.slaves[1:]]


def synchronise(master):
    """Cycles, each with an FRMW of the time, until the slaves say that they follow."""
    for _ in range(100):
        cycle(master, 50)
        if max(differences(master)) < 50:
            return
    raise AssertionError(differences(master))


def master_synchronises():
    has_dc = []
    master = open_pysoem(lambda master: has_dc.append(master.config_dc()))
    to_op(master)
    synchronise(master)
    for slave in master.slaves:
        slave.dc_sync(True, CYCLE0, 0, CYCLE1)
    cycle(master, 150)  # SOEM has the first pulse a tenth of a second later
    pulses = [struct.unpack("<QQ", slave._fprd(0x0990, 16)) for slave in master.slaves]
    states = [(register(slave, 0x0981, 1), register(slave, 0x0984, 1)) for slave in master.slaves]
    synchronise(master)
    found = {"dc": has_dc[0], "pulses": pulses, "states": states, "reached": master.read_state()}
    print("found", json.dumps(found), flush=True)
    master.close()


def test_soem_synchronises_a_line_of_drifting_slaves():
    found = run(master_synchronises)
    master = found["master"]
    assert master["dc"]
    assert master["reached"] == OP
    for position, delay in enumerate(found["delays"]):
        assert delay == pytest.approx(HOP * position, abs=position), "times are whole nanoseconds"
    assert max(abs(ahead) for ahead in found["ahead"]) < 1000, found["ahead"]
    assert master["states"] == [[0x07, 0]] * SLAVES, "no first pulse is pending"
    for sync0, sync1 in master["pulses"]:
        assert sync0 % CYCLE0 == 0
        assert sync1 % (CYCLE0 + CYCLE1) == CYCLE1, "a multiple, and the delay of SYNC1"


def master_measures():

    master = new_master()
    master.open(INTERFACE)
    assert master.config_init() > 0
    has_dc = master.config_dc()
    time.sleep(0.01)
    print("found", json.dumps(has_dc), flush=True)
    master.close()


def test_delays_through_slaves_without_clocks():
    """Slaves 1 and 2 have none: their delays are part of that of slave 3."""
    found = run(master_measures, "line:5", (1, 2))
    assert found["master"]
    assert found["delays"][:3] == [0, 0, 0]
    assert found["delays"][3:] == pytest.approx([3 * HOP, 4 * HOP], abs=2)


def test_a_segment_without_clocks_has_no_dc():
    assert not run(master_measures, "line:2", (0, 1))["master"]

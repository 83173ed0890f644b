"""Faults on demand as real masters see them.

Masters run as commands beside the simulator, which they control themselves. They are deterministic:
cycles are counted from the first process data on.
"""

import os
import re
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path

import pytest
from masters import (
    ECATSIM,
    ERROR,
    INIT,
    INTERFACE,
    LOST,
    OP,
    PATIENCE,
    SAFEOP,
    new_master,
    open_pysoem,
    run,
    to_op,
    wait_state,
)

from ecatsim import Rig
from ecatsim.control import Simulator
from ecatsim.devices.library import make
from ecatsim.faults.frames import Drop
from ecatsim.faults.slaves import AlError

pytestmark = pytest.mark.bus

HERE = Path(__file__)
DOCUMENT = HERE.parents[2] / "docs" / "simulator-control.md"
APRD, BRD, FRMW = 1, 7, 14


def rig():
    """Faults that a rig brings along."""
    faults = [Drop(at_cycle=400, count=2), AlError(1, 0x0042, at_cycle=450)]
    return Rig("faulty", [make("Loopback32") for _ in range(3)], faults=faults)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Sockets of this test alone."""
    monkeypatch.setenv("ECATSIM_RUNTIME_DIR", str(tmp_path / "run"))


# --- for masters -----------------------------------------------------------------------------


def counters(master, count):
    """Working counters of so many cycles, -1 where the frame is lost.

    What the simulator, which may get no processor for a while, has not yet seen is not lost.
    """
    found = []
    with Simulator() as simulator:
        for _ in range(count):
            begun = simulator.status().cycles
            master.send_processdata()
            while simulator.status().cycles == begun:
                pass
            found.append(master.receive_processdata(100_000))
    return found


def counters_until(master, counter):
    """Working counters of cycles up to the first that is this one."""
    found, end = counters(master, 1), time.monotonic() + PATIENCE
    while found[-1] != counter and time.monotonic() < end:
        found += counters(master, 1)
    return found


def run_to(master, simulator, number):
    """Exchanges process data up to a cycle."""
    counters(master, number - simulator.status().cycles)


class Wire:
    """Single datagrams, on a socket of their own."""

    def __init__(self):
        self.socket = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(0x88A4))
        self.socket.bind((INTERFACE, 0x88A4))

    def send(self, command, position, address, size, logical=0):
        key = position & 0xFFFF
        head = struct.pack("<BBHHHH", command, 0x99, key, address, size, 0)
        body = head + bytes(size + 2)
        raw = b"\xff" * 6 + b"\x02" + bytes(5) + b"\x88\xa4" + struct.pack("<H", 0x1000 | len(body))
        self.socket.send((raw + body).ljust(60, b"\0"))

    def receive(self, patience=PATIENCE):
        """Data and working counter of the next answer, None if there is none."""
        self.socket.settimeout(patience)
        while True:
            try:
                frame = self.socket.recv(2048)
            except TimeoutError:
                return None
            if frame[17] == 0x99:
                size = struct.unpack_from("<H", frame, 22)[0] & 0x7FF
                return frame[26 : 26 + size], struct.unpack_from("<H", frame, 26 + size)[0]

    def ask(self, *datagram, patience=PATIENCE):
        self.send(*datagram)
        return self.receive(patience)

    def word(self, position, address):
        return struct.unpack("<H", self.ask(APRD, -position, address, 2)[0])[0]

    def reached(self):
        """How many slaves answer a broadcast."""
        return self.ask(BRD, 0, 0, 1)[1]


# --- frames ----------------------------------------------------------------------------------


def master_lost_frames():
    master = open_pysoem()
    to_op(master)
    with Simulator() as simulator:
        before = simulator.status()
        simulator.faults.drop(at_cycle=before.cycles + 5, every=3, count=4)
        found = counters(master, 30)
        (fault,) = simulator.faults.list()
        after = simulator.status()
    return [found, fault.struck, fault.done, after.dropped - before.dropped]


def test_lost_frames_are_those_of_the_schedule():
    found, struck, done, dropped = run("line:3", master_lost_frames)
    assert [number for number, counter in enumerate(found, 1) if counter == LOST] == [5, 8, 11, 14]
    assert {counter for counter in found if counter != LOST} == {9}
    assert (struck, done, dropped) == (4, True, 4)


def master_wrong_counter():
    master = open_pysoem()
    to_op(master)
    with Simulator() as simulator:
        now = simulator.status().cycles
        simulator.faults.wkc(3, at_cycle=now + 2, every=2, count=2)
        simulator.faults.wkc(-4, at_cycle=now + 8)
    return counters(master, 10)


def test_the_working_counter_is_wrong_in_exactly_these_cycles():
    assert run("line:3", master_wrong_counter) == [9, 12, 9, 12, 9, 9, 9, 5, 9, 9]


def master_by_chance():
    master = open_pysoem()
    to_op(master)
    with Simulator() as simulator:
        simulator.faults.drop(at_cycle=500, count=0, probability=0.2, seed=11)
        simulator.faults.wkc(1, at_cycle=500, count=0, probability=0.2, seed=12)
        simulator.faults.al_error(0, 0x42, at_cycle=500, count=0, probability=0.2, seed=13)
        run_to(master, simulator, 499)
        found = [counter == LOST for counter in counters(master, 200)]
        simulator.faults.clear(1)
        counters(master, 1)
        struck = [fault.struck for fault in simulator.faults.list()]
    return [found, struck]


@pytest.mark.long
def test_the_same_seed_gives_the_same_run():
    first, second = run("line:2", master_by_chance), run("line:2", master_by_chance)
    assert first[0] == second[0]
    assert 15 < sum(first[0]) < 70
    assert first[1][0] == second[1][0]


def master_late_and_twice():
    wire = Wire()
    with Simulator() as simulator:
        simulator.faults.delay(60_000, all_frames=True)
        begin = time.monotonic()
        answer = wire.ask(BRD, 0, 0, 1)
        late = time.monotonic() - begin
        simulator.faults.duplicate(all_frames=True)
        twice = [wire.ask(BRD, 0, 0, 1), wire.receive(), wire.receive(patience=0.5)]
        simulator.faults.drop(all_frames=True, count=2)
        lost = [wire.ask(BRD, 0, 0, 1, patience=0.5) is None for _ in range(2)]
        lost.append(wire.ask(BRD, 0, 0, 1) is None)
    return [answer[1], late, [one and one[1] for one in twice], lost]


def test_late_frames_and_frames_that_come_twice():
    answer, late, twice, lost = run("line:2", master_late_and_twice)
    assert (answer, twice) == (2, [2, 2, None])
    assert late >= 0.06
    assert lost == [True, True, False]


def master_noise():
    master = open_pysoem()
    to_op(master)
    wire = Wire()
    with Simulator() as simulator:
        simulator.faults.noise(1, count=3)
        found = counters(master, 5)
    return [found, [wire.ask(APRD, -i, 0x0300, 2)[0][1] for i in range(3)]]


def test_noise_is_counted_where_it_is():
    found, errors = run("line:3", master_noise)
    assert found == [LOST, LOST, LOST, 9, 9]
    assert errors == [0, 3, 0], "RX errors of port 0, register 0x0301"


def test_faults_of_the_rig_itself():
    found, state = run(HERE, master_faulty_rig)
    assert [number for number, counter in enumerate(found, 390) if counter == LOST] == [400, 401]
    assert state == [SAFEOP | ERROR, 0x0042]


def master_faulty_rig():
    master = open_pysoem()
    to_op(master)
    with Simulator() as simulator:
        run_to(master, simulator, 389)
    found = counters(master, 100)
    return [found, wait_state(master.slaves[1], SAFEOP | ERROR)]


# --- links, power, identity ------------------------------------------------------------------


def master_broken_link():
    master = open_pysoem()
    to_op(master)
    wire = Wire()
    with Simulator() as simulator:
        found = [[wire.reached(), *counters(master, 1)]]
        simulator.faults.break_link(2)
        found.append([wire.reached(), *counters(master, 1)])
        links = [list(slave.links) for slave in simulator.status().slaves]
        simulator.faults.heal_link(2)
        found.append([wire.reached(), *counters(master, 1)])
        state = wait_state(master.slaves[3], OP)
        now = simulator.status().cycles
        simulator.faults.break_link(1, at_cycle=now + 10)
        scheduled = [*counters(master, 9), *counters_until(master, 3), *counters(master, 100)]
        simulator.faults.heal_link(1, at_cycle=simulator.status().cycles + 10)
        after = counters_until(master, 12)
    return [found, links, state, scheduled, after]


def test_slaves_behind_a_broken_link_vanish_and_come_back_as_they_were():
    found, links, state, scheduled, after = run("line:4", master_broken_link)
    assert found == [[4, 12], [2, 6], [4, 12]]
    assert links == [[0, 1], [0], [1], [0]]
    assert state == [OP, 0], "they kept their power"
    assert set(scheduled) == {12, 3}
    assert scheduled[:9] == [12] * 9, "not before its cycle"
    assert scheduled.index(3) == len([c for c in scheduled if c == 12]), "then for good"
    assert after[:9] == [3] * 9, "not before its cycle"
    assert after[-1] == 12


def master_power_cycle():
    master = open_pysoem()
    to_op(master)
    wire = Wire()
    before = [wire.word(1, 0x0130), wire.word(1, 0x0010)]
    with Simulator() as simulator:
        simulator.faults.power_off(1)
        reached = wire.reached()
        status = simulator.status().slaves[1]
        simulator.faults.power_on(1)
        after = [wire.word(1, 0x0130), wire.word(1, 0x0010)]
        others = [wire.word(0, 0x0130), wire.word(2, 0x0130)]
    counter = counters(master, 1)
    again = open_pysoem()
    to_op(again)
    return [
        before,
        reached,
        [status.state, status.power, status.faults],
        after,
        others,
        counter,
        counters(again, 1),
    ]


def test_power_cycle():
    before, reached, status, after, others, counter, again = run("line:3", master_power_cycle)
    assert before == [OP, 0x1002]
    assert reached == 1, "what is behind it is lost, too"
    assert status == ["-", False, ["no power"]]
    assert after == [INIT, 0]
    assert others == [OP, OP]
    assert counter == [6]
    assert again == [9]


def master_swap():
    def scan():
        master = new_master()
        master.open(INTERFACE)
        count = master.config_init()
        found = [[slave.name, slave.man, slave.id] for slave in master.slaves]
        master.close()
        return [count, found[2]]

    with Simulator() as simulator:
        found = [scan()]
        simulator.faults.swap(2, "EL2008")
        found.append(scan())
        names = simulator.status().slaves[2].name
        simulator.faults.swap(2, "original")
        found.append(scan())
    return [found, names]


def test_swapped_slave_has_another_identity():
    found, name = run("troll", master_swap)
    inputs, outputs = ["EL1018", 2, 0x03FA3052], ["EL2008", 2, 0x07D83052]
    assert found == [[8, inputs], [8, outputs], [8, inputs]]
    assert name == "EL2008"


# --- state, mailbox, EEPROM, clock ---------------------------------------------------------------


def master_al_error():
    master = open_pysoem()
    to_op(master)
    with Simulator() as simulator:
        now = simulator.status().cycles
        simulator.faults.al_error(1, 0x001D, at_cycle=now + 20)
        before = counters(master, 19)
        while not simulator.faults.list()[0].done:
            counters(master, 1)
        state = wait_state(master.slaves[1], SAFEOP | ERROR)
        return [before, state, counters(master, 1)]


def test_al_error():
    before, state, counter = run("line:2", master_al_error)
    assert before == [6] * 19
    assert state == [SAFEOP | ERROR, 0x001D]
    assert counter == [6], "the working counter does not show it: its sync managers stay active"


def master_emergency():
    import pysoem

    master = open_pysoem()
    received = []
    master.slaves[0].add_emergency_callback(
        lambda message: received.append(
            [message.error_code, message.error_reg, message.b1, message.w1, message.w2]
        )
    )
    with Simulator() as simulator:
        simulator.faults.emergency(0, 0x8130, 0x10, b"\x01\x02\x03\x04\x05")
        register = simulator.get(0, 0x1001)
    for _ in range(3):
        try:
            master.slaves[0].sdo_read(0x1018, 1)
        except pysoem.MailboxError:
            continue
    return [received, register]


def test_emergency():
    received, register = run("troll", master_emergency)
    assert received == [[0x8130, 0x10, 0x01, 0x0302, 0x0504]]
    assert register == 0x10


def master_mailbox():
    import pysoem

    master = open_pysoem()
    drive = master.slaves[0]
    found = []

    def read(subindex=1):
        try:
            found.append(drive.sdo_read(0x1018, subindex, 4).hex())
        except (pysoem.SdoError, pysoem.MailboxError, pysoem.WkcError, pysoem.PacketError) as error:
            found.append(type(error).__name__)

    with Simulator() as simulator:
        read()
        for mode in ("stuck", "full", "none"):
            simulator.faults.mailbox(0, mode)
            read()
        # Answers to earlier questions may still come, and SOEM takes them. Before it asks, it
        # throws away the one that is there. When what comes was asked for, none is left.
        for _ in range(10):
            time.sleep(0.1)
            read(2)
            read()
            if found[-2:] == ["24090300", "9a000000"]:
                break
        simulator.faults.mailbox(0, "slow", delay_s=0.2)
        begin = time.monotonic()
        read()
        slow = time.monotonic() - begin
    return [found, slow]


def test_mailbox():
    found, slow = run("troll", master_mailbox)
    right = "9a000000"
    assert found[0] == right
    assert right not in found[1:3]
    assert found[-3:] == ["24090300", right, right], found
    assert slow >= 0.1  # without the fault a millisecond


def master_eeprom():
    def scan():
        master = new_master()
        master.open(INTERFACE)
        master.config_init()
        slave = master.slaves[2]
        found = [slave.man, slave.id, slave.name]
        master.close()
        return found

    with Simulator() as simulator:
        found = []
        for content in ("ones", "restore"):
            simulator.faults.eeprom(2, content)
            found.append(scan())
    return found


def test_eeprom_of_ones():
    ones, restored = run("troll", master_eeprom)
    assert ones[:2] == [0xFFFFFFFF, 0xFFFFFFFF]
    assert restored == [2, 0x03FA3052, "EL1018"]


def master_clock():
    master = open_pysoem()
    assert master.config_dc()
    to_op(master)
    wire = Wire()

    def difference():
        """System time difference of slave 1: bit 31 is its sign, the rest its size."""
        counters(master, 1)
        wire.ask(FRMW, 0x1001, 0x0910, 8)
        raw = struct.unpack("<I", wire.ask(APRD, -1, 0x092C, 4)[0])[0]
        return raw & 0x7FFFFFFF

    with Simulator() as simulator:
        before = difference()
        simulator.faults.clock(1, step_ns=50_000_000)
        return [before, difference()]


def test_clock_step():
    before, after = run("line:2", master_clock)
    assert before < 5_000_000
    assert after > 5_000_000 + before


# --- the documentation -----------------------------------------------------------------------

CONTROLLER = """
import sys, time
import masters as t
master = t.open_pysoem()
t.to_op(master)
wrong = 0
while wrong < 50:  # on a busy machine single frames come too late
    wrong = 0 if t.cycle(master) == master.expected_wkc else wrong + 1
sys.exit(3)
"""


def test_the_script_of_the_documentation(tmp_path):
    (script,) = re.findall(r"^```sh\n(ecatsim run .*?break-link.*?)^```", text(), re.M | re.S)
    for name, code in (("ecatsim", "-m ecatsim"), ("controller", f"-c '{CONTROLLER}'")):
        file = tmp_path / name
        file.write_text(f'#!/bin/sh\nexec "{sys.executable}" {code} "$@"\n')
        file.chmod(0o755)
    path = f"{tmp_path}:{os.environ['PATH']}"
    libraries = f"{HERE.parent}:{os.environ.get('PYTHONPATH', '')}"
    result = subprocess.run(
        ["sh", "-c", script],
        cwd=tmp_path,
        env=os.environ | {"PATH": path, "PYTHONPATH": libraries},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert (
        int(re.search(r"cycles (\d+)", result.stdout)[1]) >= 100
    )  # on a busy machine most get lost
    rows = [line.split() for line in result.stdout.splitlines() if "Loopback" in line]
    assert [row[-3:-1] for row in rows] == [["0", "1"], ["-", "0"], ["-", "1"], ["-", "0"]]


def test_the_python_of_the_documentation():
    (code,) = re.findall(r"^```python\n(from ecatsim.control .*?)^```", text(), re.M | re.S)
    inner = [*ECATSIM, "run", "line:4", "--", sys.executable, "-c", code]
    result = subprocess.run(inner, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert "break-link" in result.stdout or "BreakLink" in result.stdout


def text():
    return DOCUMENT.read_text()

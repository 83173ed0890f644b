"""Real masters on the simulated segment: pysoem (SOEM) and kickcat, and tshark as a listener.

Masters run as commands inside `ecatsim run`. Functions named `master_…` are such commands: they
return what is to be judged, as JSON. This file is a rig file as well; its devices are below.
"""

import inspect
import json
import multiprocessing
import shutil
import socket
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from ecatd.model.al import AlState
from ecatd.model.bus import Entry, Pdo
from ecatd.model.datatypes import DataType
from ecatsim.rig import Rig
from ecatsim.slave.device import Device
from ecatsim.slave.objects import Access
from ecatsim.slave.sii import Mailbox
from ecatsim.slave.state_machine import RefusedError

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

INTERFACE = "ecat-master"
HERE = Path(__file__)
INIT, PREOP, SAFEOP, OP, ERROR, ACK = 1, 2, 4, 8, 0x10, 0x10
LONG = bytes(range(250)) * 3


class Sample(Device):
    """Three words out, three words in, variable PDO assignment, complete access, long objects."""

    vendor, product, revision, order = 0x0000FFFF, 0x1, 1, "Sample"
    mailbox = Mailbox(coe_details=0x2F)
    variable_assignment = True
    rx_pdos = tuple(
        Pdo(0x1600 + i, f"Out {i}", 2 if i < 2 else 0xFF, [Entry(0x7000, i + 1, "", 6, 16)])
        for i in range(3)
    )
    tx_pdos = tuple(
        Pdo(0x1A00 + i, f"In {i}", 3 if i < 2 else 0xFF, [Entry(0x6000, i + 1, "", 6, 16)])
        for i in range(3)
    )

    def describe(self):
        self.dictionary.variable(
            0x2000, "Long", DataType.OCTET_STRING, LONG, Access.RW, bits=8 * 1000
        )

    def step(self, now):
        for i in (1, 2, 3):
            self[0x6000, i] = self[0x7000, i] ^ 0xFFFF


class Stubborn(Sample):
    """Refuses OP."""

    order = "Stubborn"

    def check(self, old, new):
        if new == AlState.OP:
            raise RefusedError(0x8123)


def rig():
    return Rig("samples", [Sample(), Stubborn()])


def run(rig_name, master, *arguments):
    """Runs a master of a test file beside a rig and returns what it found."""
    file = Path(inspect.getfile(master))
    code = (
        f"import sys, json; sys.path.insert(0, {str(file.parent)!r}); import {file.stem} as t; "
        f"print('found', json.dumps(t.{master.__name__}(*{arguments!r})))"
    )
    result = subprocess.run(
        [sys.executable, "-m", "ecatsim", "run", str(rig_name), "--", sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert result.returncode == 0, result.stderr + result.stdout
    # Masters print lines of their own, before and after.
    (found,) = [line for line in result.stdout.splitlines() if line.startswith("found ")]
    return json.loads(found.removeprefix("found "))


def open_pysoem(configure=None, *, watchdog=False):
    """A bus in SAFEOP; without watchdogs, which a busy machine could let expire."""
    import pysoem

    master = pysoem.Master()
    master.open(INTERFACE)
    assert master.config_init() > 0
    for slave in () if watchdog else master.slaves:
        slave._fpwr(0x0420, b"\x00\x00")
    if configure:
        configure(master)
    master.config_map()
    assert master.state_check(SAFEOP, 2_000_000) == SAFEOP
    return master


def cycle(master, count=1):
    """Exchanges process data; the last working counter."""
    for _ in range(count):
        master.send_processdata()
        counter = master.receive_processdata(10_000)
        time.sleep(0.001)
    return counter


def to_op(master):
    """Brings all slaves to OP, as a master does: with process data under way."""
    cycle(master)
    master.state = OP
    master.write_state()
    for _ in range(2000):
        cycle(master)
        if master.read_state() == OP:
            return
    raise AssertionError([hex(slave.state) for slave in master.slaves])


def wait_state(slave, *states):
    """Waits until a slave is in one of the states; the state and the AL status code."""
    for _ in range(3000):
        status = struct.unpack("<HxxH", slave._fprd(0x0130, 6))
        if status[0] in states:
            return list(status)
        time.sleep(0.001)
    raise AssertionError(f"state is {status}")


def request(slave, state, *expected):
    slave._fpwr(0x0120, struct.pack("<H", state))
    return wait_state(slave, *(expected or (state,)))


# --- pysoem ----------------------------------------------------------------------------------


def master_scan():
    master = open_pysoem()
    before = cycle(master)
    to_op(master)
    return {
        "slaves": [
            [s.name, s.man, s.id, s.rev, len(s.output), len(s.input)] for s in master.slaves
        ],
        "counters": [before, cycle(master), master.expected_wkc],
    }


def test_pysoem_brings_troll_to_op():
    found = run("troll", master_scan)
    assert found["slaves"] == [
        ["Gold EtherCAT GCON Drive", 0x9A, 0x00030924, 0x00010420, 16, 16],
        ["EK1100", 2, 0x044C2C52, 0x00120000, 0, 0],
        ["EL1018", 2, 0x03FA3052, 0x00110000, 0, 1],
        ["EL2008", 2, 0x07D83052, 0x00100000, 1, 0],
        ["EL3008", 2, 0x0BC03052, 0x00140000, 0, 32],
        ["EL3008", 2, 0x0BC03052, 0x00140000, 0, 32],
        ["EL6751", 2, 0x1A5F3052, 0x00140000, 0, 0],
        ["EL6751", 2, 0x1A5F3052, 0x00140000, 0, 0],
    ]
    assert found["counters"] == [8, 8, 8]


@pytest.mark.parametrize("count", [1, 8, 64])
def test_pysoem_brings_lines_to_op(count):
    found = run(f"line:{count}", master_scan)
    assert len(found["slaves"]) == count
    assert found["counters"] == [3 * count] * 3


def master_empty():
    import pysoem

    master = pysoem.Master()
    master.open(INTERFACE)
    return master.config_init()


def test_nothing_answers_on_an_empty_segment():
    assert run("empty", master_empty) <= 0


def master_exchange():
    master = open_pysoem()
    to_op(master)
    drive, inputs, outputs, constants = (master.slaves[i] for i in (0, 2, 3, 5))
    wires = []
    for value in (0b0101, 0b1010, 0b0000):
        outputs.output = bytes([value])
        cycle(master, 20)
        wires.append(inputs.input[0] & 0x0F)
    words = []
    drive.sdo_write(0x6060, 0, b"\x09")  # the process data carry 0: no change
    for word in (0x06, 0x07, 0x0F, 0x0F):
        drive.output = struct.pack("<iihHHbx", 0, 200_000, 0, 0, word, 0)
        cycle(master, 20)
        words.append(struct.unpack_from("<H", drive.input, 6)[0])
    cycle(master, 300)
    speed, mode = struct.unpack_from("<i", drive.input, 10)[0], drive.input[8]
    return {
        "wires": wires,
        "words": words,
        "speed": speed,
        "mode": mode,
        "volts": [
            struct.unpack_from("<h", constants.input, 4 * i + 2)[0] / 3276.7 for i in range(8)
        ],
        "counter": cycle(master),
    }


def test_outputs_come_back_and_the_motor_turns():
    found = run("troll", master_exchange)
    assert found["wires"] == [0b0101, 0b1010, 0b0000]
    assert found["words"] == [0x0231, 0x0233, 0x1237, 0x1237]
    assert found["mode"] == 9
    assert found["speed"] == pytest.approx(200_000, rel=0.05)
    assert found["volts"] == pytest.approx([-8, -4, -1, 0, 1, 4, 8, 10], abs=0.001)
    assert found["counter"] == 8


def master_sdo():
    import pysoem

    master = open_pysoem()
    sample = master.slaves[0]
    result = {"long": sample.sdo_read(0x2000, 0, 1000).hex(), "codes": []}
    sizes = [1, 4, 5, 100, 112, 113, 118, 119, 120, 500, 1000]
    result["same"] = []
    for size in sizes:
        data = bytes(i * 7 & 0xFF for i in range(size))
        sample.sdo_write(0x2000, 0, data)
        result["same"].append(sample.sdo_read(0x2000, 0, 2000) == data)
    result["complete"] = sample.sdo_read(0x1C12, 0, 100, True).hex()
    result["identity"] = sample.sdo_read(0x1018, 2, 4).hex()
    for index, subindex, data in (
        (0x5555, 0, None),
        (0x1018, 99, None),
        (0x1018, 2, bytes(4)),
        (0x2000, 0, bytes(1001)),
        (0x7000, 1, bytes(1)),
        (0x1C12, 0, b"\x00"),
    ):
        try:
            if data is None:
                sample.sdo_read(index, subindex, 100)
            else:
                sample.sdo_write(index, subindex, data)
        except pysoem.SdoError as error:
            result["codes"].append(error.abort_code)
    result["objects"] = [[o.index, o.name.decode(), len(o.entries)] for o in sample.od]
    entry = next(o for o in sample.od if o.index == 0x6000).entries[2]
    result["entry"] = [entry.data_type, entry.bit_length, entry.obj_access]
    return result


def test_sdo_transfers_and_information():
    found = run(HERE, master_sdo)
    assert bytes.fromhex(found["long"]) == LONG
    assert all(found["same"])
    assert found["complete"] == "0200" + "0016" + "0116" + "0000"
    assert found["identity"] == "01000000"
    assert found["codes"] == [
        0x06020000,
        0x06090011,
        0x06010002,
        0x06070012,
        0x06070013,
        0x08000022,
    ]
    assert [0x2000, "Long", 0] in found["objects"]
    assert [0x1018, "Identity", 5] in found["objects"]
    assert found["entry"] == [6, 16, 0x87]


def master_assignment():
    def configure(master):
        for slave in master.slaves:
            for index, pdos in ((0x1C12, [0x1602]), (0x1C13, [0x1A02, 0x1A00, 0x1A01])):
                slave.sdo_write(index, 0, b"\x00")
                for number, pdo in enumerate(pdos, 1):
                    slave.sdo_write(index, number, struct.pack("<H", pdo))
                slave.sdo_write(index, 0, bytes([len(pdos)]))

    master = open_pysoem(configure)
    sample = master.slaves[0]
    master.slaves[1]._fpwr(0x0120, b"\x02\x00")  # the other one refuses OP
    cycle(master)
    request(sample, OP, SAFEOP)
    for _ in range(100):
        sample.output = b"\x34\x12"
        cycle(master)
    return [len(sample.output), sample.input.hex(), wait_state(sample, OP)]


def test_pdo_assignment_changes_the_process_data():
    assert run(HERE, master_assignment) == [2, "cbed" + "ffff" + "ffff", [OP, 0]]


def master_watchdog():
    master = open_pysoem(watchdog=True)
    to_op(master)
    drive, inputs, outputs = (master.slaves[i] for i in (0, 2, 3))
    outputs.output = b"\x0f"
    cycle(master, 20)
    on = inputs.input[0] & 0x0F
    states = [wait_state(slave, SAFEOP | ERROR) for slave in (drive, outputs)]
    states.append(wait_state(inputs, OP))
    watchdog = outputs._fprd(0x0440, 3).hex()
    outputs._fpwr(0x0420, b"\x00\x00")
    # Inputs still come; outputs are off, whatever the master writes.
    cycle(master, 20)
    off = inputs.input[0] & 0x0F
    outputs._fpwr(0x0120, bytes([OP, 0]))
    states.append(wait_state(outputs, SAFEOP | ERROR))
    request(outputs, SAFEOP | ACK, SAFEOP)
    states.append(request(outputs, OP))
    cycle(master, 20)
    return [on, off, inputs.input[0] & 0x0F, states, watchdog]


def test_watchdog():
    on, off, again, states, watchdog = run("troll", master_watchdog)
    assert (on, off, again) == (0x0F, 0, 0x0F)
    fallen = [SAFEOP | ERROR, 0x001B]
    assert states == [fallen, fallen, [OP, 0], fallen, [OP, 0]]
    assert watchdog == "000001"


def master_wrong_settings():
    import pysoem

    master = pysoem.Master()
    master.manual_state_change = 1
    master.open(INTERFACE)
    master.config_init()
    sample = master.slaves[0]
    found = {}

    def set_length(channel, length):
        register = 0x0800 + 8 * channel
        kept = sample._fprd(register, 8)
        sample._fpwr(register + 6, b"\x00")
        sample._fpwr(register, struct.pack("<HH", *struct.unpack_from("<H", kept), length))
        sample._fpwr(register + 4, kept[4:5])
        sample._fpwr(register + 6, b"\x01")

    set_length(1, 100)
    found["mailbox"] = request(sample, PREOP, INIT | ERROR)
    set_length(1, 128)
    found["preop"] = request(sample, PREOP | ACK, PREOP)
    found["jump"] = request(sample, OP, PREOP | ERROR)
    request(sample, PREOP | ACK, PREOP)
    master.config_map()
    for name, channel, right in (("outputs", 2, 4), ("inputs", 3, 4)):
        set_length(channel, right + 1)
        found[name] = request(sample, SAFEOP, PREOP | ERROR)
        set_length(channel, right)
        request(sample, PREOP | ACK, PREOP)
    found["unknown"] = request(sample, 5, PREOP | ERROR)
    request(sample, PREOP | ACK, PREOP)
    found["safeop"] = request(sample, SAFEOP)
    found["no outputs"] = request(sample, OP, SAFEOP | ERROR)
    found["boot"] = request(sample, INIT | ACK, INIT) and request(sample, 3, INIT | ERROR)
    return found


def test_al_status_codes():
    assert run(HERE, master_wrong_settings) == {
        "mailbox": [INIT | ERROR, 0x16],
        "preop": [PREOP, 0],
        "jump": [PREOP | ERROR, 0x11],
        "outputs": [PREOP | ERROR, 0x1D],
        "inputs": [PREOP | ERROR, 0x1E],
        "unknown": [PREOP | ERROR, 0x12],
        "safeop": [SAFEOP, 0],
        "no outputs": [SAFEOP | ERROR, 0x19],
        "boot": [INIT | ERROR, 0x13],
    }


def master_refused():
    master = open_pysoem()
    cycle(master)
    return request(master.slaves[1], OP, SAFEOP | ERROR)


def test_device_refuses_op():
    assert run(HERE, master_refused) == [SAFEOP | ERROR, 0x8123]


def master_lost_slave_process_data():
    master = open_pysoem()
    to_op(master)
    request(master.slaves[0], PREOP)
    return [cycle(master), master.expected_wkc]


def test_working_counter_falls_with_a_slave():
    """The drive in PREOP neither takes outputs nor gives inputs."""
    assert run("troll", master_lost_slave_process_data) == [5, 8]


def master_mailbox_during_exchange():
    master = open_pysoem()
    to_op(master)
    drive, wrong = master.slaves[0], 0
    stop = threading.Event()

    def exchange():
        nonlocal wrong
        while not stop.is_set():
            wrong += cycle(master) != 8

    thread = threading.Thread(target=exchange)
    thread.start()
    values = {drive.sdo_read(0x1018, 1, 4).hex() for _ in range(200)}
    stop.set()
    thread.join()
    return [sorted(values), wait_state(drive, OP)]


def test_sdo_beside_process_data():
    values, state = run("troll", master_mailbox_during_exchange)
    assert values == ["9a000000"]
    assert state == [OP, 0]


# --- kickcat ---------------------------------------------------------------------------------


def master_kickcat():
    import kickcat

    link = kickcat.create_link(INTERFACE, "")
    link.set_timeout(0.008)  # seconds; for a busy machine
    bus = kickcat.Bus(link)
    bus.init(0.1)
    # No watchdogs, for the same reason: a broadcast write of 0 to register 0x0420.
    datagram = struct.pack("<BBHHHH", 8, 0, 0, 0x0420, 2, 0) + bytes(4)
    with socket.socket(socket.AF_PACKET, socket.SOCK_RAW) as wire:
        wire.bind((INTERFACE, 0x88A4))
        header = b"\xff" * 6 + bytes(6) + b"\x88\xa4" + struct.pack("<H", 0x1000 | len(datagram))
        wire.send((header + datagram).ljust(60, b"\0"))
    bus.create_mapping()
    bus.request_state(kickcat.State.SAFE_OP)
    bus.wait_for_state(kickcat.State.SAFE_OP, 5.0)
    slaves = list(bus.slaves())
    for slave in slaves:
        slave.set_output_bytes(bytes(slave.output_size))
    bus.request_state(kickcat.State.OPERATIONAL)
    bus.wait_for_state(kickcat.State.OPERATIONAL, 5.0, bus.process_data)
    for slave in slaves:
        slave.set_output_bytes(bytes([0x05] * slave.output_size))
    for _ in range(50):
        bus.process_data()
        time.sleep(0.001)
    return [[s.output_size, bytes(s.input_data)[: s.input_size].hex()] for s in slaves]


def test_kickcat_brings_troll_to_op():
    found = run("troll", master_kickcat)
    assert [size for size, _ in found] == [16, 0, 0, 1, 0, 0, 0, 0]
    assert [len(data) // 2 for _, data in found] == [16, 0, 1, 0, 32, 32, 0, 0]
    assert found[2][1][1] == "5", "wired to the outputs"


def test_kickcat_brings_a_line_to_op():
    assert run("line:8", master_kickcat) == [[32, "05" * 32]] * 8


# --- tshark ----------------------------------------------------------------------------------


def record(file, ready, stop):
    """Writes every frame to a pcap file until `stop` is set."""
    wire = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(0x0003))
    wire.bind((INTERFACE, 0x0003))
    wire.settimeout(0.2)
    ready.set()
    with Path(file).open("wb") as output:
        output.write(struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1))
        while True:
            try:
                frame = wire.recv(2048)
            except TimeoutError:
                if stop.is_set():
                    return
                continue
            seconds, rest = divmod(time.time_ns(), 10**9)
            output.write(struct.pack("<IIII", seconds, rest // 1000, len(frame), len(frame)))
            output.write(frame)


def master_recorded(file):
    """A start-up that another process records."""
    context = multiprocessing.get_context("fork")
    ready, stop = context.Event(), context.Event()
    recorder = context.Process(target=record, args=(file, ready, stop))
    recorder.start()
    ready.wait()
    master = open_pysoem()
    to_op(master)
    master.slaves[0].sdo_read(0x1008, 0, 100)
    cycle(master, 50)
    stop.set()
    recorder.join()


@pytest.mark.skipif(not shutil.which("tshark"), reason="tshark is not installed")
def test_tshark_finds_no_malformed_frame(tmp_path):
    file = tmp_path / "start-up.pcap"
    run("troll", master_recorded, str(file))

    def tshark(*arguments):
        result = subprocess.run(
            ["tshark", "-r", file, *arguments], capture_output=True, text=True, check=True
        )
        return result.stdout.splitlines()

    assert tshark("-Y", "_ws.malformed || _ws.short") == []
    assert len(tshark("-Y", "ecatf")) == len(tshark()) > 1000, "nothing but EtherCAT is on the wire"
    assert len(tshark("-Y", "ecat_mailbox.coe.sdoreq")) > 50, "the mailboxes are understood"

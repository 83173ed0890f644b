"""Real masters on the simulated segment: pysoem (SOEM). This file is a rig file as well."""

import struct
import threading
import time
from pathlib import Path

import pytest
from masters import (
    ACK,
    ERROR,
    INIT,
    INTERFACE,
    LOST,
    OP,
    PREOP,
    SAFEOP,
    cycle,
    new_master,
    open_pysoem,
    pattern,
    request,
    run,
    to_op,
    wait_state,
)

from ecatd.etg.al import AlState
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatsim.control import Simulator
from ecatsim.rig import Rig
from ecatsim.slave.device import Device
from ecatsim.slave.objects import Access
from ecatsim.slave.sii import Mailbox
from ecatsim.slave.state_machine import RefusedError

pytestmark = [pytest.mark.bus, pytest.mark.long]

HERE = Path(__file__)
LONG = bytes(range(250)) * 3
LONG_LINE = HERE.parents[1] / "rigs" / "long_line.py"
LAYOUTS = HERE.parents[1] / "rigs" / "layouts.py"


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


def master_frugal():
    """One exchange in SAFEOP, the request for OP, and nothing that would bring outputs again.

    So `simple_ng` of SOEM begins; watchdogs are off, as its next exchange comes late.
    """
    master = open_pysoem()
    counter = cycle(master)
    master.state = OP
    master.write_state()
    for _ in range(1000):
        if master.read_state() == OP:
            break
        time.sleep(0.001)
    return counter, [slave.state for slave in master.slaves]


def test_outputs_of_one_exchange_in_safeop_are_enough_for_op():
    assert run("troll", master_frugal) == [8, [OP] * 8]


def master_that_packs():
    """The four bits of each of two sync managers lie in one byte of the image."""
    master = new_master()
    master.open(INTERFACE)
    master.config_init()
    master.config_map()
    (slave,) = master.slaves
    for number, (first, start) in enumerate(((0, 0x1000), (4, 0x1200))):
        fmmu = struct.pack("<IHBBHBBB3x", 0, 1, first, first + 3, start, 0, 2, 1)
        slave._fpwr(0x0600 + 16 * number, fmmu)
    with Simulator() as simulator:
        return cycle(master), simulator.status().slaves[0].faults


def test_bits_that_lie_side_by_side_are_refused(tmp_path):
    rig = tmp_path / "nibbles.toml"
    rig.write_text(f'[[slave]]\ndevice = "{LAYOUTS}:Nibbles"\n')
    counter, faults = run(rig, master_that_packs)
    assert counter == 0
    (fault,) = faults
    assert {"FMMUs", "bits"} <= {*fault.split()}


def master_line():
    """Different outputs for each slave and each round; what comes back, and all counters."""
    master = open_pysoem()
    counters = {cycle(master)}
    to_op(master)
    wrong = []
    for number in range(8):
        for i, slave in enumerate(master.slaves):
            slave.output = pattern(i, number, len(slave.output))
        for _ in range(500):
            counters.add(cycle(master))
            if all(slave.input == slave.output for slave in master.slaves):
                break
        wrong += [i for i, slave in enumerate(master.slaves) if slave.input != slave.output]
    return {
        "sizes": sorted({(len(slave.output), len(slave.input)) for slave in master.slaves}),
        "wrong": wrong,
        "counters": sorted(counters - {LOST}),
    }


@pytest.mark.parametrize(
    ("rig_name", "count", "size"),
    [("line:1", 1, 32), ("line:8", 8, 32), ("line:64", 64, 32), (LONG_LINE, 199, 8)],
    ids=["1", "8", "64", "199"],
)
def test_pysoem_exchanges_with_lines(rig_name, count, size):
    """199 slaves are all that SOEM knows."""
    found = run(rig_name, master_line)
    assert found == {"sizes": [[size, size]], "wrong": [], "counters": [3 * count]}


def master_empty():

    master = new_master()
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
    request(sample, OP, SAFEOP, OP)
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

    master = new_master()
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

"""What a slave does above its controller, judged by pysoem (SOEM) and kickcat.

Masters run as commands inside `ecatsim run`; this file is the rig file as well.
"""

import struct
import time
from pathlib import Path

import pytest
from masters import PATIENCE, new_master, run
from test_simulator_masters import (
    ERROR,
    INIT,
    INTERFACE,
    OP,
    PREOP,
    SAFEOP,
    cycle,
    open_pysoem,
    request,
    to_op,
    wait_state,
)

from ecatsim import (
    Access,
    DataType,
    DcMode,
    Device,
    Entry,
    FoeCode,
    FoeError,
    Mailbox,
    MailboxFault,
    Pdo,
    Rig,
    Variable,
)

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

HERE = Path(__file__)
BOOT = 3
MAIL, BOOT_MAIL = 192, 256
LONG = bytes(i * 11 & 0xFF for i in range(100_000))


class Sample(Device):
    """Everything variable; object 0x2F00 is the handle by which the test disturbs the device."""

    vendor, product, revision, order = 0x0000FFFF, 0x7, 1, "Sample"
    mailbox = Mailbox(0x1000, MAIL, 0x1100, MAIL, protocols=0x0C, coe_details=0x2F)
    bootstrap = Mailbox(0x1000, BOOT_MAIL, 0x1200, BOOT_MAIL, protocols=0x08)
    variable_assignment = variable_mapping = True
    device_id = 0x0042
    dc_modes = (DcMode("Synchron", 0), DcMode("DC", 0x0300))
    minimum_cycle_ns = 250_000
    firmware_files = ("firmware.efw",)
    rx_pdos = (Pdo(0x1600, "Out", 2, [Entry(0x7000, 1, "Word", DataType.UNSIGNED16, 16)]),)
    tx_pdos = (Pdo(0x1A00, "In", 3, [Entry(0x6000, 1, "Word", DataType.UNSIGNED16, 16)]),)

    def describe(self):
        self.files["log.txt"] = b"a line of text"
        add = self.dictionary.variable
        add(0x7010, "Real", DataType.REAL32, 0.0, Access.RW | Access.RX_PDO)
        add(0x6010, "Twice the real", DataType.REAL32, 0.0, Access.RO | Access.TX_PDO)
        triggers = (
            Variable(0x2F00, 1, "Emergency", DataType.UNSIGNED16, access=Access.RW),
            Variable(0x2F00, 2, "Slow answers in ms", DataType.UNSIGNED16, access=Access.RW),
        )
        triggers[0].on_write = lambda value: self.emergency(value, int(value != 0), b"\1\2\3\4\5")
        triggers[1].on_write = self._slow_down
        self.dictionary.record(0x2F00, "Triggers", triggers)

    def _slow_down(self, milliseconds):
        self.mailbox_fault = MailboxFault("slow", milliseconds / 1000)

    def on_file(self, name, data, password):
        if data.startswith(b"bad"):
            raise FoeError(FoeCode.PROGRAM_ERROR, "bad data")
        super().on_file(name, data, password)

    def step(self, now):
        self[0x6000, 1] = self[0x7000, 1] ^ 0xFFFF
        entries = self.dictionary
        entries[0x6010, 0].value = 2 * entries[0x7010, 0].value


def rig():
    return Rig("sample", [Sample()])


def open_preop(manual=False):
    """The master and its slave, in PREOP or, if states are left to the test, in INIT."""

    master = new_master()
    master.manual_state_change = int(manual)
    master.open(INTERFACE)
    assert master.config_init() == 1
    slave = master.slaves[0]
    if not manual:
        wait_state(slave, PREOP)
    return master, slave


# --- PDO mapping ---------------------------------------------------------------------------------


def master_mapping(complete):
    def configure(master):
        slave = master.slaves[0]
        for index, values in (
            (0x1600, (0x70100020, 0x00000008, 0x70000110)),
            (0x1A00, (0x60000110, 0x60100020)),
        ):
            if complete:
                data = struct.pack(f"<H{len(values)}I", len(values), *values)
                slave.sdo_write(index, 0, data, True)
                continue
            slave.sdo_write(index, 0, b"\0")
            for number, value in enumerate(values, 1):
                slave.sdo_write(index, number, struct.pack("<I", value))
            slave.sdo_write(index, 0, bytes([len(values)]))

    master = open_pysoem(configure)
    to_op(master)
    slave = master.slaves[0]
    for _ in range(50):
        slave.output = struct.pack("<fxH", 1.25, 0x1234)
        cycle(master)
    return [len(slave.output), *struct.unpack("<Hf", slave.input)]


@pytest.mark.parametrize("complete", [False, True])
def test_pdo_mapping_changes_the_process_data(complete):
    assert run(HERE, master_mapping, complete) == [7, 0xFFFF ^ 0x1234, 2.5]


# --- SDO information -----------------------------------------------------------------------------


def master_information():
    _, slave = open_preop()
    found = {item.index: item for item in slave.od}
    mapping, triggers = found[0x1600], found[0x2F00]
    return {
        "mapping": [mapping.object_code, mapping.data_type, len(mapping.entries)],
        "triggers": [[e.name.decode(), e.data_type, e.obj_access] for e in triggers.entries],
        "real": [found[0x7010].bit_length, found[0x7010].obj_access],
    }


def test_sdo_information():
    found = run(HERE, master_information)
    assert found["mapping"] == [9, 0x21, 33]
    assert found["triggers"][1:] == [["Emergency", 6, 0x3F], ["Slow answers in ms", 6, 0x3F]]
    assert found["real"] == [32, 0x7F]


# --- emergencies ---------------------------------------------------------------------------------


def master_emergency():
    _, slave = open_preop()
    seen = []
    slave.add_emergency_callback(
        lambda e: seen.append([e.slave_pos, e.error_code, e.error_reg, e.b1, e.w1, e.w2])
    )
    registers = []
    for code in (0x8130, 0):
        slave.sdo_write(0x2F00, 1, struct.pack("<H", code))
        for _ in range(100):
            slave.mbx_receive()
            if len(seen) > len(registers):
                break
            time.sleep(0.01)
        registers.append(slave.sdo_read(0x1001, 0, 1)[0])
    return [seen, registers]


def test_pysoem_receives_emergencies():
    seen, registers = run(HERE, master_emergency)
    assert [[code, *rest] for _, code, *rest in seen] == [
        [0x8130, 1, 1, 0x0302, 0x0504],
        [0, 0, 1, 0x0302, 0x0504],
    ]
    assert registers == [1, 0]


# --- FoE -----------------------------------------------------------------------------------------


def master_files(sizes):
    _, slave = open_preop()
    same = []
    for size in sizes:
        slave.foe_write("data.bin", 0, LONG[:size])
        same.append(slave.foe_read("data.bin", 0, size + 1000, 1_000_000) == LONG[:size])
    # pysoem has no exceptions for files: a write returns what SOEM does, a read nothing.
    results = [
        slave.foe_write(name, 0, data) > 0
        for name, data in (("good", b"good"), ("worse", b"bad"), ("firmware.efw", b"x"))
    ]
    texts = [slave.foe_read(name, 0, 100).decode() for name in ("log.txt", "good", "worse", "gone")]
    return [same, results, texts, slave.sdo_read(0x1000, 0).hex()]


def test_pysoem_reads_and_writes_files():
    room = MAIL - 12
    sizes = [0, 1, room - 1, room, room + 1, 2 * room, 5 * room, 100_000]
    same, results, texts, device_type = run(HERE, master_files, sizes)
    assert same == [True] * len(sizes)
    assert results == [True, False, False]
    assert texts == ["a line of text", "good", "", ""]
    assert device_type == "89130000", "CoE still works"


def master_boot():
    master, slave = open_preop(manual=True)
    states = []
    words = [int.from_bytes(slave.eeprom_read(a), "little") for a in (0x14, 0x16)]
    boxes = [(word & 0xFFFF, word >> 16) for word in words]
    states.append(request(slave, BOOT, INIT | ERROR))  # still with the other mailbox
    request(slave, INIT | 0x10, INIT)
    slave.amend_mbx("out", *boxes[0])
    slave.amend_mbx("in", *boxes[1])
    states.append(request(slave, BOOT))
    slave.foe_write("firmware.efw", 0, LONG[:5000])
    same = slave.foe_read("firmware.efw", 0, 6000) == LONG[:5000]
    states.append(request(slave, INIT))
    states.append(request(slave, PREOP, INIT | ERROR))
    slave.amend_mbx("out", 0x1000, MAIL)
    slave.amend_mbx("in", 0x1100, MAIL)
    states.append(request(slave, PREOP | 0x10, PREOP))
    del master
    return [boxes, states, same, slave.sdo_read(0x1000, 0).hex()]


def test_firmware_in_boot():
    boxes, states, same, device_type = run(HERE, master_boot)
    assert boxes == [[0x1000, BOOT_MAIL], [0x1200, BOOT_MAIL]]
    assert states == [[INIT | ERROR, 0x15], [BOOT, 0], [INIT, 0], [INIT | ERROR, 0x16], [PREOP, 0]]
    assert same
    assert device_type == "89130000"


# --- the rest ------------------------------------------------------------------------------------


def master_identification():
    _, slave = open_preop()
    return request(slave, PREOP | 0x20, PREOP | 0x20), request(slave, PREOP)


def test_device_identification():
    assert run(HERE, master_identification) == [[PREOP | 0x20, 0x42], [PREOP, 0]]


def master_slow():
    import pysoem

    _, slave = open_preop()
    slave.sdo_write(0x2F00, 2, struct.pack("<H", 300))
    begin = time.monotonic()
    slave.sdo_read(0x1000, 0)
    return [time.monotonic() - begin >= 0.29, pysoem.__name__]


def test_slow_mailbox_is_waited_for():
    assert run(HERE, master_slow)[0]


def master_lost_safeop():
    master = open_pysoem()
    to_op(master)
    slave = master.slaves[0]
    found = [request(slave, BOOT, OP | ERROR)]
    slave.output = b"\x34\x12"
    for _ in range(1000):  # they come back inverted, at some time
        cycle(master, 1)
        if slave.input.hex() == "cbed":
            break
    found.append(slave.input.hex())
    found.append(request(slave, OP | 0x10, OP))
    found.append(request(slave, SAFEOP))
    return found


def test_a_refused_request_in_op_leaves_the_outputs_on():
    assert run(HERE, master_lost_safeop) == [[OP | ERROR, 0x11], "cbed", [OP, 0], [SAFEOP, 0]]


# --- distributed clocks --------------------------------------------------------------------------


def master_sync(cycle_ns):
    """A start-up with SYNC0, which is then switched off."""

    def configure(master):
        assert master.config_dc()
        master.slaves[0].dc_sync(True, cycle_ns)

    master = open_pysoem(configure)
    to_op(master)
    slave = master.slaves[0]
    kind = slave.sdo_read(0x1C32, 1)
    sync0 = slave.sdo_read(0x1C32, 10)
    slave.dc_sync(False, cycle_ns)
    return [wait_state(slave, SAFEOP | ERROR), kind.hex(), int.from_bytes(sync0, "little")]


def master_too_fast():
    master, slave = open_preop()
    master.config_dc()
    slave.dc_sync(True, 100_000)
    master.config_map()
    return wait_state(slave, PREOP | ERROR)


def test_sync0_that_is_too_fast():
    assert run(HERE, master_too_fast) == [PREOP | ERROR, 0x36]


def test_op_with_sync0():
    assert run(HERE, master_sync, 1_000_000) == [[SAFEOP | ERROR, 0x2C], "0200", 1_000_000]


# --- kickcat -------------------------------------------------------------------------------------


def master_kickcat():
    import kickcat

    link = kickcat.create_link(INTERFACE, "")
    link.set_timeout(0.02)  # seconds; each scan waits some hundred times this long
    bus = kickcat.Bus(link)
    for tries_left in reversed(range(5)):  # a busy machine may lose all frames of a scan
        try:
            bus.init(0.1)
            break
        except RuntimeError:
            if not tries_left:
                raise
    (slave,) = bus.slaves()
    status = kickcat.mailbox.request.MessageStatus

    def transfer(message):
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            bus.process_mailboxes()
            if message.status() != status.RUNNING:
                break
            time.sleep(0.001)
        return message.status() == status.SUCCESS

    # The answer comes behind the emergency, and behind both that of the next request.
    sent = transfer(
        slave.mailbox.write_sdo(0x2F00, 1, data=struct.pack("<H", 0x8130), timeout=30.0)
    )
    values = [
        bus.read_sdo(slave, index, subindex, kickcat.PARTIAL, 4, 30.0).hex()
        for index, subindex in ((0x1001, 0), (0x1018, 2))
    ]
    name = bus.read_object_description(slave, 0x2F00)[0]
    entry = bus.read_entry_description(slave, 0x2F00, 1)[0]
    return [sent, values, name, entry]


def test_kickcat_takes_emergencies_and_gets_its_answers():
    sent, values, name, entry = run(HERE, master_kickcat)
    assert sent
    assert values == ["01", "07000000"]
    assert "Triggers" in name
    assert "Emergency" in entry

"""AL states of a device: transitions, checks and AL status codes (ETG.1000.6, ETG.1020)."""

import struct

import pytest
from slave_bench import ACK, BOOT, ERROR, INIT, OP, PREOP, SAFEOP, Bench
from test_ecatsim_frames import APWR, datagram, frame

from ecatd.etg.pdo import Entry, Pdo
from ecatsim import AlState, Device, Mailbox, RefusedError
from ecatsim.slave.sii import SmType, SyncManager

REQUEST_ID = 0x20


class Sample(Device):
    """A word out, a word in, and everything that a device may have."""

    vendor, product, revision, order = 0xFFFF, 1, 1, "Sample"
    mailbox = Mailbox(protocols=0x0C)
    bootstrap = Mailbox(0x1000, 256, 0x1100, 256)
    rx_pdos = (Pdo(0x1600, "Out", 2, [Entry(0x7000, 1, "Out", 6, 16)]),)
    tx_pdos = (Pdo(0x1A00, "In", 3, [Entry(0x6000, 1, "In", 6, 16)]),)
    stopped = 0

    def outputs_stopped(self):
        self.stopped += 1


class Plain(Sample):
    """Without BOOT."""

    bootstrap = None


def boot_mailboxes(bench, size=256):
    bench.set_sm(0, 0x1000, size, 0x26)
    bench.set_sm(1, 0x1100, 256, 0x22)


def test_bootstrap_has_its_own_mailbox_in_the_sii():
    image = Sample().sii_image()
    assert struct.unpack_from("<4H", image, 2 * 0x14) == (0x1000, 256, 0x1100, 256)
    assert struct.unpack_from("<4H", Plain().sii_image(), 2 * 0x14) == (0, 0, 0, 0)


def test_boot_is_entered_from_init_and_left_for_init():
    bench = Bench(Sample())
    boot_mailboxes(bench)
    assert bench.request(BOOT) == (BOOT, 0)
    for state in (PREOP, SAFEOP, OP):
        assert bench.request(state) == (BOOT | ERROR, 0x11)
        assert bench.request(BOOT | ACK) == (BOOT, 0)
    assert bench.request(INIT) == (INIT, 0)
    bench.preop()
    assert bench.request(BOOT) == (PREOP | ERROR, 0x11)


@pytest.mark.parametrize(("state", "after"), [(SAFEOP, BOOT), (PREOP, BOOT), (INIT, INIT)])
def test_failure_in_boot(state, after):
    bench = Bench(Sample())
    boot_mailboxes(bench)
    bench.request(BOOT)
    bench.device.fail(0x8001, AlState(state))
    assert bench.al() == (after | ERROR, 0x8001)


def test_boot_is_refused_without_bootstrap_and_with_a_wrong_mailbox():
    assert Bench(Plain()).request(BOOT) == (INIT | ERROR, 0x13)
    bench = Bench(Sample())
    boot_mailboxes(bench, size=128)
    assert bench.request(BOOT) == (INIT | ERROR, 0x15)


def test_from_op_straight_to_boot_is_no_transition():
    bench = Bench(Sample()).safeop().op(b"\1\0")
    assert bench.request(BOOT) == (OP | ERROR, 0x11)


def test_without_firmware_only_boot_is_reached():
    bench = Bench(Sample())
    bench.device.firmware_valid = False
    bench.set_mailboxes()
    assert bench.request(PREOP) == (INIT | ERROR, 0x14)
    boot_mailboxes(bench)
    assert bench.request(BOOT | ACK) == (BOOT, 0)


@pytest.mark.parametrize("wanted", [0, 5, 6, 7, 9, 15])
def test_unknown_states(wanted):
    assert Bench(Sample()).request(wanted) == (INIT | ERROR, 0x12)


@pytest.mark.parametrize(("channel", "code"), [(0, 0x16), (1, 0x16)])
@pytest.mark.parametrize("field", ["size", "start", "direction", "mode", "off"])
def test_wrong_mailbox_settings(channel, code, field):
    bench = Bench(Sample())
    bench.set_mailboxes()
    _, start, size, control, enable, _ = bench.defaults()[channel]
    wrong = {
        "size": (start, size - 2, control, enable),
        "start": (start + 2, size, control, enable),
        "direction": (start, size, control ^ 0x04, enable),
        "mode": (start, size, control & ~0x02, enable),
        "off": (start, size, control, 0),
    }[field]
    bench.set_sm(channel, *wrong)
    assert bench.request(PREOP) == (INIT | ERROR, code)


@pytest.mark.parametrize(("channel", "code"), [(2, 0x1D), (3, 0x1E)])
@pytest.mark.parametrize("field", ["size", "start", "direction", "mode", "off"])
def test_wrong_process_data_settings(channel, code, field):
    bench = Bench(Sample()).preop()
    bench.set_process_data()
    _, start, size, control, enable, _ = bench.defaults()[channel]
    wrong = {
        "size": (start, size + 1, control, enable),
        "start": (start + 2, size, control, enable),
        "direction": (start, size, control ^ 0x04, enable),
        "mode": (start, size, control | 0x02, enable),
        "off": (start, size, control, 0),
    }[field]
    bench.set_sm(channel, *wrong)
    assert bench.request(SAFEOP) == (PREOP | ERROR, code)
    bench.set_process_data()
    assert bench.request(SAFEOP | ACK) == (SAFEOP, 0)


def test_settings_are_checked_again_before_op():
    bench = Bench(Sample()).safeop()
    bench.write(0x0800 + 8 * 3 + 6, b"\0")
    assert bench.request(OP) == (SAFEOP | ERROR, 0x1E)


def test_unknown_sync_manager_is_refused():
    bench = Bench(Sample()).preop()
    bench.set_process_data()
    bench.set_sm(4, 0x1800, 8, 0x20)
    assert bench.request(SAFEOP) == (PREOP | ERROR, 0x17)
    bench.set_sm(4, 0, 0, 0, 0)
    assert bench.request(SAFEOP | ACK) == (SAFEOP, 0)


@pytest.mark.parametrize(
    ("trigger", "divider", "count", "code"),
    [
        (True, 2498, 1000, 0),
        (True, 2498, 1001, 0x1F),
        (True, 2498, 0, 0x1F),
        (False, 2498, 1000, 0x1F),
        (True, 65535, 1, 0),
    ],
)
def test_watchdog_settings(trigger, divider, count, code):
    bench = Bench(Sample()).preop()
    bench.device.longest_watchdog = 0.1
    bench.set_process_data()
    _, start, size, control, *_ = bench.defaults()[2]
    bench.set_sm(2, start, size, control if trigger else control & ~0x40)
    bench.write(0x0400, struct.pack("<H", divider))
    bench.write(0x0420, struct.pack("<H", count))
    assert bench.request(SAFEOP) == ((PREOP | ERROR, code) if code else (SAFEOP, 0))


def test_no_outputs():
    bench = Bench(Sample()).safeop()
    assert bench.request(OP) == (SAFEOP, 0), "it waits for the outputs"
    assert bench.run(0.9).al() == (SAFEOP, 0)
    assert bench.run(0.2).al() == (SAFEOP | ERROR, 0x19)
    bench.put(b"\1\0")
    assert bench.pump().al() == (SAFEOP | ERROR, 0x19), "too late"


def test_outputs_that_came_in_safeop_are_enough_for_op():
    bench = Bench(Sample()).safeop()
    bench.put(b"\7\0")
    assert bench.pump().al() == (SAFEOP, 0)
    bench.request(OP)
    assert bench.pump().al() == (OP, 0)
    assert bench.run().device[0x7000, 1] == 7


def test_outputs_of_the_last_time_in_op_do_not_count():
    bench = Bench(Sample()).safeop().op(b"\7\0")
    assert bench.request(SAFEOP) == (SAFEOP, 0)
    assert bench.request(OP) == (SAFEOP, 0)
    assert bench.pump().al() == (SAFEOP, 0), "it waits for new ones"
    bench.put(b"\7\0")
    assert bench.pump().al() == (OP, 0)
    bench.request(PREOP)
    bench.set_process_data()
    assert bench.request(SAFEOP) == (SAFEOP, 0)
    assert bench.request(OP) == (SAFEOP, 0)
    assert bench.run(1.1).al() == (SAFEOP | ERROR, 0x19)


def test_watchdog_in_op():
    bench = Bench(Sample()).safeop().op(b"\7\0").run(0.05)
    assert bench.device[0x7000, 1] == 7
    assert bench.run(0.1).al() == (SAFEOP | ERROR, 0x1B)
    assert bench.device[0x7000, 1] == 0
    assert bench.device.stopped == 1


def test_error_stays_until_it_is_acknowledged():
    bench = Bench(Sample()).safeop()
    bench.device.fail(0x8001)
    assert bench.al() == (SAFEOP | ERROR, 0x8001)
    for state in (SAFEOP, OP):
        assert bench.request(state) == (SAFEOP | ERROR, 0x8001), "not acknowledged"
    assert bench.request(SAFEOP | ACK) == (SAFEOP, 0)


def test_a_lower_state_needs_no_acknowledgement():
    bench = Bench(Sample()).safeop()
    bench.device.fail(0x8001)
    assert bench.request(PREOP) == (PREOP, 0)


def test_acknowledgement_and_new_state_in_one_request():
    bench = Bench(Sample()).preop()
    bench.set_process_data()
    assert bench.request(OP) == (PREOP | ERROR, 0x11)
    assert bench.request(SAFEOP | ACK) == (SAFEOP, 0)


def test_al_control_is_taken_once_in_a_frame():
    """Like a mailbox, which the device must read first. Nobody reads it with device emulation."""

    class Emulated(Device):
        vendor, product, pdi_control, emulated = 1, 1, 0x0105, True

    for device, counters, state in ((Plain(), (1, 0), INIT), (Emulated(), (1, 1), PREOP)):
        bench = Bench(device)
        requests = (datagram(APWR, 0, 0x0120, bytes([s, 0]), more=s == INIT) for s in (INIT, PREOP))
        reply = bench.segment.process(frame(*requests))
        assert (reply[28], reply[42]) == counters
        assert bench.pump().read(0x0120, 1)[0] == state
        assert bench.write(0x0120, b"\2\0") == 1


def test_process_data_in_one_buffer():
    """Master and device take turns; whoever comes too early is refused."""

    class OneBuffer(Plain):
        sync_managers = (
            SyncManager(SmType.MAILBOX_OUT, 0x1000, 128, 0x26),
            SyncManager(SmType.MAILBOX_IN, 0x1080, 128, 0x22),
            SyncManager(SmType.OUTPUTS, 0x1100, 2, 0x66),
            SyncManager(SmType.INPUTS, 0x1200, 2, 0x22),
        )

    bench = Bench(OneBuffer()).safeop().op(b"\7\0").run()
    assert bench.device[0x7000, 1] == 7
    assert [bench.write(0x1100, bytes([n, 0])) for n in (8, 9)] == [1, 0]
    bench.run()
    assert bench.device[0x7000, 1] == 8
    bench.run()
    assert bench.device[0x7000, 1] == 8, "the last ones hold"
    assert bench.read(0x1200, 2) is not None
    assert bench.read(0x1200, 2) is None
    bench.device[0x6000, 1] = 5
    bench.run()
    bench.device[0x6000, 1] = 6
    bench.run()
    assert bench.read(0x1200, 2) == b"\5\0", "the master has not read it before"


def test_slow_state_changes():
    device = Plain()
    device.state_delay = 0.05
    bench = Bench(device)
    bench.set_mailboxes()
    assert bench.request(PREOP) == (INIT, 0)
    assert bench.run(0.04).al() == (INIT, 0)
    assert bench.run(0.02).al() == (PREOP, 0)


def test_refused_transition_keeps_the_state():
    class Stubborn(Sample):
        def check(self, old, new):
            raise RefusedError(0x8123)

    bench = Bench(Stubborn())
    bench.set_mailboxes()
    assert bench.request(PREOP) == (INIT | ERROR, 0x8123)


def test_damaged_eeprom_keeps_the_device_in_init():
    class Damaged(Sample):
        def sii_image(self):
            image = bytearray(super().sii_image())
            image[0] ^= 0xFF  # the checksum is wrong now
            return bytes(image)

    bench = Bench(Damaged())
    bench.set_mailboxes()
    assert bench.request(PREOP) == (INIT | ERROR, 0x51)
    boot_mailboxes(bench)
    assert bench.request(BOOT | ACK) == (INIT | ERROR, 0x51)


def test_eeprom_that_the_master_keeps():
    class Reader(Sample):
        needs_eeprom = True

    bench = Bench(Reader())
    bench.set_mailboxes()
    bench.write(0x0500, b"\0")
    assert bench.request(PREOP) == (INIT | ERROR, 0x50)
    bench.write(0x0500, b"\1")
    assert bench.request(PREOP | ACK) == (PREOP, 0)


def test_device_identification():
    bench = Bench(Sample())
    assert bench.request(INIT | REQUEST_ID) == (INIT, 0), "the device has none"
    bench.device.device_id = 0x1234
    assert bench.request(INIT | REQUEST_ID) == (INIT | REQUEST_ID, 0x1234)
    assert bench.request(INIT) == (INIT, 0)
    bench.set_mailboxes()
    assert bench.request(PREOP | REQUEST_ID) == (PREOP | REQUEST_ID, 0x1234)
    assert bench.request(SAFEOP | REQUEST_ID) == (PREOP | ERROR, 0x1D)
    assert bench.request(PREOP | ACK | REQUEST_ID) == (PREOP | REQUEST_ID, 0x1234)


def test_simple_device_has_no_mailbox_to_check():
    class Simple(Device):
        order = "Simple"
        tx_pdos = (Pdo(0x1A00, "In", 0, [Entry(0x6000, 1, "In", 5, 8)]),)

    bench = Bench(Simple())
    assert bench.request(PREOP) == (PREOP, 0)
    bench.set_process_data()
    assert bench.request(SAFEOP) == (SAFEOP, 0)
    assert bench.request(OP) == (OP, 0), "without outputs there is nothing to wait for"


def test_reset_is_power_on():
    bench = Bench(Sample()).safeop().op(b"\7\0").run(0.01)
    bench.device[0x6000, 1] = 99
    bench.device.reset()
    assert bench.al() == (INIT, 0)
    assert bench.device.stopped == 1
    assert (bench.device[0x7000, 1], bench.device[0x6000, 1]) == (0, 0)
    assert bench.run(0.01).al() == (INIT, 0)
    bench.safeop().op(b"\5\0").run()
    assert bench.device[0x7000, 1] == 5


def test_reset_of_the_slave_controller_by_the_master():
    bench = Bench(Sample()).safeop().op(b"\7\0").run(0.01)
    for byte in b"RES":
        bench.write(0x0040, bytes([byte]))
    bench.pump()
    assert bench.al() == (INIT, 0)
    assert bench.device.stopped == 1
    bench.safeop().op(b"\5\0").run()
    assert bench.device[0x7000, 1] == 5


def test_outputs_go_on_beside_a_device_identification_and_a_refused_request():
    bench = Bench(Sample()).safeop().op(b"\7\0").run()
    bench.device.device_id = 5
    assert bench.request(OP | REQUEST_ID) == (OP | REQUEST_ID, 5)
    assert bench.run().device[0x7000, 1] == 7
    assert bench.request(BOOT) == (OP | ERROR, 0x11)
    assert bench.run().device[0x7000, 1] == 7


def test_another_device_takes_the_place():
    class Other(Sample):
        order, product = "Other", 2

    neighbour = Sample()
    bench = Bench(Sample(), neighbour).safeop().op(b"\7\0").run()
    first, second = bench.device, Other()
    first.detach()
    assert (first.machine.state, first.stopped) == (INIT, 1)
    second.attach(bench.segment, 0, 0, place=0)
    bench.device = second
    bench.devices = (second, neighbour)
    assert bench.al() == (INIT, 0)
    bench.safeop().op(b"\5\0").run()
    assert (second[0x7000, 1], first[0x7000, 1]) == (5, 0)
    second.detach()
    first.attach(bench.segment, 0, 0, place=0)
    bench.device, bench.devices = first, (first, neighbour)
    bench.safeop().op(b"\4\0").run()
    assert first[0x7000, 1] == 4


def test_power_cycle():
    bench = Bench(Sample()).safeop().op(b"\7\0").run()
    bench.segment.power(0, False)
    bench.device.reset()
    bench.segment.power(0, True)
    bench.device.reset()
    bench.pump()
    assert bench.al() == (INIT, 0)
    bench.safeop().op(b"\5\0").run()
    assert bench.device[0x7000, 1] == 5

"""Devices at rest make no steps until something changes that their inputs depend on."""

import struct

import pytest
from slave_bench import OP, PREOP, SAFEOP, Bench

from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatsim.devices import drives
from ecatsim.devices.beckhoff import EL2008, EL3008, EL4004
from ecatsim.devices.generic import AnalogIO, DigitalIO, Loopback
from ecatsim.esc import Event
from ecatsim.plants.waveforms import constant
from ecatsim.rigs import library
from ecatsim.slave.device import Device
from ecatsim.slave.mailbox import MailboxFault
from ecatsim.slave.sii import Mailbox

OUTPUTS = {AnalogIO: bytes(8), DigitalIO: b"\0", Loopback: bytes(32), EL2008: b"\0"}


class Follower(Device):
    """Doubles its output, counts its steps, and says that it rests."""

    vendor, product, revision, order = 0x0000FFFF, 1, 1, "Follower"
    mailbox = Mailbox()
    rx_pdos = (Pdo(0x1600, "Outputs", 2, [Entry(0x7000, 1, "In", DataType.INTEGER16, 16)]),)
    tx_pdos = (Pdo(0x1A00, "Inputs", 3, [Entry(0x6000, 1, "Out", DataType.INTEGER16, 16)]),)
    steps = 0

    def step(self, now):
        self.steps += 1
        self[0x6000, 1] = 2 * self[0x7000, 1]

    def rests(self):
        return True


class Clock(Follower):
    """A step of its own, of which the `rests` above knows nothing."""

    def step(self, now):
        self.steps += 1


def steps_of(bench, seconds=0.02):
    before = bench.device.steps
    bench.run(seconds)
    return bench.device.steps - before


@pytest.fixture
def bench():
    result = Bench(Follower()).safeop().op(struct.pack("<h", 1)).run(0.01)
    assert result.device.sleeps
    assert steps_of(result) == 0
    return result


@pytest.mark.parametrize("kind", OUTPUTS)
def test_devices_at_rest_sleep(kind):
    bench = Bench(kind()).safeop().op(OUTPUTS[kind]).run(0.01)
    assert bench.device.sleeps


def test_new_outputs_end_the_rest(bench):
    for value in (5, -7):
        bench.put(struct.pack("<h", value))
        assert bench.run(0.002).get() == struct.pack("<h", 2 * value)
    assert bench.run(0.01).device.sleeps


def test_an_object_that_a_plant_or_a_master_writes_ends_the_rest(bench):
    bench.device.connection(0x7000, 1).value = 20
    assert bench.run().get() == struct.pack("<h", 40)
    bench.run(0.01).download(0x7000, 1, struct.pack("<h", 30))
    assert bench.run().get() == struct.pack("<h", 60)
    bench.run(0.01).device.connection(0x7000, 1).value = 30
    assert bench.device.sleeps, "the value is the same"


def test_zero_and_minus_zero_are_two_values(bench):
    entry = bench.device.dictionary.variable(0x2000, "Real", DataType.REAL32, 0.0)
    bench.device.dictionary.remember()
    entry.value = 0.0
    assert bench.device.sleeps
    entry.value = -0.0
    assert not bench.device.sleeps


def test_each_state_is_followed(bench):
    bench.request(SAFEOP)
    assert not bench.device.sleeps
    assert bench.run().get() == bytes(2), "outputs in the dictionary become 0"
    assert bench.run(0.01).device.sleeps
    assert bench.request(PREOP) == (PREOP, 0)
    assert steps_of(bench) > 0


def test_the_watchdog_ends_the_rest(bench):
    bench.run(0.2)  # without a frame
    assert bench.al() == (SAFEOP | 0x10, 0x1B)


def test_a_step_of_a_subclass_is_made_each_time():
    bench = Bench(Clock()).safeop().op(bytes(2)).run(0.01)
    assert steps_of(bench, 0.02) == 20


def test_late_answers_come_in_time(bench):
    bench.device.answer_delay = 0.05
    request = struct.pack("<H", 2 << 12) + struct.pack("<BHBI", 0x40, 0x1000, 0, 0)
    assert bench.post(3, request) == 1
    bench.run(0.048)
    assert bench.fetch() is None
    bench.run(0.004)
    assert bench.fetch() is not None


def test_a_slow_mailbox_delays_an_emergency_from_the_moment_that_it_comes(bench):
    bench.device.mailbox_fault = MailboxFault("slow", 0.05)
    bench.run(0.5).device.emergency(0x1000, 1)
    bench.run(0.048)
    assert bench.fetch() is None
    bench.run(0.004)
    assert bench.fetch() is not None


def test_a_late_state_comes_in_time():
    class Slow(Follower):
        state_delay = 0.05

    bench = Bench(Slow())
    bench.set_mailboxes()
    bench.run(0.5).request(PREOP)
    assert bench.run(0.045).al()[0] != PREOP
    assert bench.run(0.01).al() == (PREOP, 0)


def test_missing_outputs_are_told_after_a_second():
    bench = Bench(Follower()).safeop().run(0.5)
    assert bench.device.sleeps
    bench.request(OP)
    bench.run(1.1)
    assert bench.al() == (SAFEOP | 0x10, 0x19)


def test_a_drive_that_is_off_sleeps_and_starts_as_if_it_had_not():
    def positions(rest):
        drive = drives.kind("ElmoGold")()
        bench = Bench(drive).safeop().op(bytes(16)).run(0.02)
        if rest:
            assert drive.sleeps
            for _ in range(50):  # the watchdog is fed
                bench.put(bytes(16))
                bench.run(0.05)
        for word in (6, 7, 15):
            bench.put(struct.pack("<iihHHbx", 0, 50_000, 0, 1000, word, 9))
            bench.run(0.005)
        found = []
        for _ in range(50):
            bench.run(0.001)
            found.append(drive[0x6064, 0])
        assert found[-1] > 100
        assert not drive.sleeps
        return found

    assert positions(rest=True) == positions(rest=False)


def test_a_broken_encoder_wakes_the_drive():
    drive = drives.kind("ElmoGold")()
    bench = Bench(drive).safeop().op(bytes(16)).run(0.02)
    assert drive.sleeps
    drive.break_encoder()
    assert bench.run().device[0x603F, 0] == 0x7305


def test_an_output_goes_along_its_ramp_to_the_end():
    terminal = EL4004()
    bench = Bench(terminal).safeop().op(struct.pack("<4h", 1000, 0, 0, 0)).run(0.01)
    assert terminal.sleeps
    terminal.dictionary[0x8000, 5].value, terminal.dictionary[0x8000, 0x14].value = 1, 10
    bench.request(SAFEOP)
    bench.run(0.05)
    assert 0 < terminal.voltage(0) < 1000 / 32767 * 10
    assert not terminal.sleeps
    assert bench.run(0.1).device.voltage(0) == 0
    assert terminal.sleeps


def test_an_analog_input_converts_all_the_time():
    terminal = EL3008([constant(5.0)])
    bench = Bench(terminal).safeop().run(0.01)
    found = {bench.run().get()[:4] for _ in range(10)}
    assert {struct.unpack("<Hh", data) for data in found} == {(0, 16384), (0x8000, 16384)}
    terminal.connection(0x6010, 0x11).value = -100.0
    assert {bench.run().get()[6:8] for _ in range(3)} == {struct.pack("<h", -100)}
    terminal.dictionary[0x6000, 0x11].value = 0
    assert bench.run().get()[2:4] == struct.pack("<h", 16384), "it computes its value again"


def test_a_terminal_follows_another_one():
    outputs, inputs = library.make("terminals:3").devices[1:]
    bench = Bench(inputs, outputs).safeop().run(0.01)
    assert inputs.sleeps
    outputs.receive(b"\x5a")
    assert bench.run().get() == b"\x5a"
    assert bench.run(0.01).device.sleeps


def test_a_reset_ends_the_rest(bench):
    bench.device.handle(Event.RESET, bench.now)
    assert not bench.device.sleeps

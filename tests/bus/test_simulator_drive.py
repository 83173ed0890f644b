"""The CiA 402 drive on the wire: pysoem (SOEM) drives every mode to the state the standard wants.

The master runs as a command inside `ecatsim run`; this file is the rig as well. Functions named
`master_…` return what is to be judged, as JSON.
"""

import struct
import time
from pathlib import Path

import pytest
from masters import PATIENCE, new_master, run

from ecatsim.devices.library import make
from ecatsim.rig import Rig

pytestmark = [pytest.mark.bus, pytest.mark.long]

INTERFACE = "ecat-master"
HERE = Path(__file__)
PREOP, SAFEOP, OP = 2, 4, 8
TURN = 65536
SPEED = 10 * TURN
HALT, NEW = 0x100, 0x10
REACHED, LIMIT, BIT_12, BIT_13 = 0x400, 0x800, 0x1000, 0x2000
DISABLED, ENABLED, QUICK_STOP, REACTION, FAULT = 0x40, 0x27, 0x07, 0x0F, 0x08
OUTPUTS = struct.Struct("<HBxiih")  # 0x1600: control word, mode, targets
INPUTS = struct.Struct("<HbxiihHI")  # 0x1A00: status word, mode, actual values


def rig():
    drive = make("CiA402", travel=5.25)

    def encoder(now):
        """The encoder cable is broken while the master asks for more than 20 turns."""
        drive.break_encoder(drive[0x607A, 0] > 20 * TURN)

    result = Rig("drive", [drive])
    result.add_plant(encoder)
    return result


class Axis:
    """A drive as a master sees it: the process data, and conditions to wait for."""

    def __init__(self, configure=None, cycle_ns=0):

        self.master = new_master()
        self.master.open(INTERFACE)
        assert self.master.config_init() == 1
        self.slave = self.master.slaves[0]
        self.slave._fpwr(0x0420, b"\x00\x00")  # a busy machine must not let it expire
        if configure:
            configure(self)
        if cycle_ns:  # before config_map, which asks for SAFEOP
            assert self.master.config_dc()
            self.slave.dc_sync(True, cycle_ns)
        self.master.config_map()
        assert self.master.state_check(SAFEOP, 2_000_000) == SAFEOP
        self.word = self.mode = self.position = self.speed = self.torque = 0
        self.cycle()
        self.master.state = OP
        self.master.write_state()
        self.until(lambda: self.master.read_state() == OP)

    def write(self, index, value, subindex=0):
        """Writes an object with as many bytes as it has."""
        size = len(self.slave.sdo_read(index, subindex, 8))
        self.slave.sdo_write(index, subindex, value.to_bytes(size, "little", signed=value < 0))

    def cycle(self):
        self.slave.output = OUTPUTS.pack(
            self.word, self.mode, self.position, self.speed, self.torque
        )
        self.master.send_processdata()
        self.master.receive_processdata(10_000)
        data = self.slave.input
        if len(data) == INPUTS.size:
            (
                self.status,
                self.display,
                self.at,
                self.velocity,
                self.force,
                self.error,
                self.inputs,
            ) = INPUTS.unpack(data)
        time.sleep(0.001)

    def until(self, condition, seconds=PATIENCE):
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, f"status 0x{self.status:04X} mode {self.display}"
            self.cycle()

    def rest(self, seconds):
        end = time.monotonic() + seconds
        self.until(lambda: time.monotonic() > end)

    @property
    def state(self):
        """The state bits; x is 0 where the standard does not care."""
        bits = self.status & 0x6F
        return bits & 0x4F if bits & 0x40 or bits & 0x0F in (0x08, 0x0F) else bits

    def command(self, word, state):
        self.word = word
        self.until(lambda: self.state == state)

    def enable(self, mode):
        """The way up, one state after the other."""
        self.mode = mode
        for word, state in ((0x06, 0x21), (0x07, 0x23), (0x0F, ENABLED)):
            self.command(word, state)
        self.until(lambda: self.display == mode)

    def has(self, bits):
        return self.status & bits == bits


def master_profile_position():
    axis = Axis()
    axis.enable(1)
    axis.position, found = 3 * TURN, []
    axis.word = 0x0F | NEW
    axis.until(lambda: axis.has(BIT_12))
    axis.word = 0x0F
    axis.until(lambda: not axis.has(BIT_12))
    axis.until(lambda: axis.has(REACHED))
    axis.rest(0.3)
    found.append(axis.at)
    axis.position, axis.word = -TURN, 0x4F | NEW  # relative
    axis.until(lambda: axis.has(BIT_12) and not axis.has(REACHED))
    axis.until(lambda: axis.has(REACHED))
    axis.rest(0.3)
    return [*found, axis.at]


def test_profile_position_with_handshake():
    first, second = run(HERE, master_profile_position)
    assert first == pytest.approx(3 * TURN, abs=300)
    assert second == pytest.approx(2 * TURN, abs=300)


def master_velocity(mode):
    axis = Axis(lambda a: a.write(0x6083, 100 * TURN))
    axis.enable(mode)
    axis.speed = TURN
    axis.until(lambda: abs(axis.velocity - TURN) < 0.02 * TURN)
    axis.until(lambda: axis.has(REACHED if mode == 3 else BIT_12))
    axis.word |= HALT
    axis.until(lambda: abs(axis.velocity) < 200)
    if mode == 3:
        axis.until(lambda: axis.has(REACHED | BIT_12))
    else:
        axis.until(lambda: not axis.has(BIT_12))
    axis.word = 0x0F
    axis.speed = 5 * TURN  # now against the positive limit switch at 5.25 turns
    axis.until(lambda: axis.has(LIMIT) and axis.inputs & 2)
    axis.until(lambda: abs(axis.velocity) < 200)
    return axis.at


@pytest.mark.parametrize("mode", [3, 9])
def test_velocity_modes(mode):
    assert run(HERE, master_velocity, mode) == pytest.approx(5.25 * TURN, abs=0.5 * TURN)


def master_torque(mode):
    axis = Axis()
    axis.enable(mode)
    axis.torque, values = 60, []  # less than friction: it does not move
    axis.until(lambda: axis.has(REACHED if mode == 4 else BIT_12))
    for _ in range(200):
        axis.cycle()
        values.append(axis.force)
    return [sum(values) / len(values), axis.velocity]


@pytest.mark.parametrize("mode", [4, 10])
def test_torque_modes(mode):
    mean, speed = run(HERE, master_torque, mode)
    assert mean == pytest.approx(60, abs=3)
    assert speed == 0


def master_cyclic_position():
    axis = Axis()
    axis.position = axis.at
    axis.enable(8)
    for i in range(1, 301):
        axis.position = 300 * i
        axis.cycle()
    axis.until(lambda: abs(axis.at - 90_000) < 100)
    return [axis.at, axis.has(BIT_12), axis.has(BIT_13)]


def test_cyclic_synchronous_position():
    position, follows, late = run(HERE, master_cyclic_position)
    assert position == pytest.approx(90_000, abs=100)
    assert follows
    assert not late


def master_homing(methods):
    def configure(axis):
        axis.write(0x607C, 1000)
        axis.write(0x6099, 20 * TURN, 1)
        axis.write(0x6099, 5 * TURN, 2)

    axis, found = Axis(configure), {}
    for method in methods:
        axis.write(0x6098, method)
        axis.enable(6)
        axis.until(lambda: axis.has(REACHED) and not axis.has(BIT_12))
        axis.word = 0x0F | NEW
        axis.until(lambda: axis.has(BIT_12 | REACHED))
        assert not axis.has(BIT_13)
        axis.mode, axis.word, axis.position = 1, 0x0F, 1000
        axis.until(lambda: axis.display == 1)
        axis.word = 0x0F | NEW  # back to the reference
        axis.until(lambda: axis.has(BIT_12 | REACHED) and abs(axis.at - 1000) < 300)
        found[method] = axis.inputs & 3
        # Away from the switch that is near: a limit switch would hold it.
        axis.position, axis.word = TURN // 3 * (1 if method in (1, 17, 33) else -1), 0x4F
        axis.until(lambda: not axis.has(BIT_12))  # it has seen that the last one is over
        axis.word |= NEW
        axis.until(lambda: axis.has(BIT_12 | REACHED) and abs(axis.at - 1000) > 20_000)
        assert not axis.inputs & 3
        axis.word = 0x0F
        axis.until(lambda: not axis.has(BIT_12))
    return found


def test_homing_methods():
    """After homing, the position of the home offset is where the reference is."""
    methods = (1, 2, 17, 18, 33, 34, 35, 37)
    found = run(HERE, master_homing, methods)
    assert set(found) == {str(method) for method in methods}
    on_switch = {method for method, inputs in found.items() if inputs}
    assert on_switch <= {"17", "18"}, "only these have their reference at a switch"


def master_quick_stop(codes):
    axis, found = Axis(), {}
    for code in codes:
        axis.write(0x605A, code)
        axis.speed = TURN if code % 2 else -TURN
        axis.enable(9)
        axis.until(lambda: abs(axis.velocity) > 0.9 * TURN)
        if code < 5:
            axis.command(0x0B, DISABLED)
        else:
            axis.command(0x0B, QUICK_STOP)
            axis.until(lambda: abs(axis.velocity) < 200)
            axis.rest(0.1)
            assert axis.state == QUICK_STOP
            axis.command(0x0F, ENABLED)
            axis.command(0, DISABLED)
        axis.until(lambda: abs(axis.velocity) < 200)
        found[code] = axis.state
    return found


def test_quick_stop_option_codes():
    """0 to 3 lead to SWITCH ON DISABLED, 5 to 7 stay and lead back to OPERATION ENABLED."""
    codes = (0, 1, 2, 3, 5, 6, 7)
    assert run(HERE, master_quick_stop, codes) == {str(code): DISABLED for code in codes}


def master_following_error():
    def configure(axis):
        axis.write(0x6065, 2000)
        axis.write(0x6072, 0)  # no torque: it cannot follow

    axis = Axis(configure)
    heard = []
    axis.slave.add_emergency_callback(lambda message: heard.append(message.error_code))
    axis.enable(8)
    axis.position = TURN
    axis.until(lambda: axis.state == FAULT)
    found = [axis.error, axis.slave.sdo_read(0x1001, 0, 8)[0]]
    axis.position = axis.at
    axis.word = 0
    axis.cycle()
    axis.command(0x80, DISABLED)
    axis.until(lambda: axis.error == 0)
    axis.slave.sdo_read(0x1001, 0, 8)  # pysoem hears emergencies while it reads mails
    return [*found, heard]


def test_following_error_fault_emergency_and_reset():
    error, register, heard = run(HERE, master_following_error)
    assert error == 0x8611
    assert register == 0x21
    assert heard == [0x8611, 0x0000]


def master_encoder_fault():
    axis = Axis()
    axis.enable(9)
    axis.position = 21 * TURN  # breaks the encoder cable, see `rig`
    axis.until(lambda: axis.state == FAULT)
    found = [axis.error]
    for word in (0, 0x80) * 3:
        axis.word = word
        axis.rest(0.01)
        found.append(axis.state)
    axis.position, axis.word = 0, 0
    axis.rest(0.02)
    axis.command(0x80, DISABLED)
    axis.enable(9)
    return found


def test_an_encoder_fault_stays_as_long_as_its_cause():
    error, *states = run(HERE, master_encoder_fault)
    assert error == 0x7305
    assert set(states) == {FAULT}


def master_with_sync0():
    axis = Axis(cycle_ns=2_000_000)
    axis.enable(9)
    axis.speed = TURN
    axis.until(lambda: abs(axis.velocity - TURN) < 0.02 * TURN)
    return [
        struct.unpack("<I", axis.slave.sdo_read(0x1C32, i, 4).ljust(4, b"\0"))[0] for i in (1, 10)
    ]


def test_a_drive_that_goes_by_sync0():
    """0x1C32: synchronization type 2 (SYNC0) and its cycle time, as set in the SYNC unit."""
    assert run(HERE, master_with_sync0) == [2, 2_000_000]


class OwnMapping(Axis):
    """An axis with the process data of `master_other_mapping`."""

    def cycle(self):
        self.slave.output = struct.pack("<HiB", self.word, self.speed, self.mode)
        self.master.send_processdata()
        self.master.receive_processdata(10_000)
        if len(self.slave.input) == 11:
            values = struct.unpack("<HbiI", self.slave.input)
            self.status, self.display, _, self.voltage = values
        time.sleep(0.001)


def master_other_mapping():
    """PDOs of the master's own: assigned and mapped in PREOP."""

    def configure(axis):
        slave = axis.slave
        for index, entries in (
            (0x1601, (0x60400010, 0x60FF0020, 0x60600008)),
            (0x1A01, (0x60410010, 0x60610008, 0x60F40020, 0x60790020)),
        ):
            slave.sdo_write(index, 0, b"\0")
            for i, entry in enumerate(entries, 1):
                slave.sdo_write(index, i, struct.pack("<I", entry))
            slave.sdo_write(index, 0, bytes([len(entries)]))
        for assignment, pdo in ((0x1C12, 0x1601), (0x1C13, 0x1A01)):
            slave.sdo_write(assignment, 0, b"\0")
            slave.sdo_write(assignment, 1, struct.pack("<H", pdo))
            slave.sdo_write(assignment, 0, b"\1")

    axis = OwnMapping(configure)
    axis.enable(9)
    axis.speed = TURN
    axis.rest(0.3)
    speed = struct.unpack("<i", axis.slave.sdo_read(0x606C, 0, 8))[0]
    return [len(axis.slave.output), len(axis.slave.input), speed, axis.voltage]


def test_a_mapping_of_the_masters_own():
    outputs, inputs, speed, voltage = run(HERE, master_other_mapping)
    assert (outputs, inputs) == (7, 11)
    assert speed == pytest.approx(TURN, rel=0.02)
    assert voltage == 48_000

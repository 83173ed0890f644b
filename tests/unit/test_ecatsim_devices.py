"""State machine, drive and motor, without a bus."""

import math

import pytest

from conftest import naming
from ecatd.base.errors import ConfigError, UsageError
from ecatd.etg.al import AlState
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatsim.devices import drives
from ecatsim.devices.beckhoff import EL1018, EL3008
from ecatsim.devices.cia402 import PowerState, PowerStateMachine
from ecatsim.devices.library import make
from ecatsim.esc import Segment
from ecatsim.plants.motor import Control, Motor
from ecatsim.rig import Rig
from ecatsim.rigs import library as rigs
from ecatsim.simulation import Simulation
from ecatsim.slave.device import Device
from ecatsim.slave.state_machine import RefusedError, StateMachine

INIT, PREOP, BOOT, SAFEOP, OP = 1, 2, 3, 4, 8
ERROR = ACK = 0x10


class Recorder:
    """A state machine with what it published; changes in `refused` and `slow` do not succeed."""

    def __init__(self):
        self.status, self.code = INIT, 0
        self.refused, self.slow = {}, set()
        self.machine = StateMachine(self.enter, self.publish)

    def enter(self, old, new):
        if new in self.refused:
            raise RefusedError(self.refused[new])
        return new not in self.slow

    def publish(self, status, code):
        self.status, self.code = status, code

    def request(self, *controls):
        for control in controls:
            self.machine.request(control)
        return self.status, self.code


def test_way_up_and_down():
    recorder = Recorder()
    for state in (PREOP, SAFEOP, OP, SAFEOP, PREOP, INIT):
        assert recorder.request(state) == (state, 0)
    for state in (SAFEOP, PREOP, INIT):
        assert Recorder().request(PREOP, SAFEOP, OP, state) == (state, 0)


@pytest.mark.parametrize(
    ("path", "control", "code"),
    [
        ((), SAFEOP, 0x11),
        ((), OP, 0x11),
        ((PREOP,), OP, 0x11),
        ((PREOP,), BOOT, 0x11),
        ((), BOOT, 0x13),
        ((), 0, 0x12),
        ((PREOP,), 5, 0x12),
        ((PREOP,), 0x0F, 0x12),
    ],
)
def test_wrong_requests(path, control, code):
    state = path[-1] if path else INIT
    assert Recorder().request(*path, control) == (state | ERROR, code)


def test_error_must_be_acknowledged_on_the_way_up():
    recorder = Recorder()
    assert recorder.request(PREOP, OP) == (PREOP | ERROR, 0x11)
    assert recorder.request(SAFEOP) == (PREOP | ERROR, 0x11), "ignored"
    assert recorder.request(PREOP | ACK) == (PREOP, 0)
    assert recorder.request(SAFEOP) == (SAFEOP, 0)


def test_way_down_needs_no_acknowledgement():
    assert Recorder().request(PREOP, OP, INIT) == (INIT, 0)


def test_refused_change_reports_the_code():
    recorder = Recorder()
    recorder.refused[SAFEOP] = 0x1E
    assert recorder.request(PREOP, SAFEOP) == (PREOP | ERROR, 0x1E)


def test_pending_change():
    recorder = Recorder()
    recorder.slow.add(OP)
    assert recorder.request(PREOP, SAFEOP, OP) == (SAFEOP, 0)
    recorder.machine.finish()
    assert recorder.status == OP
    recorder.machine.finish()
    assert recorder.request(SAFEOP, OP) == (SAFEOP, 0)
    recorder.machine.refuse(0x19)
    assert (recorder.status, recorder.code) == (SAFEOP | ERROR, 0x19)


def test_fall_back():
    recorder = Recorder()
    recorder.request(PREOP, SAFEOP, OP)
    recorder.machine.fall_back(AlState.SAFEOP, 0x1B)
    assert (recorder.status, recorder.code) == (SAFEOP | ERROR, 0x1B)
    assert recorder.request(OP) == (SAFEOP | ERROR, 0x1B)
    assert recorder.request(OP | ACK) == (OP, 0)


# --- drive -----------------------------------------------------------------------------------


def test_power_states():
    power = PowerStateMachine()
    states = []
    for word in (0x00, 0x06, 0x07, 0x0F, 0x07, 0x0F, 0x06, 0x0F, 0x00, 0x0F, 0x06, 0x02):
        power.command(word)
        states.append(power.state)
    s = PowerState
    assert states == [
        s.SWITCH_ON_DISABLED,
        s.READY_TO_SWITCH_ON,
        s.SWITCHED_ON,
        s.OPERATION_ENABLED,
        s.SWITCHED_ON,
        s.OPERATION_ENABLED,
        s.READY_TO_SWITCH_ON,
        s.OPERATION_ENABLED,
        s.SWITCH_ON_DISABLED,
        s.SWITCH_ON_DISABLED,
        s.READY_TO_SWITCH_ON,
        s.SWITCH_ON_DISABLED,
    ]


def test_fault_and_reset():
    power = PowerStateMachine()
    power.command(0x06)
    power.fault()
    assert power.state == PowerState.FAULT
    power.command(0x0F)
    assert power.state == PowerState.FAULT
    power.command(0x80)
    assert power.state == PowerState.SWITCH_ON_DISABLED
    for word in (0x06, 0x0F):
        power.command(word)
    power.fault()
    assert power.state == PowerState.FAULT_REACTION
    power.standstill()
    assert power.state == PowerState.FAULT


class Bench:
    """A drive on a bench: steps of one millisecond."""

    def __init__(self, **entries):
        self.drive, self.now = drives.kind("ElmoGold")(seed=3), 0.0
        self.drive.step(0.0)

    def set(self, **values):
        names = {"word": 0x6040, "mode": 0x6060, "speed": 0x60FF, "position": 0x607A}
        names |= {"torque": 0x6071, "max_torque": 0x6072}
        for name, value in values.items():
            self.drive[names[name], 0] = value
        return self

    def run(self, seconds):
        for _ in range(round(seconds * 1000)):
            self.now += 0.001
            self.drive.step(self.now)
        return self

    def enable(self, mode):
        self.set(mode=mode)
        for word in (0x06, 0x07, 0x0F):
            self.set(word=word).run(0.002)
        return self

    @property
    def status(self):
        return self.drive[0x6041, 0]

    @property
    def speed(self):
        return self.drive[0x606C, 0]

    @property
    def position(self):
        return self.drive[0x6064, 0]


def test_status_words_of_the_start_up():
    bench = Bench()
    assert bench.status == 0x0250
    bench.set(word=6).run(0.001)
    assert bench.status == 0x0231
    bench.set(word=7).run(0.001)
    assert bench.status == 0x0233
    bench.set(mode=9, word=15).run(0.001)
    assert bench.status == 0x1237
    assert bench.drive[0x6061, 0] == 9


def test_cyclic_velocity():
    bench = Bench().enable(9).set(speed=500_000).run(0.3)
    assert bench.speed == pytest.approx(500_000, rel=0.01)
    assert bench.position > 0
    bench.set(speed=-500_000).run(0.4)
    assert bench.speed == pytest.approx(-500_000, rel=0.01)


def test_profile_velocity_follows_its_ramp():
    bench = Bench()
    bench.drive[0x6083, 0] = bench.drive[0x6084, 0] = 1_000_000
    bench.enable(3).set(speed=500_000).run(0.25)
    assert bench.speed == pytest.approx(250_000, rel=0.05)
    assert not bench.status & 0x0400
    bench.run(0.5)
    assert bench.speed == pytest.approx(500_000, rel=0.01)
    assert bench.status & 0x0400, "target reached"
    bench.set(speed=0).run(1.0)
    assert abs(bench.speed) < 2000
    bench.set(speed=500_000, word=0x010F).run(1.0)
    assert abs(bench.speed) < 2000, "halt"


def test_cyclic_position():
    bench = Bench().enable(8)
    start = bench.position
    for i in range(400):
        bench.set(position=start + 200 * i).run(0.001)
    assert bench.position == pytest.approx(start + 200 * 400, abs=2000)
    bench.run(0.5)
    assert bench.position == pytest.approx(start + 200 * 399, abs=100)


def test_profile_position_with_hand_shake():
    bench = Bench().enable(1).set(position=100_000)
    bench.run(0.1)
    assert abs(bench.position) < 100, "no new set-point yet"
    bench.set(word=0x1F).run(0.002)
    assert bench.status & 0x1000, "acknowledged"
    bench.set(word=0x0F).run(2.0)
    assert not bench.status & 0x1000
    assert bench.status & 0x0400
    assert bench.position == pytest.approx(100_000, abs=300)
    bench.set(position=-50_000, word=0x5F).run(2.0)
    assert bench.position == pytest.approx(50_000, abs=300), "relative"


def test_torque_and_its_limit():
    bench = Bench().enable(10).set(torque=500).run(0.05)
    data = bench.drive.motor.data
    assert bench.drive.motor.current == pytest.approx(0.5 * data.rated_current, rel=0.02)
    assert bench.drive[0x6077, 0] == pytest.approx(500, abs=30)
    bench.set(max_torque=200).run(0.02)
    assert bench.drive.motor.current == pytest.approx(0.2 * data.rated_current, rel=0.02)
    assert bench.status & 0x0800


def test_quick_stop_brakes_and_switches_off():
    bench = Bench().enable(9).set(speed=800_000).run(0.3)
    bench.set(word=0x0B).run(0.002)
    assert bench.status & 0x6F == 0x07
    bench.run(0.5)
    assert bench.status & 0x4F == 0x40
    assert bench.drive.motor.control is Control.OFF
    assert abs(bench.speed) < 10_000


def test_disabled_motor_runs_out():
    bench = Bench().enable(9).set(speed=800_000).run(0.3)
    bench.set(word=0).run(0.01)
    assert bench.status & 0x4F == 0x40
    assert bench.speed > 700_000
    bench.run(3.0)
    assert bench.speed == 0


def test_unknown_mode_changes_nothing():
    bench = Bench().enable(9).set(speed=300_000).run(0.3)
    bench.set(mode=7).run(0.1)
    assert bench.drive[0x6061, 0] == 9
    assert bench.speed == pytest.approx(300_000, rel=0.02)


def test_zero_in_the_process_data_keeps_mode_and_torque_limit():
    drive = drives.kind("ElmoGold")()
    drive[0x6060, 0] = 9
    limit = drive[0x6072, 0]
    drive.receive(bytes(16))
    assert (drive[0x6060, 0], drive[0x6072, 0]) == (9, limit)
    drive.receive(bytes([0] * 10 + [0x2C, 0x01, 0x0F, 0, 3, 0]))
    assert (drive[0x6060, 0], drive[0x6072, 0], drive[0x6040, 0]) == (3, 300, 15)


# --- motor -----------------------------------------------------------------------------------


def test_current_is_what_acceleration_and_friction_need():
    """The figure of the reference experiment: a peak while accelerating, friction in cruise."""
    motor = Motor()
    data = motor.data
    motor.control = Control.VELOCITY
    ramp, cruise = 200.0, 100.0
    for i in range(500):
        motor.target = ramp * i / 1000
        motor.step(i / 1000)
    friction = data.coulomb + data.viscous * motor.speed
    expected = (data.inertia * ramp + friction) / data.torque_constant
    assert motor.current == pytest.approx(expected, rel=0.05)
    for i in range(500, 1500):
        motor.target = cruise
        motor.step(i / 1000)
    friction = data.coulomb + data.viscous * cruise
    assert motor.speed == pytest.approx(cruise, rel=1e-3)
    assert motor.current == pytest.approx(friction / data.torque_constant, rel=0.02)


def test_friction_holds_the_wheel():
    motor = Motor()
    motor.control, motor.target = Control.CURRENT, 0.9 * motor.data.coulomb
    for i in range(200):
        motor.step(i / 1000)
    assert motor.speed == 0.0
    motor.target = 1.5 * motor.data.coulomb
    for i in range(200, 400):
        motor.step(i / 1000)
    assert motor.speed > 1.0


def test_late_steps_are_made_up_for():
    """The same motion whether it is stepped each millisecond or each 20 ms."""
    ends = []
    for interval in (0.001, 0.020):
        motor = Motor()
        motor.control, motor.target = Control.VELOCITY, 50.0
        for i in range(round(0.5 / interval) + 1):
            motor.step(i * interval)
        ends.append((motor.position, motor.speed))
    assert ends[0] == pytest.approx(ends[1], rel=1e-3)


def test_supply_limits_the_speed():
    motor = Motor()
    motor.control, motor.target = Control.VELOCITY, 5000.0
    for i in range(3000):
        motor.step(i / 1000)
    assert 0 < motor.speed < motor.data.voltage / motor.data.torque_constant
    motor.target = 10.0
    for i in range(3000, 6000):
        motor.step(i / 1000)
    assert motor.speed == pytest.approx(10.0, rel=0.01), "no wind-up"


def test_noise_is_the_same_each_time():
    values = []
    for seed in (1, 1, 2):
        motor = Motor(seed=seed)
        motor.step(0.0)
        values.append(motor.measured_current)
    assert values[0] == values[1] != values[2]


# --- terminals and rigs ----------------------------------------------------------------------


def test_analog_input_scales_and_limits():
    device = EL3008([lambda now, v=v: v for v in (10.0, -10.0, 0.0, 11.0, -10.5)])
    device.step(0.0)
    values = [device[0x6000 + 16 * i, 0x11] for i in range(6)]
    assert values == [32767, -32767, 0, 32767, -32768, 0]
    assert [device[0x6000 + 16 * i, 0x02] for i in range(5)] == [0, 0, 0, 1, 0]
    assert [device[0x6000 + 16 * i, 0x01] for i in range(5)] == [0, 0, 0, 0, 1]
    toggles = []
    for _ in range(3):
        toggles.append(device[0x6000, 0x10])
        device.step(0.0)
    assert toggles == [1, 0, 1]
    assert device.give()[2:4] == (32767).to_bytes(2, "little")


def test_wires_and_blinking_inputs_of_troll():
    troll = rigs.make("troll")
    inputs, outputs = troll.devices[2], troll.devices[3]
    outputs.receive(b"\xf5")
    for plant in troll.plants:
        plant(0.0)
    assert inputs.give()[0] == 0xF5, "5 to 8 are on at time 0"
    for plant in troll.plants:
        plant(0.06)
    assert inputs.give()[0] == 0x75, "10 Hz is off"


def test_terminals_return_the_outputs_before_them():
    devices = rigs.make("terminals:70").devices
    assert [device.order for device in devices[:5]] == [*("EK1100", *("EL2008", "EL1018") * 2)]
    assert [place for place, device in enumerate(devices) if device.order == "EK1100"] == [
        0,
        32,
        64,
    ]
    for place, device in enumerate(devices):
        if device.order == "EL2008":
            device.receive(bytes([place]))
    for place, device in enumerate(devices):
        if device.order == "EL1018":
            assert device.give() == bytes([place - 1])


def test_rig_names():
    assert len(rigs.make("line:3").devices) == 3
    assert rigs.make("empty").devices == []
    assert [name for name, _ in rigs.library()] == [
        *("troll", "troll-can", "two-axes", "line:N", "terminals:N", "branches", "empty"),
    ]
    for wrong in ("line:", "line:x", "line:100000"):
        with pytest.raises(UsageError, match=naming(wrong, 1, 1024)):
            rigs.make(wrong)
    for wrong, hint in (("trol", "'troll'"), ("", "`ecatsim rigs`")):
        with pytest.raises(UsageError, match=naming(f"'{wrong}'", hint)):
            rigs.make(wrong)
    for wrong in ("line:0", "line:1025", "terminals:0", "terminals:1025", "terminals:x"):
        with pytest.raises(UsageError, match=naming(wrong, 1, 1024)):
            rigs.make(wrong)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = 1\n", "rig.py: | define | rig()"),
        ("def rig():\n    return 5\n", "rig.py: | return | ecatsim.rig.Rig"),
        ("\ndef rig(:\n", "rig.py:2: SyntaxError"),
        ("def rig():\n\n    return 1 / 0\n", "rig.py:3: ZeroDivisionError"),
        ("import nonsense_module\n", "rig.py:1: ModuleNotFoundError"),
        ("import sys\nsys.exit(3)\n", "rig.py:2: SystemExit: 3"),
    ],
)
@pytest.mark.parametrize("relative", [False, True])
def test_wrong_rig_files(tmp_path, monkeypatch, text, message, relative):
    file = tmp_path / "rig.py"
    file.write_text(text)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match=naming(*message.split(" | "))):
        rigs.make("rig.py" if relative else str(file))


def test_what_is_no_rig_says_how_to_use_it(tmp_path):
    for name, key in (("x.bin", "sii"), ("x.xml", "esi")):
        (tmp_path / name).touch()
        with pytest.raises(UsageError, match=naming("[[slave]]", f'{key} = "{name}"')):
            rigs.make(str(tmp_path / name))


def test_devices_of_a_rig_are_devices_and_differ():
    device = make("EL1008")
    with pytest.raises(UsageError, match=naming(0, 2, "same")):
        Simulation(Rig("twice", [device, make("EL1008"), device]))
    with pytest.raises(UsageError, match=naming("slave 1", "device", "class")):
        Simulation(Rig("class", [device, Device]))


def test_missing_rig_file():
    with pytest.raises(ConfigError, match=naming("no rig file", "'gone.py'")):
        rigs.make("gone.py")


def test_unknown_type_in_a_pdo_is_said():
    class Odd(Device):
        tx_pdos = (Pdo(0x1A00, "", 0, [Entry(0x6000, 1, "x", 0x7777, 8)]),)

    with pytest.raises(UsageError, match=naming("0x6000:01", "0x7777")):
        Odd()


def test_float_scale_of_the_encoder():
    drive = drives.kind("ElmoGold")()
    drive.motor.position = 2 * math.pi
    drive.step(0.0)
    assert drive[0x6064, 0] == drive[0x608F, 1]
    assert DataType(drive.dictionary[0x608F, 1].type) is DataType.UNSIGNED32


@pytest.mark.parametrize(
    ("given", "said"), [(b"\0" * 5, "5 bytes"), (None, "None"), ("ab", "'ab'")]
)
def test_inputs_of_a_wrong_size_are_an_error_with_both_sizes(given, said):
    class Odd(EL1018):
        def give(self):
            return given

    device, segment = Odd(), Segment()
    try:
        device.attach(segment, 0, 0)
        device.machine.state = AlState.SAFEOP
        with pytest.raises(UsageError, match=naming("slave 0", "give()", "Odd", said, "1")):
            device.run(0.0)
    finally:
        segment.close()

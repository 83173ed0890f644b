"""EtherCAT.Drives.CiA402 without a bus: what holds whatever a drive answers; what is refused."""

import ctypes
import math
import subprocess
from pathlib import Path
from typing import Any

import pytest
from drive_calls import (
    ABSOLUTE,
    AUTOMATIC,
    NEEDS_EDGE,
    Has,
    Mode,
    Settings,
    State,
    build,
    settings,
)
from hypothesis import given
from hypothesis import strategies as st

from conftest import names
from ecatdev import sample_buses
from ecatgen import generate

STATUS = {
    State.NOT_READY_TO_SWITCH_ON: 0x00,
    State.SWITCH_ON_DISABLED: 0x40,
    State.READY_TO_SWITCH_ON: 0x21,
    State.SWITCHED_ON: 0x23,
    State.OPERATION_ENABLED: 0x27,
    State.QUICK_STOP_ACTIVE: 0x07,
    State.FAULT_REACTION_ACTIVE: 0x0F,
    State.FAULT: 0x08,
}
POSITION_MODES = (Mode.CYCLIC_POSITION, Mode.PROFILE_POSITION)


@pytest.fixture(scope="module")
def calls(tmp_path_factory: pytest.TempPathFactory, compiler: str) -> ctypes.CDLL:
    out = tmp_path_factory.mktemp("out")
    generate(sample_buses.troll(), "Plant", out)
    return build(out, compiler, out)


class Logic:
    """A drive of no bus: what it answers is up to the test."""

    def __init__(self, calls: ctypes.CDLL, drive: Settings) -> None:
        self._calls, self._drive = calls, calls.logic_open(ctypes.byref(drive))
        self.mode = drive.mode
        self.time = 0.0
        self.position = 0
        self.word = self.target = self.state = self.enabled = 0
        self.out = (ctypes.c_int * 8)()
        self.values = (ctypes.c_double * 4)()

    def step(self, state: State, reference: float = 0.0, **inputs: int) -> None:
        """A sample in which the drive is in a state, 1 ms after the one before."""
        self.time += 0.001
        self.evaluate(state, reference, **inputs)

    def evaluate(self, state: State, reference: float = 0.0, **inputs: int) -> None:
        """The sample of the same time, perhaps again."""
        now = {
            "valid": 1,
            "status": STATUS[state],
            "display": self.mode,
            "position": self.position,
            **dict.fromkeys(("velocity", "torque", "current"), 0),
            "enable": 1,
            "quick_stop": 0,
            "fault_reset": 0,
            "losses": 0,
        }
        assert inputs.keys() <= now.keys()
        data = (ctypes.c_int * 11)(*(now | inputs).values())
        self._calls.logic_step(
            ctypes.c_void_p(self._drive),
            ctypes.c_double(self.time),
            data,
            ctypes.c_double(reference),
            self.out,
            self.values,
        )
        self.word, _, self.target, *_ = self.out
        self.state, self.enabled = self.out[6], self.out[7]

    @property
    def phi(self) -> float:
        return float(self.values[0])

    def go_into_operation(self, reference: float = 0.0) -> None:
        """The way up, until the drive follows the reference."""
        self.step(State.READY_TO_SWITCH_ON, reference)
        self.step(State.SWITCHED_ON, reference)
        for _ in range(2):
            self.step(State.OPERATION_ENABLED, reference)
        assert self.enabled


steps = st.tuples(
    st.sampled_from(list(State)),
    st.integers(-(1 << 31), (1 << 31) - 1),
    st.floats(-1e4, 1e4),
    st.booleans(),
    st.booleans(),
    st.booleans(),
    st.booleans(),
)


@given(st.sampled_from(POSITION_MODES), st.sampled_from((1, 2)), st.lists(steps, max_size=30))
def test_the_target_is_the_actual_position_unless_the_drive_follows(
    calls: ctypes.CDLL, mode: Mode, reference_kind: int, played: list[Any]
) -> None:
    """Whatever happens in whatever order; and at the first sample that is followed."""
    drive = Logic(calls, settings(mode, reference=reference_kind, max_dropout=0))
    seen = False
    followed = False
    for state, position, reference, valid, enable, quick_stop, fault_reset in played:
        drive.position = position
        drive.step(
            state,
            reference,
            valid=valid,
            enable=enable,
            quick_stop=quick_stop,
            fault_reset=fault_reset,
        )
        seen = seen or valid
        follows = bool(drive.enabled) and drive.word & 0x0F == 0x0F
        if valid and not (follows and followed):
            assert drive.target == position
        followed = follows
        assert not (drive.enabled and not (valid and state == State.OPERATION_ENABLED))
    assert drive.target == 0 or seen


@given(
    st.integers(-(1 << 31), (1 << 31) - 1),
    st.lists(st.integers(-1_000_000, 1_000_000), min_size=1, max_size=20),
)
def test_a_relative_reference_moves_the_target_by_as_much_across_overflows(
    calls: ctypes.CDLL, start: int, moves: list[int]
) -> None:
    drive = Logic(calls, settings(Mode.CYCLIC_POSITION))
    drive.position = start
    unit = 2 * math.pi / 65536
    drive.go_into_operation(7.0)
    total = 0
    for move in moves:
        total += move
        drive.step(State.OPERATION_ENABLED, 7.0 + total * unit)
        wanted = (start + total + (1 << 31)) % (1 << 32) - (1 << 31)
        assert abs(drive.target - wanted) <= 1 or abs(drive.target - wanted) >= (1 << 32) - 1
        drive.position = drive.target  # the motor has followed
        drive.step(State.OPERATION_ENABLED, 7.0 + total * unit)
        assert drive.phi == pytest.approx((start + total) * unit, abs=2 * unit)


def test_another_evaluation_of_a_time_makes_up_for_the_first(calls: ctypes.CDLL) -> None:
    once, twice = (Logic(calls, settings(Mode.PROFILE_POSITION, gear=3)) for _ in range(2))
    states = [State.SWITCHED_ON, *[State.OPERATION_ENABLED] * 20]
    for n, state in enumerate(states):
        once.step(state, 0.1 * n)
        twice.step(State.FAULT, 1e3, position=99_999, valid=n % 2, fault_reset=1, quick_stop=1)
        twice.evaluate(state, 0.1 * n)
        assert list(once.out) == list(twice.out)
        assert list(once.values) == list(twice.values)


def test_the_mode_is_changed_only_outside_of_operation(calls: ctypes.CDLL) -> None:
    drive = Logic(calls, settings(Mode.CYCLIC_VELOCITY))
    drive.step(State.OPERATION_ENABLED, 5.0, display=Mode.CYCLIC_POSITION)
    assert not drive.enabled
    assert (drive.word, drive.out[1]) == (0x07, Mode.CYCLIC_POSITION)
    drive.step(State.SWITCHED_ON, 5.0, display=Mode.CYCLIC_POSITION, enable=0)
    drive.step(State.SWITCHED_ON, 5.0, display=Mode.CYCLIC_POSITION)
    assert (drive.word, drive.out[1]) == (0x07, Mode.CYCLIC_VELOCITY)
    drive.step(State.SWITCHED_ON, 5.0, display=Mode.CYCLIC_VELOCITY)
    assert drive.word == 0x0F
    drive.step(State.OPERATION_ENABLED, 5.0)
    assert drive.enabled


def test_a_drive_without_a_velocity_measures_the_change_of_its_position(
    calls: ctypes.CDLL,
) -> None:
    entries = Has.MODE_DISPLAY | Has.POSITION | Has.CURRENT
    drive = Logic(calls, settings(Mode.CYCLIC_POSITION, entries=entries, gear=2))
    for _ in range(3):
        drive.position += 65536
        drive.step(State.SWITCHED_ON, current=500)
    phi, w, tau, i = drive.values
    assert phi == pytest.approx(3 * math.pi)
    assert w == pytest.approx(math.pi / 0.001)
    assert (tau, i) == (pytest.approx(0.5 * 0.4 * 2), pytest.approx(2.5))


def test_velocity_in_rpm(calls: ctypes.CDLL) -> None:
    drive = Logic(calls, settings(Mode.CYCLIC_VELOCITY, velocity_scale=60, gear=10))
    drive.go_into_operation()
    drive.step(State.OPERATION_ENABLED, math.pi, velocity=300)
    assert drive.out[3] == 300
    assert drive.values[1] == pytest.approx(math.pi)


def test_targets_are_held_within_their_entries(calls: ctypes.CDLL) -> None:
    velocity = Logic(calls, settings(Mode.CYCLIC_VELOCITY))
    velocity.go_into_operation()
    velocity.step(State.OPERATION_ENABLED, -1e9)
    assert velocity.out[3] == -2147483647
    torque = Logic(calls, settings(Mode.CYCLIC_TORQUE, max_torque=1e6))
    torque.go_into_operation()
    torque.step(State.OPERATION_ENABLED, 1e9)
    assert (torque.out[4], torque.out[5]) == (32767, 65535)


@pytest.mark.parametrize("mode", [Mode.CYCLIC_TORQUE, Mode.PROFILE_TORQUE])
def test_no_target_is_beyond_the_largest_torque(calls: ctypes.CDLL, mode: Mode) -> None:
    """Also of a drive that has no 0x6072 in its process data."""
    drive = Logic(calls, settings(mode, max_torque=0.1, gear=-2))
    drive.go_into_operation()
    for reference, target in ((0.1, -125), (0.2, -250), (0.5, -250), (-0.5, 250), (0.0, 0)):
        drive.step(State.OPERATION_ENABLED, reference)
        assert drive.out[4] == target


def test_a_short_quick_stop_is_not_lost(calls: ctypes.CDLL) -> None:
    """The status word is some cycles behind, and a frame may be lost."""
    drive = Logic(calls, settings(Mode.CYCLIC_VELOCITY))
    drive.go_into_operation(5.0)
    drive.step(State.OPERATION_ENABLED, 5.0, quick_stop=1)
    for _ in range(3):
        drive.step(State.OPERATION_ENABLED, 5.0)
        assert (drive.word, drive.enabled) == (0x02, 0)
    drive.step(State.QUICK_STOP_ACTIVE, 5.0, velocity=65536)
    assert drive.word == 0x02
    drive.step(State.QUICK_STOP_ACTIVE, 5.0)
    assert drive.word == 0x00
    drive.step(State.SWITCH_ON_DISABLED, 5.0)
    assert drive.word == 0x06
    drive.step(State.READY_TO_SWITCH_ON, 5.0)
    assert drive.word == 0x06, "it waits for an edge of enable"
    drive.step(State.READY_TO_SWITCH_ON, 5.0, enable=0)
    drive.go_into_operation(5.0)


def fails(drive: Logic, loss: str) -> None:
    """What takes a drive in operation away from the model."""
    if loss == "lost":
        drive.step(State.OPERATION_ENABLED, 20.0, valid=0)
    elif loss == "fault":
        drive.step(State.FAULT_REACTION_ACTIVE, 20.0)
        drive.step(State.FAULT, 20.0)
    else:
        drive.step(State.SWITCH_ON_DISABLED, 20.0)


@pytest.mark.parametrize("loss", ["lost", "fault", "left its operation by itself"])
def test_after_a_loss_or_a_fault_the_drive_waits_for_an_edge_of_enable(
    calls: ctypes.CDLL, loss: str, capfd: pytest.CaptureFixture[str]
) -> None:
    drive = Logic(calls, settings(Mode.CYCLIC_VELOCITY, max_dropout=0))
    drive.go_into_operation(20.0)
    fails(drive, loss)
    for state in (State.SWITCH_ON_DISABLED, *[State.READY_TO_SWITCH_ON] * 3, State.SWITCHED_ON):
        drive.step(state, 20.0)
        assert (drive.word, drive.enabled, drive.out[3]) == (0x06, 0, 0)
    names(said := capfd.readouterr().err, "slave 0", "off", "enable", loss, "restart", "Automatic")
    assert said.count("\n") == 1
    drive.step(State.READY_TO_SWITCH_ON, 20.0, enable=0)
    drive.evaluate(State.READY_TO_SWITCH_ON, 20.0)  # a tool that has been wrong about enable
    drive.evaluate(State.READY_TO_SWITCH_ON, 20.0, enable=0)
    drive.go_into_operation(20.0)
    assert drive.word == 0x0F
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("loss", ["lost", "fault", "left its operation by itself"])
def test_a_drive_restarts_by_itself_only_if_it_is_to(calls: ctypes.CDLL, loss: str) -> None:
    drive = Logic(calls, settings(Mode.CYCLIC_VELOCITY, max_dropout=0, restart=AUTOMATIC))
    drive.go_into_operation(20.0)
    fails(drive, loss)
    drive.go_into_operation(20.0)
    assert drive.word == 0x0F


def begins(drive: Logic, event: str) -> None:
    """Brings about an event of the table, with `enable` true all the time."""
    if event == "off at the start":
        drive.step(State.SWITCH_ON_DISABLED)
    elif event == "fault at the start":
        drive.step(State.FAULT, fault_reset=1)
        drive.step(State.SWITCH_ON_DISABLED)  # somebody has reset it
    elif event == "in operation at the start":
        drive.step(State.OPERATION_ENABLED)
        drive.step(State.READY_TO_SWITCH_ON)
    else:
        drive.go_into_operation()
    if event == "quick stop":
        drive.step(State.OPERATION_ENABLED, quick_stop=1)
        drive.step(State.SWITCH_ON_DISABLED)
    elif event == "bus":
        drive.step(State.OPERATION_ENABLED, valid=0)
    elif event == "lease or daemon":
        drive.step(State.OPERATION_ENABLED, losses=1)
    elif event == "fault":
        drive.step(State.FAULT)
        drive.step(State.SWITCH_ON_DISABLED)
    elif event == "by itself":
        drive.step(State.SWITCH_ON_DISABLED)


@pytest.mark.parametrize("restart", [AUTOMATIC, NEEDS_EDGE])
@pytest.mark.parametrize(
    "event",
    [
        *("off at the start", "fault at the start", "in operation at the start"),
        *("fault", "quick stop", "bus", "lease or daemon", "by itself"),
    ],
)
def test_the_table_of_events_and_policies(calls: ctypes.CDLL, event: str, restart: int) -> None:
    """Of docs/modelica-drives.md: what happens while `enable` stays true."""
    drive = Logic(calls, settings(Mode.CYCLIC_VELOCITY, max_dropout=0, restart=restart))
    begins(drive, event)
    losses = int(event == "lease or daemon")
    words = []
    for _ in range(3):
        drive.step(State.READY_TO_SWITCH_ON, losses=losses)
        words.append(drive.word)
    starts = restart == AUTOMATIC or event == "off at the start"
    assert words[-1] == (0x07 if starts else 0x06)
    drive.step(State.READY_TO_SWITCH_ON, enable=0, losses=losses)
    drive.step(State.READY_TO_SWITCH_ON, losses=losses)
    assert drive.word == 0x07, "an edge starts it in any case"


def test_the_edge_that_resets_a_fault_enables_the_drive(calls: ctypes.CDLL) -> None:
    """As without an input of its own for the reset; what is true from the start on is no edge."""
    drive = Logic(calls, settings(Mode.CYCLIC_VELOCITY))
    drive.step(State.FAULT, enable=1, fault_reset=1)
    assert drive.word == 0
    for enable in (0, 1, 0, 1):
        drive.step(State.FAULT, enable=enable, fault_reset=enable)
        assert drive.word == (0x80 if enable else 0)
        if enable:
            drive.go_into_operation()
            drive.step(State.FAULT)
            assert drive.word == 0


def test_the_absolute_reference_is_followed_without_limit_once_it_is_reached(
    calls: ctypes.CDLL,
) -> None:
    drive = Logic(
        calls, settings(Mode.CYCLIC_POSITION, reference=ABSOLUTE, approach_speed=2 * math.pi)
    )
    drive.position = 200
    drive.go_into_operation()
    targets = []
    for _ in range(6):  # the first step of the way was made when it went into operation
        drive.step(State.OPERATION_ENABLED, 0.0)
        targets.append(drive.target)
    assert targets == pytest.approx([69, 3, 0, 0, 0, 0], abs=1)  # 65.5 increments in 1 ms
    drive.step(State.OPERATION_ENABLED, math.pi)
    assert drive.target == 32768


REFUSED = {
    "mode must be": "s.mode = 6",
    "encoderResolution must be positive": "s.encoder = 0",
    "gearRatio must not be 0": "s.gear = 0",
    "velocityScale must be positive": "s.velocity_scale = -1",
    "ratedTorque must be positive": "s.rated_torque = 0",
    "ratedCurrent must be positive": "s.rated_current = s.encoder / 0.0 - s.encoder / 0.0",
    "tau_max must not be negative": "s.max_torque = -1",
    "approachSpeed must be positive": "s.approach_speed = 0",
    "standstillSpeed must not be negative": "s.standstill_speed = -1",
    "maxDropout must not be negative": "s.max_dropout = s.encoder / 0.0 - s.encoder / 0.0",
    "restart must be Automatic or Edge": "s.restart = 0",
    "axis must be 1 to 8": "s.axis = 9",
    "needs the actual position 0x6064": "s.mode = 8, s.entries = 1",
}

PROGRAM = """
#include "ecat_modelica.h"
int main(void) {
  static ecatm_master master;
  ecatm_drive_settings s;
  ecatm_drive_defaults(&s, ECAT_DRIVE_CYCLIC_VELOCITY, 65536);
  CHANGE;
  ecatm_drive_new(&master, 3, "", &s, NULL, 0, "");
  return 0;
}
"""


@pytest.mark.parametrize("sentence", REFUSED)
def test_parameters_that_cannot_be(calls: ctypes.CDLL, compiler: str, sentence: str) -> None:
    folder = Path(calls._name).parent
    resources = folder / "EtherCAT" / "Resources"
    program = folder / "refused"
    (archive,) = (resources / "Library").rglob("libecat.a")
    subprocess.run(
        [
            *(compiler, f"-I{resources / 'Include'}"),
            *(f"-I{resources / 'Source' / 'standalone'}", "-x", "c", "-", "-x", "none"),
            *(str(archive), "-lm", "-o", str(program)),
        ],
        input=PROGRAM.replace("CHANGE", REFUSED[sentence]),
        text=True,
        check=True,
    )
    result = subprocess.run([program], capture_output=True, text=True, check=False)
    assert result.returncode == 1
    (line,) = result.stderr.splitlines()
    names(line, "EtherCAT: ", "drive", "slave 3")
    assert sentence in line

"""The CiA 402 drive, without a bus: states, option codes, modes, limits."""

import itertools

import hypothesis.strategies as st
import pytest
from drive_bench import (
    BIT_12,
    HALT,
    IMMEDIATELY,
    LIMIT,
    REACHED,
    RELATIVE,
    TURN,
    Bench,
)
from hypothesis import given, settings

from ecatd.base.errors import SdoAbortError
from ecatsim.devices.positioning import Trapezoid
from ecatsim.plants.motor import Control

DISABLED, READY, ON, ENABLED = 0x40, 0x21, 0x23, 0x27
QUICK_STOP = 0x07
SPEED = 10 * TURN


# --- states ----------------------------------------------------------------------------------


def test_status_words_of_the_way_up_and_down():
    bench, found = Bench(), []
    for word in (0x00, 0x06, 0x07, 0x0F, 0x07, 0x06, 0x00, 0x06, 0x0F, 0x0D):
        found.append(bench.set(word=word).run(0.01).state)
    assert found == [DISABLED, READY, ON, ENABLED, ON, READY, DISABLED, READY, ENABLED, DISABLED]
    assert all(word & 0x0210 == 0x0210 for word in bench.words), "remote and voltage enabled"


def test_switch_on_with_enable_operation_at_once():
    """Transitions 3 and 4 by one control word."""
    assert Bench().set(word=0x06).run(0.001).set(word=0x0F).run(0.001).state == ENABLED


def test_switch_on_disabled_needs_shutdown_first():
    assert Bench().set(word=0x0F).run(0.005).state == DISABLED


@pytest.mark.parametrize(("code", "ramp"), [(1, 0x6084), (2, 0x6085), (3, None)])
def test_quick_stop_ends_in_switch_on_disabled(code, ramp):
    bench = Bench().enable(9).set(speed=SPEED).run(0.5)
    bench[0x605A] = code
    if ramp:
        bench[ramp] = 4 * SPEED
    start = bench.now
    bench.set(word=0x0B).run(0.001)
    assert bench.state == QUICK_STOP
    bench.until(lambda b: b.state == DISABLED)
    if ramp:
        assert bench.now - start == pytest.approx(0.25, abs=0.05)
    assert abs(bench.speed) < 0.1 * TURN
    assert bench.drive.motor.control is Control.OFF


def test_quick_stop_option_0_switches_off_at_once():
    bench = Bench().enable(9).set(speed=SPEED).run(0.5)
    bench[0x605A] = 0
    assert bench.set(word=0x0B).run(0.002).state == DISABLED
    assert bench.speed > 0.9 * SPEED, "it runs out"


@pytest.mark.parametrize("code", [5, 6, 7])
def test_quick_stop_options_that_stay_in_quick_stop_active(code):
    bench = Bench().enable(9).set(speed=SPEED).run(0.5)
    bench[0x605A] = code
    bench.set(word=0x0B).run(2.0)
    assert bench.state == QUICK_STOP
    assert bench.speed == 0
    assert bench.drive.motor.control is Control.VELOCITY, "it is held"
    assert bench.set(word=0x0F).run(0.3).state == ENABLED, "transition 16"
    assert bench.speed == pytest.approx(SPEED, rel=0.01)


def test_option_codes_are_checked():
    bench = Bench()
    for index, wrong in ((0x605A, 4), (0x605A, 8), (0x605D, 0), (0x6060, 7)):
        with pytest.raises(SdoAbortError):
            bench.drive.dictionary[index, 0].write(wrong.to_bytes(1 + (index < 0x6060), "little"))


@pytest.mark.parametrize(("index", "word", "end"), [(0x605B, 0x06, READY), (0x605C, 0x07, ON)])
def test_shutdown_and_disable_operation_options(index, word, end):
    """0 switches off at once, 1 stops along the slow down ramp before the state changes."""
    for code in (0, 1):
        bench = Bench().enable(9).set(speed=SPEED).run(0.5)
        bench[index], bench[0x6084] = code, 4 * SPEED
        bench.set(word=word).run(0.1)
        assert bench.state == (ENABLED if code else end)
        assert bench.speed == pytest.approx((0.6 if code else 0.75) * SPEED, rel=0.1)
        bench.until(lambda b: b.state == end)
        assert bool(abs(bench.speed) < 0.1 * TURN) == bool(code)


@pytest.mark.parametrize(("code", "seconds"), [(1, 0.5), (2, 0.25), (3, 0.05)])
def test_halt_option_codes(code, seconds):
    bench = Bench().enable(3).set(speed=SPEED).run(1.0)
    bench[0x605D], bench[0x6084], bench[0x6085] = code, 2 * SPEED, 4 * SPEED
    start = bench.now
    bench.set(word=0x0F | HALT).until(lambda b: abs(b.speed) < 2000)
    assert bench.now - start == pytest.approx(seconds, abs=0.1)
    assert bench.run(0.3).status & (REACHED | BIT_12) == REACHED | BIT_12, "speed is 0"
    bench.set(word=0x0F).run(1.5)
    assert bench.speed == pytest.approx(SPEED, rel=0.01)


# --- velocity and torque ---------------------------------------------------------------------


def test_profile_velocity_is_limited_by_the_maximum():
    bench = Bench().enable(3).set(speed=SPEED)
    bench[0x607F] = SPEED // 2
    assert bench.run(1.0).speed == pytest.approx(SPEED // 2, rel=0.01)
    assert bench.status & REACHED


def test_velocity_window_time():
    bench = Bench()
    bench[0x606E] = 200
    bench.enable(3).set(speed=SPEED).until(lambda b: b.speed > 0.995 * SPEED)
    assert not bench.run(0.1).status & REACHED
    assert bench.run(0.3).status & REACHED


def test_profile_torque_reports_target_reached():
    bench = Bench()
    bench[0x6087] = 1000
    bench.enable(4).set(torque=300).run(0.15)
    assert not bench.status & REACHED
    assert bench[0x6074] == pytest.approx(150, abs=10)
    assert bench.run(0.3).status & REACHED


def test_cyclic_modes_add_the_offsets():
    bench = Bench().enable(9).set(speed=SPEED)
    bench[0x60B1] = SPEED
    assert bench.run(0.5).speed == pytest.approx(2 * SPEED, rel=0.01)
    bench = Bench().enable(10).set(torque=200)
    bench[0x60B2] = -50
    assert bench.run(0.05)[0x6074] == 150
    bench = Bench().enable(8).set(position=100)
    bench[0x60B0] = 400
    assert bench.run(0.5)[0x6062] == 500


@pytest.mark.parametrize("mode", [8, 9, 10])
def test_bit_12_of_the_cyclic_modes_says_that_the_drive_follows(mode):
    bench = Bench().enable(mode).run(0.01)
    assert bench.status & BIT_12
    assert not bench.set(word=0x0F | HALT).run(0.01).status & BIT_12


# --- position --------------------------------------------------------------------------------


def profile(bench, *, velocity=SPEED, acceleration=100 * TURN):
    bench[0x6081] = velocity
    bench[0x6083] = bench[0x6084] = acceleration
    return bench.enable(1)


def test_profile_position_moves_along_a_trapezoid():
    bench = profile(Bench()).set(position=5 * TURN, word=0x1F)
    fastest, start = 0, bench.now
    while not bench.run(0.001).status & REACHED:
        fastest = max(fastest, bench.speed)
        assert bench.now < 5
    assert fastest == pytest.approx(SPEED, rel=0.1)
    assert bench.now - start == pytest.approx(5 / 10 + 10 / 100, abs=0.15)
    bench.run(0.5)
    assert bench.position == pytest.approx(5 * TURN, abs=200)
    assert bench[0x6062] == 5 * TURN, "demand is the target exactly"


def test_one_set_point_may_wait():
    """Bit 12 stays until the waiting set-point is taken."""
    bench = profile(Bench()).set(position=3 * TURN, word=0x1F).run(0.01)
    assert bench.status & BIT_12
    assert not bench.set(word=0x0F).run(0.01).status & BIT_12, "ready for another"
    bench.set(position=TURN, word=0x1F).run(0.01)
    bench.set(word=0x0F).run(0.01)
    assert bench.status & BIT_12, "the buffer is full"
    bench.until(lambda b: not b.status & BIT_12)
    assert bench[0x6062] == pytest.approx(3 * TURN, abs=TURN / 10), "the first one was finished"
    bench.until(lambda b: b.status & REACHED).run(0.3)
    assert bench.position == pytest.approx(TURN, abs=300)


def test_change_set_immediately():
    bench = profile(Bench()).set(position=9 * TURN, word=0x1F).run(0.3)
    bench.set(word=0x0F).run(0.002)
    bench.set(position=-TURN, word=0x1F | IMMEDIATELY).run(0.002)
    highest = bench.position
    while not bench.run(0.001).status & REACHED:
        highest = max(highest, bench.position)
        assert bench.now < 5
    assert highest < 5 * TURN
    assert bench.run(0.3).position == pytest.approx(-TURN, abs=300)


def test_a_nearer_target_on_the_way_is_reached_without_a_jump():
    bench = profile(Bench()).set(position=9 * TURN, word=0x1F).run(0.3)
    bench.set(word=0x0F).run(0.002)
    bench.set(position=bench.position + 1000, word=0x1F | IMMEDIATELY)
    demand, speed = bench[0x6062], SPEED / 1000
    for _ in range(1500):
        bench.run(0.001)
        step, demand = bench[0x6062] - demand, bench[0x6062]
        assert abs(step - speed) < 0.3 * TURN / 1000 * 10, "the demand has no jump in speed"
        speed = step
    assert bench.status & REACHED


def test_relative_set_points_add_up():
    bench = profile(Bench())
    for _ in range(2):
        bench.set(position=TURN, word=0x1F | RELATIVE).run(0.01)
        bench.set(word=0x0F).run(1.0)
    assert bench.position == pytest.approx(2 * TURN, abs=300)


def test_halt_interrupts_a_positioning_and_the_set_point_stays():
    bench = profile(Bench()).set(position=9 * TURN, word=0x1F).run(0.3)
    bench.set(word=0x1F | HALT).run(1.0)
    assert bench.speed == 0
    assert bench.position < 7 * TURN
    bench.set(word=0x1F).run(2.0)
    assert bench.position == pytest.approx(9 * TURN, abs=300)


def test_position_window_time():
    bench = Bench()
    bench[0x6068] = 300
    profile(bench).set(position=TURN, word=0x1F)
    bench.until(lambda b: abs(b.position - TURN) <= b[0x6067])
    assert not bench.run(0.1).status & REACHED
    assert bench.until(lambda b: b.status & REACHED, 1.0)


def test_interpolation_between_the_targets_of_a_slow_master():
    """0x60C2: 10 ms between targets; the demand moves on in each cycle of the drive."""
    bench = Bench()
    bench[0x60C2, 1], bench[0x60C2, 2] = 10, -3
    bench.enable(8)
    demands = []
    for i in range(1, 21):
        bench.set(position=1000 * i)
        for _ in range(10):
            demands.append(bench.run(0.001)[0x6062])
    steps = [b - a for a, b in itertools.pairwise(demands[20:])]
    assert all(step == pytest.approx(100, abs=2) for step in steps)


def test_software_position_limits():
    bench = Bench()
    bench[0x607D, 1], bench[0x607D, 2] = -2 * TURN, 3 * TURN
    profile(bench).set(position=9 * TURN, word=0x1F).run(2.0)
    assert bench.position == pytest.approx(3 * TURN, abs=300)
    assert bench.status & LIMIT
    bench.set(word=0x0F, mode=9, speed=-SPEED).run(2.0)
    assert bench.position == pytest.approx(-2 * TURN, abs=TURN / 2)
    assert bench.status & LIMIT
    assert bench.speed == 0
    bench.set(speed=SPEED // 10).run(0.5)
    assert bench.speed == pytest.approx(SPEED // 10, rel=0.05), "the way back is free"
    assert not bench.status & LIMIT


def test_limit_switches_hold_the_axis_and_show_in_the_digital_inputs():
    bench = Bench(travel=2.0)
    assert bench[0x60FD] == 0x4, "at the home switch"
    bench.enable(9).set(speed=TURN).run(3.0)
    assert bench[0x60FD] == 0x2
    assert bench.status & LIMIT
    assert bench.position == pytest.approx(2 * TURN, abs=TURN / 10)
    bench.set(speed=-TURN).run(5.0)
    assert bench[0x60FD] == 0x1
    assert bench.position == pytest.approx(-2 * TURN, abs=TURN / 10)


@settings(max_examples=60)
@given(
    target=st.floats(-1e5, 1e5),
    speed=st.floats(-5e4, 5e4),
    velocity=st.floats(1e4, 1e6),
    acceleration=st.floats(1e4, 1e7),
    deceleration=st.floats(1e4, 1e7),
    dt=st.sampled_from((0.0005, 0.001, 0.003)),
)
def test_a_trapezoid_keeps_its_limits_and_ends_at_its_target(
    target, speed, velocity, acceleration, deceleration, dt
):
    motion = Trapezoid(0.0, speed)
    change = max(acceleration, deceleration) * dt * 1.001
    for _ in range(int(60 / dt)):  # seconds
        before = motion.speed
        motion.step(target, velocity, acceleration, deceleration, dt)
        if (motion.position, motion.speed) == (target, 0.0):
            break
        assert abs(motion.speed - before) <= change
        assert abs(motion.speed) <= max(velocity, abs(before)) * 1.001
    else:
        raise AssertionError(f"at {motion.position} after 60 s")


def test_disable_operation_taken_back_while_the_motor_slows_down():
    bench = Bench()
    bench[0x6083] = bench[0x6084] = 4 * SPEED
    bench.enable(3).set(speed=SPEED).run(0.6)
    bench.set(word=0x07).run(0.1)
    slow = bench.speed
    assert slow == pytest.approx(0.6 * SPEED, rel=0.1)
    bench.set(word=0x0F).run(0.002)
    assert bench[0x606B] == pytest.approx(slow, rel=0.1), "the ramp goes on from there"
    assert bench.run(0.5).speed == pytest.approx(SPEED, rel=0.02)

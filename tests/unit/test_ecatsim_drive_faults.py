"""Faults of the CiA 402 drive, without a bus: causes, reactions, emergencies, reset."""

import pytest
from drive_bench import BIT_13, TURN, Bench

from ecatsim.plants.motor import Control

DISABLED, ENABLED, REACTION, FAULT = 0x40, 0x27, 0x0F, 0x08
SPEED = 10 * TURN


def test_following_error_is_a_fault_after_its_time():
    bench = Bench()
    bench[0x6065], bench[0x6066] = 2000, 50
    bench.enable(8).run(0.1)
    bench.drive.motor.current_limit = 0.0
    bench[0x6072] = 0  # no torque: it cannot follow
    bench.set(position=20000).run(0.03)
    assert bench.state == ENABLED
    assert bench[0x60F4] == pytest.approx(20000, abs=100)
    assert not bench.status & BIT_13
    bench.run(0.1)
    assert bench.state == FAULT
    assert bench[0x603F] == 0x8611
    assert bench[0x1001] == 0x21, "generic, and of the device profile"


def test_following_error_may_be_a_bit_only():
    bench = Bench()
    bench[0x6065], bench[0x6066], bench[0x2000] = 2000, 20, 0
    bench.enable(8).run(0.1)
    bench[0x6072] = 0
    bench.set(position=20000).run(0.2)
    assert bench.state == ENABLED
    assert bench.status & BIT_13
    bench[0x6072] = 2000
    assert not bench.run(0.5).status & BIT_13


@pytest.mark.parametrize(("code", "stops"), [(0, False), (1, True), (2, True), (3, True)])
def test_fault_reaction_option_codes(code, stops):
    bench = Bench().enable(9).set(speed=SPEED).run(0.5)
    bench[0x605E] = code
    bench.drive.fault(0x8611)
    bench.run(0.001)
    assert bench.state == (REACTION if stops else FAULT)
    bench.until(lambda b: b.state == FAULT)
    assert (abs(bench.speed) < 0.1 * TURN) == stops
    assert bench.drive.motor.control is Control.OFF


def test_fault_reset_needs_an_edge():
    bench = Bench().enable(9)
    bench.drive.fault(0x8611)
    assert bench.set(word=0x00).run(0.5).state == FAULT
    assert bench.set(word=0x80).run(0.01).state == DISABLED
    assert (bench[0x603F], bench[0x1001]) == (0, 0)
    bench.drive.fault(0x8611)
    assert bench.run(0.01).state == FAULT, "bit 7 is still set: no edge"
    bench.set(word=0x00).run(0.01)
    assert bench.set(word=0x80).run(0.01).state == DISABLED


def test_a_broken_encoder_cannot_be_reset():
    bench = Bench().enable(9).set(speed=SPEED).run(0.5)
    bench.drive.break_encoder()
    frozen = bench.run(0.01).position
    assert bench.state == FAULT, "without feedback the motor cannot be stopped"
    assert bench[0x603F] == 0x7305
    for word in (0x00, 0x80, 0x00, 0x80):
        assert bench.set(word=word).run(0.01).state == FAULT
    assert bench.position == frozen
    bench.drive.break_encoder(False)
    for word in (0x00, 0x80):
        bench.set(word=word).run(0.01)
    assert bench.state == DISABLED
    assert bench.position > frozen, "the motor ran out meanwhile"


def test_a_fault_sends_an_emergency_and_its_reset_another():
    bench = Bench().enable(9)
    sent = []
    bench.drive.emergency = lambda code, register, data=b"": sent.append((code, register))
    bench.drive.fault(0x8611)
    bench.drive.fault(0x8611)
    bench.run(0.5).set(word=0x80).run(0.01)
    assert sent == [(0x8611, 0x21), (0, 0)]


def test_reset_is_a_power_cycle_and_the_motor_turns_on():
    bench = Bench().enable(9).set(speed=SPEED).run(0.5)
    bench[0x6083] = 1
    bench.drive.reset()
    bench.run(0.01)
    assert bench.state == DISABLED
    assert (bench[0x6060], bench[0x6083] > 1) == (0, True)
    assert bench.speed > 0.8 * SPEED
    assert abs(bench.enable(1).run(1.0).speed) < 200

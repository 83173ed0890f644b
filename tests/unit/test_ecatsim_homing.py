"""Homing of the CiA 402 drive: methods, and the bits 10, 12 and 13 of the status word."""

import pytest
from drive_bench import BIT_12, BIT_13, HALT, REACHED, TURN, Bench

IN_PROGRESS, ATTAINED, DONE = 0, BIT_12, BIT_12 | REACHED
INTERRUPTED, FAILED = REACHED, BIT_13 | REACHED
MASK = REACHED | BIT_12 | BIT_13
TRAVEL = 5.25


def homing(method, *, travel=TRAVEL, start=0.3, offset=0):
    """A drive in mode 6 that has stood at `start` revolutions when it is enabled."""
    bench = Bench(travel=travel)
    bench.drive.motor.position = start * 2 * 3.141592653589793
    bench[0x6098], bench[0x607C] = method, offset
    return bench.enable(6)


@pytest.mark.parametrize(
    ("method", "reference"),
    [
        (1, -5.0),  # first index pulse inside the negative limit switch
        (2, 5.0),
        (17, -TRAVEL),
        (18, TRAVEL),
        (33, 0.0),
        (34, 1.0),
        (35, 0.3),
        (37, 0.3),
    ],
)
@pytest.mark.parametrize("offset", [0, -12345])
def test_methods_find_their_reference(method, reference, offset):
    """The position is the home offset at the reference."""
    bench = homing(method, offset=offset)
    bench.set(word=0x1F).until(lambda b: b.status & MASK == DONE, 20.0).run(0.2)
    machine = bench.drive.axis.machine
    assert bench.position - offset == pytest.approx(machine - reference * TURN, abs=1.5)
    assert abs(bench.speed) <= 200


@pytest.mark.parametrize("method", [1, 17, 33])
def test_status_bits_in_their_order(method):
    bench = homing(method)
    assert bench.run(0.1).status & MASK == INTERRUPTED, "not started"
    bench.words.clear()
    bench.set(word=0x1F).until(lambda b: b.status & MASK == DONE, 20.0).run(0.5)
    order = [bench.words[0] & MASK]
    for word in bench.words:
        if word & MASK != order[-1]:
            order.append(word & MASK)
    assert order == [IN_PROGRESS, ATTAINED, DONE]


@pytest.mark.parametrize(("method", "reference"), [(1, -5.0), (17, -TRAVEL), (18, TRAVEL)])
def test_a_search_that_begins_on_its_limit_switch(method, reference):
    start = 6.4 if reference > 0 else -6.4
    bench = homing(method, start=start)
    bench.set(word=0x1F).until(lambda b: b.status & MASK == DONE, 20.0).run(0.2)
    assert bench.position == pytest.approx(bench.drive.axis.machine - reference * TURN, abs=1.5)


def test_speeds_of_the_two_searches():
    bench = homing(17)
    bench[0x6099, 1], bench[0x6099, 2] = 3 * TURN, TURN // 2
    bench.set(word=0x1F).run(1.0)
    assert bench.speed == pytest.approx(-3 * TURN, rel=0.02)
    fastest_back = 0
    while bench.status & MASK != DONE:
        fastest_back = max(fastest_back, bench.run(0.001).speed)
        assert bench.now < 20
    assert fastest_back == pytest.approx(TURN // 2, rel=0.2)


@pytest.mark.parametrize("method", [1, 2, 17, 18])
def test_a_limit_switch_that_does_not_exist_is_a_homing_error(method):
    bench = homing(method, travel=0.0)
    assert bench.set(word=0x1F).run(0.1).status & MASK == FAILED
    bench.set(word=0x0F).run(0.01)
    bench[0x6098] = 37
    assert bench.set(word=0x1F).run(0.1).status & MASK == DONE, "the next start is a new one"


def test_clearing_bit_4_interrupts():
    bench = homing(1)
    bench.set(word=0x1F).run(0.5)
    assert bench.status & MASK == IN_PROGRESS
    bench.set(word=0x0F).run(1.0)
    assert bench.status & MASK == INTERRUPTED
    assert abs(bench.speed) <= 200


def test_halt_interrupts():
    bench = homing(1)
    bench.set(word=0x1F).run(0.5)
    bench.set(word=0x1F | HALT).run(1.0)
    assert bench.status & MASK == INTERRUPTED
    bench.set(word=0x0F).run(0.01)
    bench.set(word=0x1F).until(lambda b: b.status & MASK == DONE, 20.0)


def test_positions_after_homing_count_from_the_reference():
    bench = homing(34, offset=TURN)
    bench.set(word=0x1F).until(lambda b: b.status & MASK == DONE)
    bench.set(word=0x0F, mode=1, position=0).run(0.01)
    bench.set(word=0x1F).run(2.0)
    assert bench.position == pytest.approx(0, abs=300)
    assert bench.drive.axis.machine == pytest.approx(0, abs=300)

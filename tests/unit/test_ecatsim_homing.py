"""Homing of the CiA 402 drive: methods, and the bits 10, 12 and 13 of the status word."""

import pytest
from drive_bench import BIT_12, BIT_13, HALT, LIMIT, REACHED, TURN, Bench

IN_PROGRESS, ATTAINED, DONE = 0, BIT_12, BIT_12 | REACHED
INTERRUPTED, FAILED = REACHED, BIT_13 | REACHED
MASK = REACHED | BIT_12 | BIT_13
TRAVEL = 5.25


def homing(method, *, travel=TRAVEL, start=0.3, offset=0, **parameters):
    """A drive in mode 6 that has stood at `start` revolutions when it is enabled."""
    bench = Bench(travel=travel, **parameters)
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


@pytest.mark.parametrize(
    ("method", "reference"),
    [
        *((3, 1.0), (4, 2.0), (7, 1.0), (8, 2.0), (9, 2.0), (10, 3.0)),
        *((11, 3.0), (12, 2.0), (13, 2.0), (14, 1.0)),
        *((19, 1.5), (20, 1.5), (23, 1.5), (24, 1.5), (25, 2.5), (26, 2.5)),
        *((27, 2.5), (28, 2.5), (29, 1.5), (30, 1.5)),
    ],
)
@pytest.mark.parametrize("start", [0.3, 1.8])
def test_methods_with_the_home_switch(method, reference, start):
    """The switch is active from 1.5 to 2.5; the search begins beside it and on it."""
    bench = homing(method, start=start, home=2.0)
    bench.set(word=0x1F).until(lambda b: b.status & MASK == DONE, 20.0).run(0.2)
    machine = bench.drive.axis.machine
    assert bench.position == pytest.approx(machine - reference * TURN, abs=1.5)


@pytest.mark.parametrize(("method", "reference"), [(5, 3.0), (6, 2.0), (21, 2.5), (22, 2.5)])
def test_methods_with_a_home_switch_at_the_negative_end(method, reference):
    bench = homing(method, start=4.3, home=2.0)
    bench.set(word=0x1F).until(lambda b: b.status & MASK == DONE, 20.0).run(0.2)
    machine = bench.drive.axis.machine
    assert bench.position == pytest.approx(machine - reference * TURN, abs=1.5)


def test_a_limit_switch_before_the_home_switch_is_a_homing_error_or_turns_around():
    bench = homing(3, start=4.3, home=2.0)
    bench.set(word=0x1F).until(lambda b: b.status & BIT_13, 20.0)
    bench = homing(7, start=4.3, home=20.0)
    bench.set(word=0x1F).until(lambda b: b.status & BIT_13, 20.0)
    assert bench[0x60FD] & 1, "it has been to the positive end, and ended at the negative one"


@pytest.mark.parametrize("method", [0, 15, 16, 31, 32, 36, -5, 100])
def test_an_unknown_method_is_a_homing_error(method):
    bench = homing(37)
    bench.drive.dictionary[0x6098, 0].write(method.to_bytes(1, "little", signed=True))
    assert bench.set(word=0x1F).run(0.1).status & MASK == FAILED
    known = [bench[0x60E3, number + 1] for number in range(bench[0x60E3])]
    assert method not in known


@pytest.mark.parametrize(("method", "reference"), [(-1, 6.0), (-2, -6.0), (-3, 6.5), (-4, -6.5)])
def test_a_current_threshold_finds_the_mechanical_stop(method, reference):
    bench = homing(method, travel=0.0, stops=6.5, offset=700)
    assert method in [bench[0x60E3, number + 1] for number in range(bench[0x60E3])]
    assert bench[0x30B2] == 3000, "mA"
    bench.set(word=0x1F).until(lambda b: b.status & MASK == DONE, 20.0).run(0.2)
    machine = bench.drive.axis.machine
    assert bench.position == pytest.approx(machine - reference * TURN + 700, abs=1.5)
    assert abs(machine) < 6.5 * TURN + 1


def test_no_stop_is_found_while_the_current_is_below_the_threshold():
    bench = homing(-3, travel=0.0, stops=6.5)
    bench[0x30B2] = 20_000  # more than the drive can
    bench.set(word=0x1F).run(5.0)
    assert bench.drive.axis.machine == pytest.approx(6.5 * TURN, abs=1)
    assert bench.status & MASK == IN_PROGRESS
    assert bench.status & LIMIT, "it pushes with all that it has"


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

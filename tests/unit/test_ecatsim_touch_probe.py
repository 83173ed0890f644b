"""Touch probes of the CiA 402 drive: 0x60B8 to 0x60BD, at switch edges and at index pulses."""

import pytest
from drive_bench import TURN, Bench

FUNCTION, STATUS, POSITIVE, NEGATIVE = 0x60B8, 0x60B9, 0x60BA, 0x60BB
ENABLE, CONTINUOUS, INDEX, AT_POSITIVE, AT_NEGATIVE = 0x01, 0x02, 0x04, 0x10, 0x20
ENABLED, HAS_POSITIVE, HAS_NEGATIVE = 0x01, 0x02, 0x04


@pytest.fixture
def bench():
    """A drive whose home switch is active from 1.5 to 2.5 revolutions, limit switches at 5."""
    return Bench(travel=5.0, home=2.0).enable(9)


def test_edges_of_the_home_switch_are_stored_to_the_count(bench):
    bench[FUNCTION] = ENABLE | AT_POSITIVE | AT_NEGATIVE
    bench.run(0.01)
    assert bench[STATUS] == ENABLED
    bench.set(speed=7 * TURN).until(lambda b: b[STATUS] & HAS_POSITIVE)
    assert bench[POSITIVE] == 1.5 * TURN
    assert bench[STATUS] == ENABLED | HAS_POSITIVE
    bench.until(lambda b: b[STATUS] & HAS_NEGATIVE)
    assert bench[NEGATIVE] == 2.5 * TURN


def test_only_the_first_edge_counts_until_it_is_armed_again(bench):
    bench[FUNCTION] = ENABLE | AT_POSITIVE
    bench.set(speed=7 * TURN).until(lambda b: b.position > 3 * TURN)
    bench.set(speed=-7 * TURN).until(lambda b: b.position < 1 * TURN)
    assert bench[POSITIVE] == 1.5 * TURN, "and not 2.5, where it came back"
    bench[FUNCTION] = ENABLE
    assert bench.run(0.01)[STATUS] == ENABLED
    assert bench[POSITIVE] == 1.5 * TURN, "the position stays"
    bench[FUNCTION] = ENABLE | CONTINUOUS | AT_POSITIVE
    bench.set(speed=7 * TURN).until(lambda b: b.position > 3 * TURN)
    assert bench[POSITIVE] == 1.5 * TURN
    bench.set(speed=-7 * TURN).until(lambda b: b.position < 2 * TURN)
    assert bench[POSITIVE] == 2.5 * TURN, "each edge counts"
    bench[FUNCTION] = 0
    assert bench.run(0.01)[STATUS] == 0


def test_the_index_pulse_and_the_second_probe(bench):
    bench[FUNCTION] = ENABLE | INDEX | AT_POSITIVE | (ENABLE | AT_POSITIVE | AT_NEGATIVE) << 8
    bench.set(speed=TURN).until(lambda b: b[STATUS] & HAS_POSITIVE)
    assert bench[POSITIVE] == TURN
    bench.set(speed=20 * TURN).until(lambda b: b[STATUS] & HAS_POSITIVE << 8)
    assert bench[0x60BC] == 5 * TURN, "the input of the second probe is the limit switch"
    bench.set(speed=-TURN).until(lambda b: b[STATUS] & HAS_NEGATIVE << 8)
    assert bench[0x60BD] == 5 * TURN


def test_positions_count_from_the_reference():
    bench = Bench(home=2.0)
    bench.drive.motor.position = 0.3 * 2 * 3.141592653589793
    bench[0x607C] = 1000
    bench.enable(6).set(word=0x1F).run(0.2)
    bench[FUNCTION] = ENABLE | AT_POSITIVE
    bench.set(word=0x0F, mode=9, speed=5 * TURN).until(lambda b: b[STATUS] & HAS_POSITIVE)
    assert bench[POSITIVE] == pytest.approx(1.2 * TURN + 1000, abs=1)

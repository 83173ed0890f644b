"""Values of inputs that have left what they were before a trigger."""

import math
import random
from collections.abc import Callable

import pytest

from ecatd.operations.traces import TraceSignal
from ecatd.recorder.departures import Departure, find_departures
from ecatd.recorder.incident import Row

COUNT, TRIGGER = 6000, 5000
"""Cycles of 1 ms, and that of the trigger."""
Curve = Callable[[int], float | None]


def signal(
    slave: int, *, output: bool = False, kind: str = "int16", unit: str = "V"
) -> TraceSignal:
    return TraceSignal(
        name=f"{slave}/Value", slave=slave, address="0x6000:11", output=output,
        type=kind, scale=1.0 if output else 0.001, offset=0.0, unit=unit,
    )  # fmt: skip


def departures(
    value: Curve, own: Curve | None = None, other: Curve | None = None
) -> list[Departure]:
    """Those of an input of slave 5, with an output of slave 5, and one of slave 3."""
    signals = [signal(5), signal(5, output=True), signal(3, output=True)]
    curves = [value, own or (lambda _: 0), other or (lambda _: 0)]
    rows = [Row(n, n * 1_000_000, 80.0, 0, [curve(n) for curve in curves]) for n in range(COUNT)]
    return find_departures(signals, rows, TRIGGER * 1_000_000)


def noise(width: float) -> float:
    return round(random.gauss(0, width))


def drifting(n: int) -> float:
    """It is 1 V, and falls by 1 V each second from cycle 4000 on."""
    return 1000 + noise(3) - max(0, n - 4000)


def test_an_input_that_drifts_is_told() -> None:
    (found,) = departures(drifting)
    assert 4000 <= found.row <= 4100
    assert found.before == pytest.approx(1, abs=0.01)
    assert found.after == pytest.approx(-0.1, abs=0.03)
    assert found.seconds == pytest.approx(0.9, abs=0.15)


@pytest.mark.parametrize("reaction", [1, 20])
def test_a_broken_wire_is_told_although_somebody_reacts_to_it(reaction: int) -> None:
    (found,) = departures(
        lambda n: 1000 if n < TRIGGER - reaction else -8160,
        own=lambda n: n >= TRIGGER,
        other=lambda n: n >= TRIGGER,
    )
    assert found.row == TRIGGER - reaction
    assert (found.before, found.after) == (1, -8.16)
    assert found.seconds == pytest.approx(0.001)


def test_what_an_output_may_have_moved_is_not_told() -> None:
    assert not departures(drifting, own=lambda n: n >= 3990)
    assert not departures(drifting, own=lambda n: n % 100 < 50)
    assert not departures(drifting, other=lambda n: n >= 3500)
    assert departures(drifting, other=lambda n: n % 100 < 50)  # as all the time before
    assert departures(drifting, own=lambda n: n >= 2000)


def test_what_moves_as_before_or_has_come_back_is_not_told() -> None:
    for phase in range(0, 360, 30):
        for period in (20, 300, 5000, 20_000, 100_000):
            turn = math.radians(phase)

            def wave(n: int, turn: float = turn, period: int = period) -> float:
                return round(9000 * math.sin(2 * math.pi * n / period + turn)) + noise(2)

            assert not departures(wave), (phase, period)
    for curve in (
        lambda n: 2 * n,  # a ramp
        lambda n: n**2 // 5000,
        lambda n: (n - 1500) ** 2 // 5000,
        lambda n: n % 1000,
        lambda _: noise(200),
        lambda n: 1000 if n < 4000 else 1010,  # it is too little
        lambda n: 9000 if 4000 < n < 4500 else 1000,  # it has come back
        lambda n: 1000 if n < TRIGGER + 200 else -8160,  # a consequence
        lambda n: 1000 if n < 100 else None,  # its slave was away
        lambda _: None,
    ):
        assert not departures(curve)


def test_what_is_no_analog_input_is_not_told() -> None:
    rows = [Row(n, n * 1_000_000, 80.0, 0, [500 * (n > 4000)]) for n in range(COUNT)]
    plain = signal(5, unit="")
    plain["scale"] = 1.0
    assert not find_departures([plain], rows, TRIGGER * 1_000_000)
    assert not find_departures([signal(5)], rows[:60], TRIGGER * 1_000_000)
    assert not find_departures([signal(5)], [], 0)

"""How the clocks of a computer stand to each other."""

import time

import pytest

from ecatd.base.clocks import unix_minus_monotonic_ns


def test_a_pause_between_two_readings_moves_no_time(monkeypatch: pytest.MonkeyPatch) -> None:
    pauses = iter([0.05, 0.05])
    read = time.time_ns

    def late() -> int:
        now = read()
        time.sleep(next(pauses, 0.0))  # the thread loses its processor
        return now

    known = min(read() - time.monotonic_ns() for _ in range(50))
    monkeypatch.setattr(time, "time_ns", late)
    assert abs(unix_minus_monotonic_ns() - known) < 20_000_000

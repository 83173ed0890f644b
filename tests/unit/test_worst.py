"""The worst cycles, and what stood beside them."""

from dataclasses import replace
from typing import Any

from test_stats import snapshot

from ecatd.shm import contract as shm
from ecatd.shm.statistics import LongCycle, Snapshot
from ecatd.shm.statistics.maps import to_map
from ecatd.view.worst import describe_worst, find_worst

NOW = 1_800_000_000.0
S = 10**9
OLD = LongCycle(500, 20_000, 2_700_000, 2_750_000, 10 * S, 1, 4)
WORK = LongCycle(900, 0, 50_000, 9_750_000, 11 * S, 0, 0)
LATE = LongCycle(399_000, 1_300_000, 90_000, 95_000, 400 * S, 0, 0)


def bus() -> Snapshot:
    """After 410 s: long ago an exchange took long, and lately a cycle began late."""
    return replace(
        snapshot(read_ns=410 * S, start_ns=0),
        worst={"wakeup": (LATE,), "exchange": (OLD, LATE), "cycle": (WORK, OLD, LATE)},
    )


def event(seconds: float, text: str, **facts: Any) -> dict[str, Any]:
    return {"time_ns": round((NOW + seconds) * 1e9), "text": text, **facts}


def test_what_stood_beside_a_cycle() -> None:
    events = [
        event(-400.003, "a link was lost"),
        event(-398.0, "long after it"),
        event(-10.2, "outputs are safe", cycle=399_003),
        event(-10.0, "of another cycle", cycle=300_000),
    ]
    found = {worst.name: worst for worst in find_worst(bus(), events, NOW)}
    assert [*found] == [*shm.WORST]
    assert (found["exchange"].cycle, found["exchange"].took_us) == (500, 2700)
    assert found["exchange"].at == NOW - 400
    assert found["exchange"].beside == (
        "it ended too late: 2 cycles were missed",
        "1 frame did not come back in it",
        "4 frames of mailboxes or registers went beside it",
        "3 ms before: a link was lost",
    )
    assert found["cycle"].beside == ("it ended too late: 9 cycles were missed",)
    assert found["wakeup"].beside == (
        "it ended too late: 1 cycle was missed",
        "3 ms later: outputs are safe",
    )


def test_each_span_has_its_own() -> None:
    found = describe_worst(to_map(bus(), buckets=True), [], NOW)
    cycles = {span: {item["name"]: item["cycle"] for item in rows} for span, rows in found.items()}
    assert cycles["start"] == {"wakeup": 399_000, "exchange": 500, "cycle": 900}
    # The longest cycle is also the one with the longest exchange.
    assert cycles["60"] == cycles["300"] == {"wakeup": 399_000, "exchange": 399_000}
    assert find_worst(bus(), [], NOW, seconds=5) == []


def test_many_events_of_one_moment_are_counted() -> None:
    events = [event(-10 + n / 1000, f"event {n}") for n in range(9)]
    (found, *_) = find_worst(bus(), events, NOW)
    assert found.beside[1:] == (
        "at the same time: event 0",
        *(f"{n} ms later: event {n}" for n in (1, 2, 3)),
        "5 more events of that moment",
    )

"""What the watch over a bus decides and says, apart from any bus."""

import asyncio
from itertools import pairwise

import pytest

import virtual_time
from conftest import names
from ecatd.base.batch import Batch
from ecatd.description.bus import Bus, Slave
from ecatd.master.engine.engine import Event
from ecatd.server.watch.interfaces import describe_ring
from ecatd.server.watch.presence import Presence
from ecatd.server.watch.reports import Disturbance, Rise, Throttle
from ecatd.shm.contract import Ring

BUS = Bus("b", 1000, [Slave(i, f"EL{i}", 2, 3, 4) for i in range(4)])


def reports(values: list[int]) -> list[Rise | None]:
    """What is told of a counter with these values, one a second."""
    disturbance = Disturbance({"lost": 0})
    return [disturbance.look({"lost": value}, 100.0 + i) for i, value in enumerate(values)]


def test_a_counter_is_told_at_once_and_a_single_time() -> None:
    told = reports([0, 0, 3] + [3] * 20)
    assert told[2] == Rise({"lost": 3}, 1.0)
    assert [report for report in told if report] == [told[2]]


def test_a_lasting_disturbance_is_told_at_growing_intervals_and_at_its_end() -> None:
    running = [10 * i for i in range(1, 201)]
    told = reports(running + [2000] * 10)
    times = [i for i, report in enumerate(told) if report and not report.over]
    assert times == [0, 2, 6, 14, 30, 62, 122, 182]
    assert sum(report.counts["lost"] for report in told if report and not report.over) < 2000
    ends = [report for report in told if report and report.over]
    assert ends == [Rise({"lost": 2000}, 200.0, over=True)]


def test_disturbances_that_come_again_and_again_do_not_fill_the_log() -> None:
    told = [report for report in reports([i // 10 for i in range(600)]) if report]
    assert 10 < len(told) < 30


def test_events_of_every_cycle_are_told_at_a_bounded_rate() -> None:
    told: list[tuple[float, int]] = []

    async def flap() -> None:
        time = asyncio.get_running_loop().time
        begin = time()
        throttle = Throttle(
            lambda event: told.append((round(time() - begin, 3), event.value)), 0.05
        )
        for value in [5] + 500 * [0, 7] + [0]:
            throttle.note(Event(value=value))
        await asyncio.sleep(0.2)
        throttle.note(Event(value=0))  # says nothing new
        throttle.note(Event(value=3))
        throttle.note(Event(value=4))
        throttle.close()
        await asyncio.sleep(0.2)

    virtual_time.run(flap())
    assert told == [(0.0, 5), (0.05, 0), (0.2, 3)]  # the first at once, then the last one


def test_events_that_belong_together_are_told_together_and_never_flood() -> None:
    told: list[tuple[list[int], int]] = []

    async def flood() -> None:
        batch = Batch[int](lambda values, left: told.append((values, left)))
        batch.note(1)
        batch.note(2)
        await asyncio.sleep(0.01)
        assert told == [([1, 2], 0)]
        for value in range(5000):
            batch.note(value)
        await asyncio.sleep(0.02)
        assert len(told) == 1  # not now
        batch.close()

    virtual_time.run(flood())
    values, left_out = told[1]
    assert (values[-1], left_out + len(values)) == (4999, 5000)
    assert len(values) < 2000


def test_who_goes_on_is_told_less_and_less() -> None:
    calls: list[float] = []

    async def go_on(seconds: float) -> None:
        time = asyncio.get_running_loop().time
        begin = time()
        batch = Batch[int](lambda values, left: calls.append(round(time() - begin, 2)))
        while time() < begin + seconds:
            batch.note(1)
            await asyncio.sleep(0.001)
        batch.close()

    virtual_time.run(go_on(4.5))
    first = calls[0]
    pauses = [round(b - a, 2) for a, b in pairwise(calls[:-1])]
    assert first < 0.1
    assert pauses == pytest.approx([0.25, 0.5, 1.0, 2.0], abs=0.02)
    assert calls[-1] == pytest.approx(4.5, abs=0.02)  # what is left is told at the end


@pytest.mark.parametrize(
    ("found", "lost", "words"),
    [
        (4, [], ""),
        (5, [], "from 4 to 5 | added | in front"),
        (
            2,
            [2, 3],
            "from 4 to 2 | slave 2 (EL2) | behind | 2 slaves missing | cable",
        ),
        (2, [1, 2], "from 4 to 2 | slaves 1-2 | 2 slaves missing"),
        (4, [2], "slave 2 (EL2) | address | 4 slaves"),
        (0, [0, 1, 2, 3], "no slave | cable | slave 0 (EL0) | power"),
        (4, [0, 1, 2, 3], "no slave | address | 4"),
    ],
)
def test_what_is_said_of_missing_and_new_slaves(found: int, lost: list[int], words: str) -> None:
    text = Presence(BUS, found, tuple(lost)).text(lambda _: "")
    if words:
        names(text, *words.split(" | "))
    assert bool(text) == bool(words)


@pytest.mark.parametrize(
    ("first", "second", "alike"),
    [
        ((4, ()), (3, ()), True),  # optional slaves are coming: nothing is wrong
        ((2, (2, 3)), (2, (2, 3)), True),
        ((2, (2, 3)), (1, (1, 2, 3)), False),
        ((0, (0, 1, 2, 3)), (4, (0, 1, 2, 3)), False),
    ],
)
def test_the_same_is_reported_once(
    first: tuple[int, tuple[int, ...]], second: tuple[int, tuple[int, ...]], alike: bool
) -> None:
    one, other = Presence(BUS, *first), Presence(BUS, *second)
    assert one.is_like(other) == other.is_like(one) == alike
    assert (one.text(lambda _: "") == other.text(lambda _: "")) == alike


@pytest.mark.parametrize(
    ("before", "words"),
    [
        (0, "between eth1 and slave 0 (EL0):"),
        (2, "between slave 1 (EL1) and slave 2 (EL2):"),
        (4, "between slave 3 (EL3) and eth2:"),
    ],
)
def test_the_place_of_a_break_is_named(before: int, words: str) -> None:
    assert words in describe_ring(BUS, ["eth1", "eth2"], Ring.OPEN, before)
    assert describe_ring(BUS, ["eth1", "eth2"], Ring.CLOSED, before) == "the ring is closed"

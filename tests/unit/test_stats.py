"""Statistics: quantiles, intervals, the way to a map and back, and what the screens show."""

import argparse
import json
import math
import random
from contextlib import suppress
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from conftest import names, naming
from ecatd.base.errors import EcatError, StateError, UsageError
from ecatd.cli import info
from ecatd.cli.output import print_json, print_json_line
from ecatd.cli.stats import stats as stats_command
from ecatd.cli.stats_screen import histogram_lines, stats_lines
from ecatd.shm import contract as shm
from ecatd.shm.statistics.maps import from_map, histogram_to_map, interval_to_map, to_map
from ecatd.shm.statistics.problems import find_problems
from ecatd.shm.statistics.snapshot import (
    Bin,
    Clock,
    Domain,
    Grant,
    Histogram,
    LongCycle,
    Snapshot,
)

EDGE = 1 << 33  # from here on times share the last bucket
SAMPLES = st.lists(st.integers(0, 2 * EDGE), max_size=300)


def histogram(samples: list[int]) -> Histogram:
    buckets = list(Histogram().buckets)
    for ns in samples:
        buckets[shm.bucket(ns)] += 1
    return Histogram(tuple(buckets), sum(samples), min(samples, default=0), max(samples, default=0))


def snapshot(scale: int = 1, **changes: Any) -> Snapshot:
    """A bus that has everything, after `scale` times as many cycles."""
    times = {}
    for name, ns in zip(shm.TIMES, (5e3, 4e4, 4.5e4, 9e5, 300, 2e5), strict=True):
        spread = random.Random(name)  # so that longer runs begin as shorter ones
        samples = [int(spread.lognormvariate(0, 0.4) * ns) for _ in range(1000 * scale)]
        times[name] = histogram(samples)
    made = Snapshot(
        bus="ecat0",
        version="1.2.3",
        state=shm.BusState.RUNNING,
        instance=1_700_000_000_000_000_000,
        cycle_time_ns=1_000_000,
        cycle_number=1000 * scale,
        cycle_end_ns=(1 + scale) * 10**9,
        start_ns=10**9,
        read_ns=(1 + scale) * 10**9 + 500,
        slaves_expected=8,
        slaves_found=8,
        al_status=8,
        ring=shm.Ring.OPEN,
        ring_break=3,
        links=(shm.Link.UP, shm.Link.NO_CARRIER),
        clock=Clock(shm.DcState.LOCKED, 0, 10**18 + 1, -123, -12345),
        counters={item.name: (n + 1) * scale for n, item in enumerate(shm.COUNTERS)},
        delay_cycles=(0, 990 * scale, 9 * scale, scale),
        times=times,
        worst={
            name: tuple(
                LongCycle(
                    *(n * 100 * scale, 10_000 * n, 50_000 * n, 60_000 * n),
                    *(10**9 + n * scale * 10**8, n % 2, n),
                )
                for n in (3, 2)
            )
            for name in shm.WORST
        },
        domains=tuple(
            Domain(
                *(number, name, divider, divider - 1, 10, 20, 12, 12),
                *(shm.WkcState.COMPLETE, 1000 * scale),
                {
                    item.name: scale * (1000 // divider if n == 0 else n % 6)
                    for n, item in enumerate(shm.DOMAIN_COUNTERS)
                },
            )
            for number, (name, divider) in enumerate((("fast", 1), ("a" * 31, 1000)))
        ),
        grants=tuple(
            Grant(kind, wanted=True, granted=kind % 2 == 0, value=7, error=kind % 2)
            for kind in shm.Setting
        ),
    )
    return replace(made, **changes)


@given(SAMPLES, st.sampled_from([0.0, 0.5, 0.9, 0.99, 0.999, 0.9999, 1.0]))
def test_quantiles_are_those_of_the_samples(samples: list[int], q: float) -> None:
    made = histogram(samples)
    assert made.count == len(samples)
    if not samples:
        assert (made.quantile(q), made.mean_ns) == (0, 0)
        return
    exact = sorted(samples)[min(int(q * len(samples)), len(samples) - 1)]
    assert exact <= made.quantile(q) <= made.max_ns == max(samples)
    if exact < EDGE:
        assert made.quantile(q) <= exact * 33 / 32 + 1
    assert math.isclose(made.mean_ns, sum(samples) / len(samples))


def test_rare_times_are_seen_in_many_samples() -> None:
    spread = random.Random(1)
    samples = [int(spread.lognormvariate(10, 0.5)) for _ in range(200_000)]
    samples += [5_000_000 + n for n in range(30)]  # 15 of 100 000
    made = histogram(samples)
    order = sorted(samples)
    for q in (0.5, 0.9, 0.99, 0.999, 0.9999):
        exact = order[int(q * len(order))]
        assert exact <= made.quantile(q) <= exact * 33 / 32
    assert made.quantile(0.9999) >= 5_000_000 > made.quantile(0.999)
    for q in (-0.1, 1.1, math.nan):
        with pytest.raises(UsageError, match="is not a quantile"):
            made.quantile(q)


@given(SAMPLES, SAMPLES)
def test_an_interval_has_the_samples_of_the_interval(before: list[int], after: list[int]) -> None:
    interval = histogram(before + after) - histogram(before)
    alone = histogram(after)
    assert (interval.buckets, interval.sum_ns) == (alone.buckets, alone.sum_ns)
    assert interval.min_ns <= alone.min_ns
    assert alone.max_ns <= interval.max_ns
    if after:
        assert shm.bucket(interval.min_ns) == shm.bucket(alone.min_ns)
        assert shm.bucket(interval.max_ns) == shm.bucket(alone.max_ns)
    if after and (not before or (min(after) < min(before) and max(after) > max(before))):
        assert (interval.min_ns, interval.max_ns) == (alone.min_ns, alone.max_ns)
    # Exact quantiles are the same but for the largest time, which is known to its bucket only.
    assert interval.quantile(0.5) >= alone.quantile(0.5)


def test_bins_say_what_they_hold() -> None:
    made = histogram([5, 5, 1000, EDGE + 7])
    assert list(made.bins()) == [
        Bin(5, 6, 2),
        Bin(992, 1008, 1),
        Bin(shm.bound(927), EDGE + 8, 1),
    ]
    assert list(Histogram().bins()) == []


def test_a_difference_is_an_interval() -> None:
    early, late = snapshot(2), snapshot(5)
    interval = late - early
    assert interval.seconds == 3
    assert interval.counters == snapshot(3).counters
    assert interval.delay_cycles == snapshot(3).delay_cycles
    assert [d.counters["exchanges"] for d in interval.domains] == [3000, 3]
    assert interval.times["exchange"].count == 3000
    assert (interval.clock, interval.domains[0].wkc) == (late.clock, 12)  # as at the end
    assert (late - late).counters["cycles"] == 0
    with pytest.raises(StateError, match=naming("restarted")):
        late - replace(early, instance=1)
    with pytest.raises(UsageError, match="later"):
        early - late


def test_silence_is_noticed_and_a_long_cycle_is_none() -> None:
    assert snapshot().silence == 0
    assert snapshot(read_ns=5 * 10**9).silence == 3
    assert snapshot(read_ns=5 * 10**9, cycle_time_ns=10**9).silence == 0


def test_a_map_has_units_and_comes_back() -> None:
    made = snapshot()
    data = json.loads(json.dumps(to_map(made, buckets=True)))
    assert from_map(data) == made
    empty = snapshot(times=dict.fromkeys(shm.TIMES, Histogram()), domains=())
    assert from_map(to_map(empty, buckets=True)) == empty
    assert data["exchange"]["p99"] == made.times["exchange"].quantile(0.99) / 1000
    assert data["exchange"]["max"] == made.times["exchange"].max_ns / 1000
    assert data["dc"]["offset"] == -0.123
    assert (data["cycle_time_us"], data["seconds"]) == (1000, 1.0000005)
    assert data["realtime"]["scheduling"] == "SCHED_FIFO"
    assert data["realtime"]["settings"][1]["reason"] == "Operation not permitted"
    assert "buckets" not in to_map(made)["exchange"]
    assert interval_to_map(made).keys() < data.keys()
    assert histogram_to_map(Histogram(), buckets=True) == {"count": 0, "buckets": []}


def test_a_map_of_another_version_is_named() -> None:
    for wrong in ({}, {"dc": 1}, {**to_map(snapshot(), buckets=True), "ring": {"state": "square"}}):
        with pytest.raises(EcatError, match=naming("ecatctl info")):
            from_map(wrong)


VALUES = st.one_of(
    st.none(),
    st.integers(-(1 << 70), 1 << 70),
    st.floats(),
    st.text(max_size=5),
    st.lists(st.integers(), max_size=4),
    st.dictionaries(st.text(max_size=3), st.integers(), max_size=2),
)


@given(st.data(), VALUES)
def test_a_map_that_is_wrong_is_an_error_and_no_defect(data: st.DataObject, value: Any) -> None:
    document: Any = json.loads(json.dumps(to_map(snapshot(), buckets=True)))
    place: Any = document
    while True:
        keys = list(place) if isinstance(place, dict) else list(range(len(place)))
        key = data.draw(st.sampled_from(keys))
        if not isinstance(place[key], dict | list) or not place[key] or data.draw(st.booleans()):
            break
        place = place[key]
    place[key] = value
    with suppress(EcatError):
        made = from_map(document)
        stats_lines(made, None)
        info.real_time_lines(made)


def test_screens_fit_80_columns_and_show_what_matters() -> None:
    late = snapshot(5)
    interval = late - snapshot(2)
    text = "\n".join(lines := stats_lines(late, interval))
    assert max(len(line) for line in lines) <= 80
    for expected in (
        "bus ecat0: running for 0:00:05, cycle 1000 µs, 8 of 8 slaves",
        "SCHED_FIFO priority 7, memory locked, 3 not granted (see ecatctl info)",
        "ring OPEN between slaves 2 and 3, second interface no carrier",
        "DC locked, reference clock slave 0, offset -0.123 µs, drift -12.345 ppm",
        "LAST 3.0 s",
    ):
        assert expected in text
    assert text.count("DOMAINS, ") == 2
    assert " 1000+999  12/12 " in text
    assert "DOMAINS" not in "\n".join(stats_lines(replace(late, domains=late.domains[:1]), None))
    quiet = stats_lines(snapshot(read_ns=12 * 10**9), None)
    names(quiet, "NO CYCLE for 10.0 s")
    gone = stats_lines(snapshot(links=(shm.Link.NO_CARRIER, shm.Link.UNUSED)), None)
    assert "INTERFACE no carrier" in gone
    slow = histogram([3_000] * 1000 + [12_345_678, 987_654_321])
    lines = stats_lines(snapshot(times=dict.fromkeys(shm.TIMES, slow)), None)
    (row,) = (line for line in lines if line.startswith("wakeup"))
    columns = row.split()[1:]
    assert (columns[0], columns[2], columns[-3:]) == ("3.0", "3.0", ["12583", "987654", "987654"])
    assert max(len(line) for line in lines) <= 80
    for name in shm.TIMES:
        for last in (None, interval):
            lines = histogram_lines(name, late, last)
            assert max(len(line) for line in lines) <= 80
            assert len(lines) <= 30
            assert "100.0000 %" in lines[-1]
    nothing = replace(late, times=dict.fromkeys(shm.TIMES, Histogram()))
    assert histogram_lines("cycle", nothing, None) == ["bus ecat0: cycle, 0 samples"]


def test_without_an_answer_the_shared_memory_says_what_the_exchange_does() -> None:
    links = (shm.Link.UP, shm.Link.UNUSED)
    well = snapshot(ring=shm.Ring.NONE, links=links, al_status=8)
    assert find_problems(well) == []
    first, *others = well.domains
    wrong = replace(first, wkc=11, wkc_state=shm.WkcState.INCOMPLETE)
    (text,) = find_problems(replace(well, domains=(wrong, *others)))
    names(text, "domain 0", "11 of 12")


def test_steps_below_a_microsecond_are_told_apart() -> None:
    times = snapshot().times | {"dc_offset": histogram([10, 40, 160, 54_700])}
    rows = histogram_lines("dc_offset", snapshot(times=times), None)[6:]
    edges = [row.split()[0] for row in rows if "…" not in row]
    assert len(set(edges)) == len(edges) == 4
    assert edges[0] == "0.010"


def test_a_histogram_with_gaps_says_so() -> None:
    times = snapshot().times | {"cycle": histogram([10_000] * 999_999 + [9_000_000_000])}
    lines = histogram_lines("cycle", snapshot(times=times), None)
    assert lines[-2].strip() == "…"
    first, last = lines[-3].split(), lines[-1].split()
    assert (first[4], first[5], first[7]) == ("999999", "99.9999", "#" * 20)
    assert (last[4], last[7]) == ("1", ".")


def test_real_time_is_told_with_its_price() -> None:
    grants = (
        Grant(shm.Setting.SCHEDULING, True, False, 80, 1),
        Grant(shm.Setting.AFFINITY, False, False, -1, 0),
        Grant(shm.Setting.MEMORY, True, False, 0, 12),
        Grant(shm.Setting.TIMER_SLACK, True, True, 1, 0),
        Grant(shm.Setting.DMA_LATENCY, True, False, 0, 13),
        Grant(shm.Setting.BUSY_RECEIVE, True, True, 0, 0),
    )
    lines = info.real_time_lines(snapshot(grants=grants))
    assert max(len(line) for line in lines) <= 80
    assert [line[:15].strip() for line in lines[1:7]] == [
        *("SCHED_FIFO", "CPU", "locked memory"),
        *("timer slack", "DMA latency", "busy receive"),
    ]
    text = " ".join(" ".join(lines).split())
    assert "SCHED_FIFO priority 80 REFUSED " in text
    assert "busy receive yes yes " in text
    assert "timer slack 1 ns yes" in text
    first, second, third = text.split(" was refused ")[1:]
    names(text, "SCHED_FIFO was refused", "locked memory was refused", "DMA latency was refused")
    names(first, "Operation not permitted", "CAP_SYS_NICE")
    names(second, "Cannot allocate memory", "CAP_IPC_LOCK")
    names(third, "Permission denied")
    assert text.count("was refused") == 3


def test_count_needs_watch() -> None:
    options = argparse.Namespace(count=2, watch=None)
    with pytest.raises(UsageError, match=naming("--count", "--watch")):
        stats_command(options)


def test_info_has_the_names_of_the_gateway_and_the_states_of_now() -> None:
    made = snapshot()
    at_start = {"links": {"eth1": "up", "eth2": "up"}, "ring": "closed"}
    lines = info.info_lines(made, at_start, "")
    assert lines[1:3] == ["interface   eth1, up", "interface   eth2, no carrier"]
    assert "ring        OPEN between slaves 2 and 3, second interface no carrier" in lines
    for nothing in ({}, {"links": None}, {"links": {"eth1": "up"}}):
        assert info.info_lines(made, nothing, "")[1:3] == [
            "interface   first, up",
            "interface   second, no carrier",
        ]
    silent = info.info_lines(made, {}, "silence")
    names(silent[1], "interface   first, up", "unknown")
    assert any(line.startswith("wire time   unknown") for line in silent)
    assert any(line.startswith("no answer   silence; ") for line in silent)


def test_info_tells_the_states_of_the_slaves() -> None:
    for al_status, found, text in (
        (0x08, 8, "8 found, 8 expected, all in OP"),
        (0x0C, 7, "7 found, 8 expected, in different AL states"),
        (0x08, 7, "7 found, 8 expected, these in OP"),
        (0x14, 8, "8 found, 8 expected, all in SAFEOP, with errors (see ecatctl state)"),
        (0x03, 8, "8 found, 8 expected, in different AL states"),
        (0x00, 0, "0 found, 8 expected"),
    ):
        made = snapshot(al_status=al_status, slaves_found=found)
        assert f"slaves      {text}" in info.info_lines(made, {}, "")


def test_json_knows_no_infinity(capsys: pytest.CaptureFixture[str]) -> None:
    document = {"value": math.nan, "rows": [(1.5, -math.inf)], "text": "µ"}
    print_json(document)
    print_json_line(document)
    first, line = capsys.readouterr().out.rsplit("\n", 2)[:2]
    wanted = {"schema": 1, "value": None, "rows": [[1.5, None]], "text": "µ"}
    assert json.loads(first) == json.loads(line) == wanted

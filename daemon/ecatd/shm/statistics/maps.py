"""Statistics as maps, as they are sent over Zenoh (`ro/stats`) and printed with `--json`.

Keys follow the names in the shared memory. A time is in the unit that its key ends with, else in
microseconds; `instance` is in ns. `from_map` makes a `Snapshot` from such a map, so that programs
and screens work with both sources.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from ecatd.base.errors import EcatError

from .. import contract as shm
from .snapshot import Clock, Domain, Grant, Histogram, Snapshot

QUANTILES = {"p50": 0.5, "p90": 0.9, "p99": 0.99, "p999": 0.999, "p9999": 0.9999}
_LIMIT = 1 << 64


def to_map(snapshot: Snapshot, *, buckets: bool = False) -> dict[str, Any]:
    """Makes a map of a whole snapshot.

    Args:
        snapshot: Statistics since the start.
        buckets: Whether to include the buckets of the histograms, which `from_map` needs.
    """
    clock = snapshot.clock
    return {
        "bus": snapshot.bus,
        "version": snapshot.version,
        "state": _name(snapshot.state),
        "instance": snapshot.instance,
        "cycle_time_us": snapshot.cycle_time_ns / 1000,
        "cycle_number": snapshot.cycle,
        "cycle_end_us": snapshot.cycle_end_ns / 1000,
        "read_us": snapshot.read_ns / 1000,
        "slaves": {
            "expected": snapshot.slaves_expected,
            "found": snapshot.slaves_found,
            "al_status": snapshot.al_status,
        },
        "ring": {"state": _name(snapshot.ring), "break": snapshot.ring_break},
        "links": [_name(link) for link in snapshot.links],
        "dc": {
            "state": _name(clock.state),
            "reference": clock.reference,
            "time_ns": clock.time_ns,
            "offset": clock.offset_ns / 1000,
            "drift_ppb": clock.drift_ppb,
        },
        "realtime": _real_time(snapshot.grants),
        **interval_to_map(snapshot, buckets=buckets),
    }


def interval_to_map(snapshot: Snapshot, *, buckets: bool = False) -> dict[str, Any]:
    """Makes a map of counters and times only, without the present state of the bus."""
    return {
        "seconds": round(snapshot.seconds, 9),
        **snapshot.counters,
        "delay_cycles": list(snapshot.delay_cycles),
        "domains": [_domain(domain) for domain in snapshot.domains],
        **{
            name: histogram_to_map(histogram, buckets=buckets)
            for name, histogram in snapshot.times.items()
        },
    }


def histogram_to_map(histogram: Histogram, *, buckets: bool = False) -> dict[str, Any]:
    """Makes a map with `count` and, if there are samples, `sum`, `mean`, `min`, `p50` … and `max`.

    With `buckets`, the map has a list of all buckets with samples: lower bound, upper bound
    (exclusive) and count of each. Times are in µs.
    """
    count = histogram.count
    if count == 0:
        return {"count": 0, **({"buckets": []} if buckets else {})}
    made: dict[str, Any] = {
        "count": count,
        "sum": histogram.sum_ns / 1000,
        "mean": round(histogram.mean_ns / 1000, 3),
        "min": histogram.min_ns / 1000,
        **{name: histogram.quantile(q) / 1000 for name, q in QUANTILES.items()},
        "max": histogram.max_ns / 1000,
    }
    if buckets:
        made["buckets"] = [
            [step.low_ns / 1000, step.high_ns / 1000, step.count] for step in histogram.bins()
        ]
    return made


def _name(member: Any) -> str:
    return str(member.name).lower()


def _domain(domain: Domain) -> dict[str, Any]:
    return {
        "number": domain.number,
        "name": domain.name,
        "divider": domain.divider,
        "phase": domain.phase,
        "output_bytes": domain.output_bytes,
        "input_bytes": domain.input_bytes,
        "wkc_expected": domain.wkc_expected,
        "wkc": domain.wkc,
        "wkc_state": _name(domain.wkc_state),
        "cycle_number": domain.cycle,
        **domain.counters,
    }


def _real_time(grants: tuple[Grant, ...]) -> dict[str, Any]:
    """A summary of the most important real-time settings, and a list of all."""
    scheduling, affinity = grants[shm.Setting.SCHEDULING], grants[shm.Setting.AFFINITY]
    return {
        "scheduling": "SCHED_FIFO" if scheduling.granted else "SCHED_OTHER",
        "priority": scheduling.value if scheduling.granted else 0,
        "cpu": affinity.value if affinity.granted else -1,
        "memory_locked": grants[shm.Setting.MEMORY].granted,
        "settings": [
            {
                "setting": _name(grant.setting),
                "wanted": grant.wanted,
                "granted": grant.granted,
                "value": grant.value,
                "error": grant.error,
                "reason": os.strerror(grant.error) if grant.error else "",
            }
            for grant in grants
        ],
    }


def from_map(data: Mapping[str, Any]) -> Snapshot:
    """Makes a snapshot from a map of `to_map(…, buckets=True)`.

    Raises:
        EcatError: The map is not understood, for example because it is of another version.
    """
    try:
        return _snapshot(data)
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise EcatError(
            f"this ecatctl does not understand the statistics of the daemon ({error!r}): run "
            "'ecatctl info', and install the version of the daemon here"
        ) from error


def _snapshot(data: Mapping[str, Any]) -> Snapshot:
    dc, slaves, ring = data["dc"], data["slaves"], data["ring"]
    first, second = (_member(shm.Link, name) for name in data["links"])
    read_ns = _ns(data["read_us"])
    return Snapshot(
        bus=str(data["bus"]),
        version=str(data["version"]),
        state=_member(shm.BusState, data["state"]),
        instance=_count(data["instance"]),
        cycle_time_ns=_ns(data["cycle_time_us"]),
        cycle=_count(data["cycle_number"]),
        cycle_end_ns=_ns(data["cycle_end_us"]),
        start_ns=read_ns - round(float(data["seconds"]) * 1e9),
        read_ns=read_ns,
        slaves_expected=_count(slaves["expected"]),
        slaves_found=_count(slaves["found"]),
        al_status=_count(slaves["al_status"]),
        ring=_member(shm.Ring, ring["state"]),
        ring_break=_count(ring["break"]),
        links=(first, second),
        clock=Clock(
            _member(shm.DcState, dc["state"]),
            _word(dc["reference"]),
            _count(dc["time_ns"]),
            round(float(dc["offset"]) * 1000),
            int(dc["drift_ppb"]),
        ),
        counters=_counters(data, shm.COUNTERS),
        delay_cycles=tuple(_count(data["delay_cycles"][number]) for number in range(4)),
        times={name: _histogram(data[name]) for name in shm.TIMES},
        domains=tuple(
            Domain(
                **{
                    name: _count(row[name])
                    for name in (
                        *("number", "divider", "phase", "output_bytes", "input_bytes"),
                        *("wkc_expected", "wkc"),
                    )
                },
                name=str(row["name"]),
                wkc_state=_member(shm.WkcState, row["wkc_state"]),
                cycle=_count(row["cycle_number"]),
                counters=_counters(row, shm.DOMAIN_COUNTERS),
            )
            for row in data["domains"]
        ),
        grants=_grants(data["realtime"]["settings"]),
    )


def _counters(data: Mapping[str, Any], known: tuple[shm.Counter, ...]) -> dict[str, int]:
    return {item.name: _count(data[item.name]) for item in known}


def _histogram(data: dict[str, Any]) -> Histogram:
    if not data["count"]:
        return Histogram()
    buckets = list(Histogram().buckets)
    for low, _high, count in data["buckets"]:
        buckets[shm.bucket(_ns(low))] += _count(count)
    return Histogram(tuple(buckets), _ns(data["sum"]), _ns(data["min"]), _ns(data["max"]))


def _grants(rows: list[dict[str, Any]]) -> tuple[Grant, ...]:
    made = {
        kind: Grant(
            kind,
            bool(row["wanted"]),
            bool(row["granted"]),
            _word(row["value"]),
            _word(row["error"]),
        )
        for row in rows
        for kind in (_member(shm.Setting, row["setting"]),)
    }
    return tuple(made[kind] for kind in shm.Setting)


def _member(kind: Any, name: str) -> Any:
    return kind.named(name)


def _count(value: Any) -> int:
    number = int(value)
    if not 0 <= number < _LIMIT:
        raise ValueError(f"{number} is not a counter")
    return number


def _word(value: Any) -> int:
    number = int(value)
    if not -(1 << 31) <= number < 1 << 31:
        raise ValueError(f"{number} is not a value of a setting")
    return number


def _ns(us: Any) -> int:
    return _count(round(float(us) * 1000))

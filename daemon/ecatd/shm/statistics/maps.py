"""Statistics as maps, as they are sent over Zenoh (`ro/stats`) and printed with `--json`.

Keys follow the names in the shared memory. A time is in the unit that its key ends with, else in
microseconds; `instance` is in ns. `from_map` makes a `Snapshot` from such a map, so that programs
and screens work with both sources.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import fields
from enum import IntEnum
from functools import cache
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from ecatd.base.errors import EcatError

from .. import contract as shm
from .snapshot import CanChannel, Clock, Count, Domain, Grant, Histogram, LongCycle, Snapshot

QUANTILES = {"p50": 0.5, "p90": 0.9, "p99": 0.99, "p999": 0.999, "p9999": 0.9999}
_SIMPLE = ("bus", "version", "state", "instance", "cycle_time_ns", "cycle_number", "cycle_end_ns")
"""What is in the map of a snapshot as it is, under the keys of `_key`."""
_SLAVES = {"expected": "slaves_expected", "found": "slaves_found", "al_status": "al_status"}
_RING = {"state": "ring", "break": "ring_break"}
"""Parts of the map, whose keys stand for attributes of a snapshot."""
_IN_MICROSECONDS = {
    "cycle_time_ns": "cycle_time_us",
    "cycle_end_ns": "cycle_end_us",
    "read_ns": "read_us",
    "offset_ns": "offset",
    "end_ns": "end_us",
    "wakeup_ns": "wakeup",
    "exchange_ns": "exchange",
    "duration_ns": "duration",
}
"""Times that maps have in µs, and their keys there."""


def to_map(snapshot: Snapshot, *, buckets: bool = False) -> dict[str, Any]:
    """Makes a map of a whole snapshot.

    Args:
        snapshot: Statistics since the start.
        buckets: Whether to include the buckets of the histograms, which `from_map` needs.
    """
    return {
        **_encode(snapshot, (*_SIMPLE, "read_ns")),
        "slaves": {key: getattr(snapshot, name) for key, name in _SLAVES.items()},
        "ring": {"state": _name(snapshot.ring), "break": snapshot.ring_break},
        "links": [_name(link) for link in snapshot.links],
        "dc": _encode(snapshot.clock),
        "realtime": _real_time(snapshot.grants),
        **interval_to_map(snapshot, buckets=buckets),
    }


def interval_to_map(snapshot: Snapshot, *, buckets: bool = False) -> dict[str, Any]:
    """Makes a map of counters and times only, without the present state of the bus."""
    return {
        "seconds": round(snapshot.seconds, 9),
        **snapshot.counters,
        "delay_cycles": list(snapshot.delay_cycles),
        "domains": [{**_encode(domain), **domain.counters} for domain in snapshot.domains],
        "channels": [{**_encode(channel), **channel.counters} for channel in snapshot.channels],
        "worst": {
            name: [_encode(cycle) for cycle in cycles] for name, cycles in snapshot.worst.items()
        },
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


def _encode(part: Any, names: Iterable[str] = ()) -> dict[str, Any]:
    """A part of a snapshot as a map: all of it without counters, or some of its attributes."""
    made = {}
    for name in names or (item.name for item in fields(part) if item.name != "counters"):
        value = getattr(part, name)
        if name in _IN_MICROSECONDS:
            value /= 1000
        made[_key(name)] = _name(value) if isinstance(value, IntEnum) else value
    return made


def _key(name: str) -> str:
    return _IN_MICROSECONDS.get(name, name)


def _real_time(grants: tuple[Grant, ...]) -> dict[str, Any]:
    """A summary of the most important real-time settings, and a list of all."""
    scheduling, affinity = grants[shm.Setting.SCHEDULING], grants[shm.Setting.AFFINITY]
    return {
        "scheduling": "SCHED_FIFO" if scheduling.granted else "SCHED_OTHER",
        "priority": scheduling.value if scheduling.granted else 0,
        "cpu": affinity.value if affinity.granted else -1,
        "memory_locked": grants[shm.Setting.MEMORY].granted,
        "settings": [
            {**_encode(grant), "reason": os.strerror(grant.error) if grant.error else ""}
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
    first, second = (_value(shm.Link, name) for name in data["links"])
    read_ns = _attribute(Snapshot, "read_ns", data)
    return Snapshot(
        **{name: _attribute(Snapshot, name, data) for name in _SIMPLE},
        start_ns=read_ns - round(float(data["seconds"]) * 1e9),
        read_ns=read_ns,
        **{
            name: _value(_types(Snapshot)[name], data[part][key])
            for part, names in (("slaves", _SLAVES), ("ring", _RING))
            for key, name in names.items()
        },
        links=(first, second),
        clock=_decode(Clock, data["dc"]),
        counters=_counters(data, shm.COUNTERS),
        delay_cycles=tuple(_count(data["delay_cycles"][number]) for number in range(4)),
        times={name: _histogram(data[name]) for name in shm.TIMES},
        worst={
            name: tuple(_decode(LongCycle, row) for row in data["worst"][name])
            for name in shm.WORST
        },
        domains=tuple(
            _decode(Domain, row, counters=_counters(row, shm.DOMAIN_COUNTERS))
            for row in data["domains"]
        ),
        channels=tuple(
            _decode(CanChannel, row, counters=_counters(row, shm.CAN_COUNTERS))
            for row in data["channels"]
        ),
        grants=_grants(data["realtime"]["settings"]),
    )


@cache
def _types(kind: Any) -> dict[str, Any]:
    return get_type_hints(kind, include_extras=True)


def _decode(kind: Any, data: Mapping[str, Any], **others: Any) -> Any:
    """Makes a part of a snapshot, the reverse of `_encode`; `others` are attributes of it."""
    names = _types(kind).keys() - others.keys()
    return kind(**{name: _attribute(kind, name, data) for name in names}, **others)


def _attribute(kind: Any, name: str, data: Mapping[str, Any]) -> Any:
    value = data[_key(name)]
    value = round(float(value) * 1000) if name in _IN_MICROSECONDS else value
    return _value(_types(kind)[name], value)


def _value(kind: Any, value: Any) -> Any:
    """A value of a type of `snapshot`.

    Raises:
        ValueError: It is a number out of the range of the type; or another error.
    """
    if get_origin(kind) is Annotated:
        number, (_, allowed) = int(value), get_args(kind)
        if number not in allowed:
            raise ValueError(f"{number} is not from {allowed[0]} to {allowed[-1]}")
        return number
    return kind.named(value) if issubclass(kind, IntEnum) else kind(value)


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
    made = {grant.setting: grant for grant in (_decode(Grant, row) for row in rows)}
    return tuple(made[kind] for kind in shm.Setting)


def _count(value: Any) -> int:
    return int(_value(Count, value))


def _ns(us: Any) -> int:
    return _count(round(float(us) * 1000))

"""A first reading of an incident, in words: what has happened, causes before consequences."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import NamedTuple

from .incident import Incident

_CAUSES_FIRST = (
    *("foreign_master", "tampered", "configuration", "change", "link", "sending", "ring"),
    *("cable", "slaves", "absent", "emergency", "disturbance", "al_state", "exchange"),
    *("working_counter", "clock", "clock_difference", "recovery", "safe", "stopped"),
)
"""Kinds of events, causes before consequences. ecatd finds a cause out later than what follows: a
working counter is wrong in the next cycle, but a link is looked at some times a second."""
_TOGETHER_NS = 1_500_000_000
"""Events with no longer pause between them may be of one cause."""
_MOST = 60
"""Most lines."""


class _Fact(NamedTuple):
    time_ns: int
    rank: int
    text: str


def read(incident: Incident) -> str:
    """The reading, in lines."""
    first = incident.triggers[0]
    lines = [
        f"Bus {incident.bus}. Triggered at {_clock(first.time_ns)} ({first.kind}): {first.reason}."
    ]
    lines += [
        f"Triggered again at {_clock(item.time_ns)} ({item.kind}): {item.reason}."
        for item in incident.triggers[1:]
    ]
    lines.append(_summary(incident))
    facts = sorted([*_from_frames(incident), *_from_events(incident)])
    lines += ["", "What happened, causes before what follows from them (times in UTC):"]
    lines += [f"- {_clock(fact.time_ns)} {fact.text}" for fact in _ordered(facts)[:_MOST]]
    if not facts:
        lines.append("- nothing else is known: no event, and every exchange was complete")
    if len(facts) > _MOST:
        lines.append(f"- and {len(facts) - _MOST} more, see events.json")
    return "\n".join(lines) + "\n"


def _summary(incident: Incident) -> str:
    if not incident.rows:
        return "There are no frames of the cycle: the bus server has ended, or keeps none."
    span = (incident.rows[-1].time_ns - incident.rows[0].time_ns) / 1e9
    text = f"{len(incident.rows)} cycles in {span:.3f} s"
    longest = max(incident.rows, key=lambda row: row.exchange_us)
    text += f"; the longest exchange took {longest.exchange_us:.0f} µs (cycle {longest.number})"
    if incident.missing:
        text += f"; {incident.missing} cycles are missing"
    return text + "."


def _from_frames(incident: Incident) -> Iterator[_Fact]:
    """When exchanges began to fail and to succeed, and which cycles are missing."""
    rank = _CAUSES_FIRST.index("exchange")
    before = None
    for row in incident.rows:
        if before is not None and row.number != before.number + 1:
            gap = row.number - before.number - 1
            text = f"cycle {before.number + 1}: {gap} cycles are missing: none was sent in time"
            yield _Fact(row.time_ns, rank - 1, text)
        if before is not None and row.incomplete and not before.incomplete:
            how = "its answers did not come back, or had a wrong working counter"
            count = f"{row.incomplete} domains" if row.incomplete > 1 else "a domain"
            text = f"cycle {row.number}: the exchange of {count} failed: {how}"
            yield _Fact(row.time_ns, rank, text)
        if before is not None and before.incomplete and not row.incomplete:
            text = f"cycle {row.number}: the exchanges of all domains are complete again"
            yield _Fact(row.time_ns, rank, text)
        before = row


def _from_events(incident: Incident) -> Iterator[_Fact]:
    for event in incident.events:
        kind = event["event"]
        if incident.rows and event["time_ns"] < incident.rows[0].time_ns:
            continue
        known = kind in _CAUSES_FIRST
        rank = _CAUSES_FIRST.index(kind) if known else len(_CAUSES_FIRST)
        cycle = f"cycle {event['cycle']}: " if "cycle" in event else ""
        yield _Fact(event["time_ns"], rank, f"{cycle}{event['text']}")


def _ordered(facts: list[_Fact]) -> list[_Fact]:
    """Facts in the order of time; those close together with causes first."""
    groups: list[list[_Fact]] = []
    for fact in facts:
        if groups and fact.time_ns - groups[-1][-1].time_ns <= _TOGETHER_NS:
            groups[-1].append(fact)
        else:
            groups.append([fact])
    return [
        fact
        for group in groups
        for fact in sorted(group, key=lambda item: (item.rank, item.time_ns))
    ]


def _clock(time_ns: int) -> str:
    seconds, ns = divmod(time_ns, 10**9)
    return f"{time.strftime('%H:%M:%S', time.gmtime(seconds))}.{ns // 10**6:03}"

"""A first reading of an incident, in words: what has happened, causes before consequences.

ecatd notices a cause later than what follows from it: a working counter is wrong in the next
cycle, but links and AL states are looked at some times a second. So facts that are close together
make a chain: `_EXPLAINS` says which kinds explain which others. What nothing explains is a cause,
and comes first, with the time at which the chain began.
"""

from __future__ import annotations

import re
import time
from bisect import bisect_right
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, pairwise
from typing import NamedTuple

from ecatd.etg.al import AlState

from .departures import find_departures
from .incident import LAPSES, Incident, Row, Trigger
from .moments import row_of

_LOST, _FAILED, _LATE, _WELL = "lost frames", "failed", "late", "well"
"""Kinds of what frames say: without answers, with wrong counters, not sent; complete again."""
_LAPSE, _CONDITION, _STARVED = "lapse", "condition", "starved"
"""A client that has ended or hangs; a condition of the user; a slave that got no data in time."""
_STARVED_CODES = frozenset({0x001A, 0x001B, 0x002C, 0x002D, 0x0032, 0x0034, 0x0036, 0x0037})
"""AL status codes (ETG.1000.6) of slaves that miss process data or are not synchronized."""
_COMPUTER = frozenset({"missed", "overruns"})
"""Counters that say that the computer was late."""
_EXACT = frozenset({_LOST, _FAILED, _LATE, _WELL})
"""Kinds whose time is that of the cycle: they explain only what comes later."""
_SYMPTOMS = frozenset(
    {_LOST, _FAILED, _WELL, "working_counter", "exchange", "disturbance", "recovery", "al_state"}
    | {_STARVED}
)
_EXPLAINS: Mapping[str, frozenset[str]] = {
    "foreign_master": _SYMPTOMS | {"safe", "clock", "slaves"},
    "tampered": frozenset({"safe", _LAPSE}),
    "change": frozenset(
        {"al_state", "recovery", "safe", "slaves", "configuration", _FAILED, _WELL}
    ),
    "link": _SYMPTOMS | {"slaves", "ring", "sending", "cable", "safe"},
    "sending": _SYMPTOMS | {"slaves", "ring", "safe"},
    "ring": _SYMPTOMS | {"slaves", "cable"},
    "slaves": _SYMPTOMS | {"cable", "safe", "clock", "absent"},
    "absent": _SYMPTOMS | {"cable"},
    "cable": frozenset({_LOST, _FAILED, _WELL, "working_counter", "exchange", "disturbance"}),
    "emergency": frozenset(
        {"drive", "al_state", _STARVED, "recovery", "stopped", _FAILED, _WELL, "working_counter"}
    ),
    "drive": frozenset({"stopped"}),
    _LATE: frozenset({"clock", "clock_difference", _STARVED}),
    "al_state": _SYMPTOMS - {"al_state", _STARVED, _LOST},
    _STARVED: _SYMPTOMS - {"al_state", _STARVED, _LOST},
    _LAPSE: frozenset({"stopped", "safe"}),
    "claimed": frozenset({_CONDITION}),
    _LOST: frozenset({_WELL, "working_counter", "exchange", "disturbance", _STARVED, "recovery"}),
    _FAILED: frozenset({_WELL, "working_counter", "exchange", "disturbance", "recovery"}),
    "disturbance": frozenset({"exchange"}),
    "working_counter": frozenset({"exchange", "disturbance"}),
}
"""Which kinds explain which others, if they are close together. The earlier rows explain more."""
_OF_ITSELF = frozenset({"emergency", "drive", "al_state", _STARVED})
"""Kinds that a slave says of itself, so they explain what becomes of this slave, not of others."""
_NO_CAUSE = frozenset({"change", "claimed", _WELL, "safe", "configuration", "log_levels"})
"""Kinds that nobody looks for when something has gone wrong, unless something follows from them."""
_GOOD = {
    "recovery": ("recovered", "joined", "exchanged"),
    "working_counter": ("complete",),
    "link": ("up",),
    "ring": ("closed",),
}
"""States that are good news."""
_LEFT_OUT = frozenset({"incident"})
_TOGETHER_NS = 1_500_000_000
"""Facts with no longer pause between them may be of one cause."""
_REPEATS = 3
"""How often frames may say the same before it is counted only."""
_MOST = 60
"""Most lines."""
_OF_SLAVE = re.compile(r"slave \d+ \((?:[^()]|\([^()]*\))*\):? ")
_STATISTICS = frozenset({"disturbance", "exchange"})
"""Kinds that tell of the last seconds, so they may be about something before."""


@dataclass(frozen=True, slots=True)
class _Fact:
    time_ns: int
    kind: str
    text: str
    slaves: tuple[int, ...] = ()
    cycle: int | None = None
    is_good: bool = False


class _Chain(NamedTuple):
    facts: list[_Fact]
    causes: list[_Fact]


def read(incident: Incident) -> tuple[str, str]:
    """The reading, in lines, and the cause of the trigger; empty: it is not known."""
    reading = _Reading(incident)
    return "\n".join(reading.lines()) + "\n", reading.cause()


class _Reading:
    def __init__(self, incident: Incident) -> None:
        self._incident = incident
        self._times = [row.time_ns for row in incident.rows]
        slaves = (incident.documents.get("bus") or {}).get("slaves", [])
        self._names = [item.get("given_name") or item.get("name", "") for item in slaves]
        self._chains = _chains(self._facts())

    def lines(self) -> Iterator[str]:
        """Its lines."""
        first, *others = self._incident.triggers
        day = time.strftime("%Y-%m-%d", time.gmtime(first.time_ns // 10**9))
        yield f"Bus {self._incident.bus}, {day}, times in UTC."
        yield f"Triggered at {_clock(first.time_ns)} ({first.kind}): {first.reason}."
        for item in _without_repeats(others):
            yield f"Triggered again at {_clock(item.time_ns)} ({item.kind}): {item.reason}."
        yield self._summary()
        yield ""
        if self._incident.rows and not any(chain.causes for chain in self._chains):
            yield "No fault of the bus is known: every exchange was complete."
            yield "Nobody has judged the values: look at them, as with `ecatctl web FILE`."
        yield from self._departures()
        count = 0
        for chain in self._chains:
            for line in self._chain(chain):
                count += 1
                if count <= _MOST:
                    yield line
        if count > _MOST:
            yield f"And {count - _MOST} lines more: events.json has all of them."

    def _departures(self) -> Iterator[str]:
        rows, signals = self._incident.rows, self._incident.signals
        for item in find_departures(signals, rows, self._incident.triggers[0].time_ns):
            row, unit = rows[item.row], item.signal["unit"]
            yield (
                f"{_clock(row.time_ns)} (cycle {row.number}) {item.signal['name']} changed from "
                f"{f'{item.before:.6g} {unit}'.rstrip()} to {f'{item.after:.6g} {unit}'.rstrip()} "
                f"within {item.seconds:.3f} s; no output of its slave changed in the second before"
            )

    def cause(self) -> str:
        """What may have led to the trigger: the causes that are closest to it."""
        at = self._incident.triggers[0].time_ns

        def distance(chain: _Chain) -> int:
            return max(chain.facts[0].time_ns - at, at - chain.facts[-1].time_ns, 0)

        chains = [chain for chain in self._chains if chain.causes]
        closest = min(chains, key=distance, default=_Chain([], []))
        return ", or ".join(map(self._text, closest.causes))

    def _summary(self) -> str:
        rows = self._incident.rows
        if not rows:
            return "There are no frames of the cycle: the bus server has ended, or keeps none."
        text = f"{len(rows)} cycles in {self._incident.seconds:.3f} s"
        longest = max(rows, key=lambda row: row.exchange_us)
        text += f"; the longest exchange took {longest.exchange_us:.0f} µs (cycle {longest.number})"
        if self._incident.missing:
            text += f"; {_count(self._incident.missing, 'cycle')} missing"
        return text + "."

    def _facts(self) -> list[_Fact]:
        found = [*_from_frames(self._incident.rows), *self._from_events(), *self._conditions()]
        return [*_condensed(sorted(found, key=lambda fact: fact.time_ns))]

    def _conditions(self) -> Iterator[_Fact]:
        for item in self._incident.triggers:
            found = re.fullmatch(r"(.*?),? in cycle (\d+)", item.reason)
            if found and item.kind == _CONDITION:
                cycle = int(found[2])
                at = self._time_of(cycle) or item.time_ns
                yield _Fact(at, _CONDITION, found[1], cycle=cycle)

    def _from_events(self) -> Iterator[_Fact]:
        rows = self._incident.rows
        for event in self._incident.events:
            kind = event["event"]
            if kind in _LEFT_OUT or (rows and event["time_ns"] < rows[0].time_ns):
                continue
            if kind == "change" and re.match(r"(an )?incident\b", event["what"]):
                continue
            if kind == "safe" and event.get("reason") in LAPSES:
                kind = _LAPSE
            if kind == "al_state" and event.get("al_code") in _STARVED_CODES:
                kind = _STARVED
            if kind == "disturbance" and set(event.get("counts", ())) <= _COMPUTER:
                kind = _LATE
            slaves = event.get("missing") or ([event["slave"]] if "slave" in event else [])
            good = event.get("state") in _GOOD.get(kind, ()) or event.get("over") is True
            good |= kind == "al_state" and event.get("al_state") == AlState.OP
            good |= kind == "emergency" and not event.get("code", 0xFFFF) >> 8  # the error is over
            good |= kind == "slaves" and not event.get("missing")
            good |= kind == "cable" and event.get("verdict") == "good"
            cycle = event.get("cycle")
            at = self._time_of(cycle) if cycle is not None else None
            yield _Fact(at or event["time_ns"], kind, event["text"], tuple(slaves), cycle, good)

    def _time_of(self, number: int) -> int | None:
        """When a cycle was, if it is in the incident."""
        place = row_of(self._incident.rows, number)
        return None if place is None else self._incident.rows[place].time_ns

    def _cycle_at(self, time_ns: int) -> int | None:
        """The number of the cycle that was the last one at a time."""
        place = bisect_right(self._times, time_ns) - 1
        return self._incident.rows[place].number if place >= 0 else None

    def _number(self, fact: _Fact) -> int | None:
        return fact.cycle if fact.cycle is not None else self._cycle_at(fact.time_ns)

    def _chain(self, chain: _Chain) -> Iterator[str]:
        """A chain: its cause, or its causes, and what follows."""
        if not chain.causes:
            for fact in chain.facts:
                yield f"{_clock(fact.time_ns)}{self._cycle_text(fact)} {self._text(fact)}"
            return
        effects = frozenset().union(*(_EXPLAINS.get(it.kind, frozenset()) for it in chain.causes))
        early = [fact for fact in chain.facts if fact.kind in effects and not fact.is_good]
        onset = min([*chain.causes, *early], key=lambda fact: fact.time_ns)
        rest = [fact for fact in chain.facts if fact not in chain.causes]
        for fact in rest:
            if fact.time_ns < onset.time_ns:
                yield f"{_clock(fact.time_ns)}{self._cycle_text(fact)} {self._text(fact)}"
        head = f"{_clock(onset.time_ns)}{self._cycle_text(onset)} "
        if len(chain.causes) == 1:
            yield f"{head}{self._text(chain.causes[0])}{self._noticed(onset, chain.causes[0])}"
        else:
            yield f"{head}{len(chain.causes)} things may be the cause, and nothing here says which:"
            for cause in chain.causes:
                yield f"  - {self._text(cause)}{self._noticed(onset, cause)}"
        before = onset
        for fact in rest:
            if fact.time_ns >= onset.time_ns:
                yield f"  {self._later(before, fact) or 'in the same cycle'}: {self._text(fact)}"
                before = fact

    def _noticed(self, onset: _Fact, cause: _Fact) -> str:
        later = self._later(onset, cause)
        return f" (noticed {later})" if later and cause is not onset else ""

    def _later(self, before: _Fact, after: _Fact) -> str:
        """How much later something was; empty if in the same cycle."""
        numbers = self._number(before), self._number(after)
        if numbers[0] is None or numbers[1] is None:
            return f"{(after.time_ns - before.time_ns) / 1e6:.0f} ms later"
        cycles = numbers[1] - numbers[0]
        if cycles <= 0:
            return ""
        seconds = (after.time_ns - before.time_ns) / 1e9
        more = f" ({seconds:.1f} s)" if seconds >= 1 else ""
        return f"{_count(cycles, 'cycle')} later{more}"

    def _cycle_text(self, fact: _Fact) -> str:
        number = self._number(fact)
        return f" (cycle {number})" if number is not None else ""

    def _text(self, fact: _Fact) -> str:
        text = fact.text
        if fact.kind in ("al_state", "recovery", _STARVED):
            text = f"{self._who(fact.slaves)}: {_OF_SLAVE.sub('', text, count=1)}"
        return text

    def _who(self, slaves: Sequence[int]) -> str:
        names = [
            f"{n} ({self._names[n]})" if n < len(self._names) and self._names[n] else str(n)
            for n in slaves
        ]
        if len(names) == 1:
            return f"slave {names[0]}"
        return f"slaves {', '.join(names[:-1])} and {names[-1]}"


def _from_frames(rows: Sequence[Row]) -> Iterator[_Fact]:
    """When exchanges began to fail and to succeed, and which cycles are missing."""
    for before, row in pairwise(rows):
        gap = row.number - before.number - 1
        if gap:
            text = f"{_count(gap, 'cycle')} missing: no frame was sent in time"
            at_ns = before.time_ns + (row.time_ns - before.time_ns) // (gap + 1)
            yield _Fact(at_ns, _LATE, text, cycle=before.number + 1)
        if row.incomplete and not before.incomplete:
            what = _count(row.incomplete, "domain")
            if row.unanswered:
                text = f"{_count(row.unanswered, 'frame')} did not come back ({what})"
                yield _Fact(row.time_ns, _LOST, text, cycle=row.number)
            else:
                text = f"the working counter was wrong ({what})"
                yield _Fact(row.time_ns, _FAILED, text, cycle=row.number)
        if before.incomplete and not row.incomplete:
            text = "the exchanges of all domains are complete again"
            yield _Fact(row.time_ns, _WELL, text, cycle=row.number, is_good=True)


def _condensed(facts: Iterable[_Fact]) -> Iterator[_Fact]:
    """Says once what frames say again and again, with nothing else between."""
    for is_of_frames, items in groupby(facts, key=lambda fact: fact.kind in _EXACT):
        run = [*items]
        times = Counter(fact.kind for fact in run if not fact.is_good)
        if not is_of_frames or max(times.values(), default=0) <= _REPEATS:
            yield from run
            continue
        last = {fact.kind: fact for fact in run}
        for fact in run:
            if fact.is_good or times.pop(fact.kind, 0) == 0:
                continue
            more = sum(other.kind == fact.kind for other in run) - 1
            again = (
                f"; {_count(more, 'time')} more, up to {_clock(last[fact.kind].time_ns)}"
                if more
                else ""
            )
            yield replace(fact, text=fact.text + again)
        if run[-1].is_good:
            yield run[-1]


def _chains(facts: Iterable[_Fact]) -> list[_Chain]:
    """Facts close together, each group with its causes."""
    groups: list[list[_Fact]] = []
    for fact in facts:
        if groups and fact.time_ns - groups[-1][-1].time_ns <= _TOGETHER_NS:
            groups[-1].append(fact)
        else:
            groups.append([fact])
    return [_Chain(facts := _merged(group), _causes(facts)) for group in groups]


def _merged(facts: Sequence[_Fact]) -> list[_Fact]:
    """Says once what holds for several slaves, or was told twice."""
    found: list[_Fact] = []
    for fact in facts:
        text = _OF_SLAVE.sub("", fact.text, count=1)
        for place, old in enumerate(found):
            alike = (old.kind, old.is_good) == (fact.kind, fact.is_good)
            if alike and fact.slaves and _OF_SLAVE.sub("", old.text, count=1) == text:
                slaves = tuple(sorted({*old.slaves, *fact.slaves}))
                found[place] = replace(old, slaves=slaves)
                break
            is_same = fact.kind == "working_counter" and old.kind in (_LOST, _FAILED, _WELL)
            if is_same and old.cycle == fact.cycle:  # the frames have said it
                break
        else:
            found.append(fact)
    return found


def _causes(facts: Sequence[_Fact]) -> list[_Fact]:
    """What explains most of the other facts, and what explains some of the same facts."""
    bad = [fact for fact in facts if not fact.is_good]
    everything = {id(fact): [o for o in bad if _explains(fact, o)] for fact in bad}
    explained = {id(fact) for found in everything.values() for fact in found}
    effects = {
        key: {id(fact) for fact in found if fact.kind not in _STATISTICS}
        for key, found in everything.items()
    }
    roots: dict[tuple[str, tuple[int, ...]], _Fact] = {}
    for fact in bad:
        if id(fact) not in explained and (effects[id(fact)] or fact.kind not in _NO_CAUSE):
            roots.setdefault((fact.kind, fact.slaves), fact)
    if not roots:
        return []
    most = max(roots.values(), key=lambda fact: len(effects[id(fact)]))
    return [
        fact for fact in roots.values() if fact is most or effects[id(fact)] & effects[id(most)]
    ]


def _explains(cause: _Fact, effect: _Fact) -> bool:
    if cause is effect or effect.kind not in _EXPLAINS.get(cause.kind, ()):
        return False
    if cause.kind in _OF_ITSELF and effect.kind in _OF_ITSELF | {"recovery", "stopped"}:
        return bool({*cause.slaves} & {*effect.slaves})
    return cause.kind not in _EXACT or cause.time_ns <= effect.time_ns


def _without_repeats(triggers: Iterable[Trigger]) -> Iterator[Trigger]:
    seen: set[str] = set()
    for item in triggers:
        kind = item.reason.partition(":")[0] if item.kind == "fault" else item.reason
        if kind not in seen:
            seen.add(kind)
            yield item


def _count(number: int, what: str) -> str:
    """A number with what is counted; `2 cycles`."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def _clock(time_ns: int) -> str:
    seconds, ns = divmod(time_ns, 10**9)
    return f"{time.strftime('%H:%M:%S', time.gmtime(seconds))}.{ns // 10**6:03}"

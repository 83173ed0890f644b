"""The seven lamps that operators ask for: is the bus well, and if not, what is it?

What is wrong is judged elsewhere, once for all commands: slaves, faults and differences by
`ecatd.operations.health`, the shared memory by `ecatd.shm.statistics.problems`. Lamps sort it, and
add what has happened in the last minute.
"""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypedDict

from ecatd.base.errors import EcatError
from ecatd.etg.al import AlState
from ecatd.operations.faults import CAN, DRIVE, EXCHANGE, RECORDER, WORKING_COUNTER, Fault
from ecatd.operations.health import Health, look_at, row_label
from ecatd.shm import contract as shm
from ecatd.shm.statistics import Snapshot, from_map
from ecatd.shm.statistics.problems import (
    NOT_IN_STEP,
    find_problems,
    is_exchanged,
    link_problems,
    ring_text,
)

State = Literal["good", "warning", "bad", "unknown"]

WINDOW_S = 60.0
"""Seconds over which a lamp counts what happens now and then."""
OLD_S = 6.0
"""Seconds after which an answer is too old to say that all is well."""
_STEP_S = 2.0
"""Seconds between two statistics that are kept."""
_MANY = 0.01
"""Share of missed cycles from which timing is bad: that of the daemon's own faults."""
_NEAR = 0.8
"""Share of the cycle above which its work takes too long."""
_FEW = 3
"""Fewer cycles or frames in the last minute are said, but are no reason to look: any computer
misses one now and then."""
_LOST = tuple(kind for kind in EXCHANGE if kind != WORKING_COUNTER)
_UNSAFE = ("lapsed", "gone", "died", "wkc", "source", "stopping")
"""Why outputs are safe although nobody has given them back."""


class Evidence(TypedDict):
    """What shows more."""

    panel: Literal["topology", "timing", "outputs", "events"]
    slave: int | None  #: Position of the worst slave, if it is about one.


class Lamp(TypedDict):
    """A lamp."""

    id: str
    title: str
    state: State
    text: str  #: One sentence.
    since: float | None  #: Unix time in s; None if it was so at the first look.
    evidence: Evidence


TITLES = {
    "slaves_in_op": "Slaves in OP",
    "working_counter": "Working counter",
    "frames_lost": "Frames lost",
    "timing": "Timing",
    "link": "Link",
    "number_of_slaves": "Number of slaves",
    "outputs": "Outputs",
}
"""Titles of the lamps by id, in order."""
_PANELS: dict[str, Literal["topology", "timing", "outputs", "events"]] = {
    **dict.fromkeys(("slaves_in_op", "working_counter", "link", "number_of_slaves"), "topology"),
    "frames_lost": "events",
    "timing": "timing",
    "outputs": "outputs",
}


@dataclass(frozen=True, slots=True)
class _Found:
    """What a lamp shows."""

    state: State
    text: str
    since: float | None = None
    slave: int | None = None


class _Answers:
    """When the last answer of one kind came: the same map again is no new one."""

    def __init__(self) -> None:
        self._last: Mapping[str, Any] | None = None
        self._at = 0.0

    def age(self, answer: Mapping[str, Any] | None, now: float) -> float:
        """Seconds since it came."""
        if answer is not self._last:
            self._last, self._at = answer, now
        return now - self._at


class Lamps:
    """Judges the answers of a daemon; keeps what happened in the last minute, and since when."""

    def __init__(self) -> None:
        self._kept: deque[tuple[float, Snapshot]] = deque()
        self._latest: Snapshot | None = None
        self._last_at: dict[str, float] = {}  # when a counter rose, by its name
        self._begun: dict[str, tuple[State, float | None]] = {}
        self._unsafe: tuple[float, str] | None = None  # when outputs were last unsafe, and why
        self._answers = [_Answers() for _ in range(3)]

    def look(
        self,
        statistics: Mapping[str, Any] | None,
        states: Mapping[str, Any] | None,
        outputs: Mapping[str, Any] | None,
        now: float,
    ) -> list[Lamp]:
        """The lamps.

        Args:
            statistics: Answer to `ReadStats(buckets=True)`; None if there is none.
            states: Answer to `ReadStates`, or None.
            outputs: Answer to `ReadOutputs`, or None.
            now: Unix time in seconds.

        A map that is the same object as before is the same answer, and gets old.
        """
        ages = [
            answers.age(answer, now)
            for answers, answer in zip(self._answers, (statistics, states, outputs), strict=True)
        ]
        snapshot, why_no_snapshot = _snapshot(statistics, ages[0])
        health, why_no_health = _health(states, ages[1])
        if snapshot is not None and not ages[0]:
            self._keep(snapshot, now)
        found = {
            **self._of_slaves(health, why_no_health, states),
            **self._of_exchange(snapshot, why_no_snapshot, health, now),
            "link": _link(snapshot, health, why_no_snapshot, states),
            "outputs": self._of_outputs(_outputs(outputs, ages[2]), now),
        }
        return [self._lamp(name, found[name], now) for name in TITLES]

    def _lamp(self, name: str, found: _Found, now: float) -> Lamp:
        state, since = self._begun.get(name, (found.state, None))
        if state != found.state:
            since = now
        self._begun[name] = found.state, since
        return {
            "id": name,
            "title": TITLES[name],
            "state": found.state,
            "text": found.text[:1].upper() + found.text[1:],
            "since": found.since or since,
            "evidence": {"panel": _PANELS[name], "slave": found.slave},
        }

    def _keep(self, snapshot: Snapshot, now: float) -> None:
        before = self._latest
        if before is not None and before.instance != snapshot.instance:
            before = None
            self._kept.clear()
            self._last_at.clear()
        if before is not None:
            for name, value in snapshot.counters.items():
                if value > before.counters[name]:
                    self._last_at[name] = now
        self._latest = snapshot
        if not self._kept or now - self._kept[-1][0] >= _STEP_S:
            self._kept.append((now, snapshot))
        while len(self._kept) > 1 and self._kept[1][0] <= now - WINDOW_S:
            self._kept.popleft()

    def _of_outputs(self, found: _Found, now: float) -> _Found:
        """Adds to good news that it was bad some time ago."""
        if found.state == "bad":
            self._unsafe = now, found.text
        elif found.state == "good" and self._unsafe:
            until, why = self._unsafe
            return replace(found, text=f"{found.text}; until {_clock(until)}: {why}")
        return found

    # --- slaves -----------------------------------------------------------------------------------

    def _of_slaves(
        self, health: Health | None, why_not: str, states: Mapping[str, Any] | None
    ) -> dict[str, _Found]:
        if health is None or states is None:
            unknown = _Found("unknown", why_not)
            return {"slaves_in_op": unknown, "number_of_slaves": unknown}
        blind = next((fault for fault in health.faults if fault.blinds), None)
        if blind:
            unknown = _Found("unknown", f"nothing is known of slaves: {blind.text}", blind.since)
            return {"slaves_in_op": unknown, "number_of_slaves": unknown}
        return {"slaves_in_op": _in_op(health), "number_of_slaves": _number(health)}

    # --- exchange ---------------------------------------------------------------------------------

    def _of_exchange(
        self, snapshot: Snapshot | None, why_not: str, health: Health | None, now: float
    ) -> dict[str, _Found]:
        names = ("working_counter", "frames_lost", "timing")
        if snapshot is None:
            return dict.fromkeys(names, _Found("unknown", why_not))
        if not is_exchanged(snapshot):
            stands = "; ".join(find_problems(snapshot))
            unknown = _Found("unknown", f"nothing is exchanged: {stands}")
            return {**dict.fromkeys(names, unknown), "timing": _Found("bad", stands)}
        interval = None
        if self._kept and self._kept[0][1].read_ns < snapshot.read_ns:
            interval = snapshot - self._kept[0][1]
        return {
            "working_counter": self._working_counter(snapshot, interval, health),
            "frames_lost": self._frames_lost(snapshot, interval, health),
            "timing": self._timing(snapshot, interval, health),
        }

    def _working_counter(
        self, snapshot: Snapshot, interval: Snapshot | None, health: Health | None
    ) -> _Found:
        if fault := _fault(health, (WORKING_COUNTER,)):
            return _of_fault(fault, health)
        count = snapshot.counters["wkc_bad"]
        # Exchanges whose frames came back: lost ones have a lamp of their own.
        recent = sum(d.counters["wkc_wrong"] for d in interval.domains) if interval else 0
        wrong = [
            domain
            for domain in snapshot.domains
            if domain.counters["exchanges"] and domain.wkc_state != shm.WkcState.COMPLETE
        ]
        if wrong and health is None:
            first = wrong[0]
            return _Found(
                "bad",
                f"the last exchange of domain {first.number} was not complete (working counter "
                f"{first.wkc} of {first.wkc_expected})",
            )
        if recent and interval:
            of = sum(domain.counters["exchanges"] for domain in interval.domains)
            text = f"{recent} of {of} exchanges were incomplete{_in(interval)}"
            return _Found(_by_number(recent), text)
        if not snapshot.domains:
            return _Found("good", "no process data is exchanged, so there is nothing to count")
        counters = ", ".join(f"{d.wkc} of {d.wkc_expected}" for d in snapshot.domains)
        return _Found("good", f"complete: {counters}{self._earlier('wkc_bad', count)}")

    def _frames_lost(
        self, snapshot: Snapshot, interval: Snapshot | None, health: Health | None
    ) -> _Found:
        if fault := _fault(health, _LOST):
            return _of_fault(fault, health)
        recent = _lost(interval) if interval else 0
        if recent and interval:
            frames = max(1, interval.counters["frames"])
            rate = f"{1e6 * recent / frames:.0f} of a million"
            text = f"{recent} of {frames} frames lost{_in(interval)} ({rate})"
            return _Found(_by_number(recent), text)
        names = [name for name in ("lost", "unsent") if name in self._last_at]
        latest = max(names, key=lambda name: self._last_at[name], default="lost")
        count = _lost(snapshot)
        if interval is None:
            return _Found("good", f"{count or 'none'} lost since the start")
        return _Found("good", f"none lost{_in(interval)}{self._earlier(latest, count)}")

    def _earlier(self, name: str, count: int) -> str:
        """What was counted before the last minute."""
        if not count:
            return ", none since the start"
        if name in self._last_at:
            return f"; {count} since the start, last at {_clock(self._last_at[name])}"
        return f"; {count} since the start"

    def _timing(
        self, snapshot: Snapshot, interval: Snapshot | None, health: Health | None
    ) -> _Found:
        if fault := _fault(health, ("clock",)):
            return _of_fault(fault, health)
        if health is None and snapshot.clock.state == shm.DcState.LOCKING:
            return _Found("bad", NOT_IN_STEP)
        part = interval or snapshot
        cycle_us = snapshot.cycle_time_ns / 1000
        p99 = part.times["cycle"].quantile(0.99) / 1000
        work = f"99 % of cycles took {p99:.0f} of {cycle_us:g} µs"
        missed = interval.counters["missed"] if interval else 0
        if missed and interval:
            cycles = missed + interval.counters["cycles"]
            text = f"{missed} of {cycles} cycles missed{_in(interval)}; {work}"
            return _Found("bad" if missed >= _MANY * cycles else _by_number(missed), text)
        if p99 > _NEAR * cycle_us:
            return _Found("warning", f"cycles take almost too long: {work}{_in(part)}")
        missed_before = self._earlier("missed", snapshot.counters["missed"])
        return _Found("good", f"{work}; no cycle missed{_in(part)}{missed_before}")


def _snapshot(statistics: Mapping[str, Any] | None, age: float) -> tuple[Snapshot | None, str]:
    """The statistics, or why there are none."""
    if statistics is None:
        return None, "the daemon has not answered"
    if age > OLD_S:
        return None, f"the daemon has not answered for {age:.0f} s"
    try:
        return from_map(statistics), ""
    except EcatError as error:
        return None, str(error)


def _health(states: Mapping[str, Any] | None, age: float) -> tuple[Health | None, str]:
    """How the slaves are, or why this is not known."""
    if states is None:
        return None, "the daemon has not said how the slaves are"
    if age > OLD_S:
        return None, f"the daemon has not said for {age:.0f} s how the slaves are"
    try:
        return look_at(states), ""
    except (AttributeError, LookupError, OSError, OverflowError, TypeError, ValueError) as error:
        return None, (
            f"the answer about slaves makes no sense ({error!r:.60}): perhaps the daemon has "
            "another version"
        )


def _by_number(failures: int) -> State:
    return "warning" if failures >= _FEW else "good"


def _in_op(health: Health) -> _Found:
    by_position = {row["position"]: row for row in health.rows}
    if health.unwell:
        worst = min(
            health.unwell,
            key=lambda p: (by_position[p]["al_state"] == AlState.OP, by_position[p]["al_state"]),
        )
        others = len(health.unwell) - 1
        more = f"; and {others} more" if others else ""
        text = f"{health.counts}: {health.unwell[worst]}{more}"
        state: State = "bad" if health.in_op < health.expected else "warning"
        return _Found(state, text, by_position[worst].get("since"), worst)
    if health.silence:
        return _Found("unknown", health.silence)
    if health.in_op < health.expected:
        return _Found("bad", health.counts)
    if own := _fault(health, (DRIVE, CAN)):
        text = f"{health.counts}, but {own.text}"
        return _Found("bad", text, own.since, own.slaves[0])
    return _Found("good", health.counts)


def _number(health: Health) -> _Found:
    silent = [row for row in health.rows if not row["al_state"]]
    gone = [row for row in silent if row.get("recovery") != "absent"]
    there = health.expected - health.missing - len(gone)
    absent = f" ({health.absent} optional absent)" if health.absent else ""
    counts = f"{there} of {health.expected} slaves answer{absent}"
    if gone:
        more = f" and {len(gone) - 1} more" if len(gone) > 1 else ""
        text = f"{counts}: {row_label(gone[0])} is missing{more}"
        return _Found("bad", text, gone[0].get("since"), gone[0]["position"])
    if health.differences:
        text = f"{counts}: {'; '.join(health.differences)}"
        return _Found("bad" if health.missing else "warning", text)
    if health.incomplete:
        return _Found("warning", f"{counts}: {'; '.join(health.incomplete)}")
    return _Found("unknown", health.silence) if health.silence else _Found("good", counts)


def _link(
    snapshot: Snapshot | None,
    health: Health | None,
    why_not: str,
    states: Mapping[str, Any] | None,
) -> _Found:
    others = {*EXCHANGE, "clock", DRIVE, CAN, RECORDER}
    if health:
        faults = [fault for fault in health.faults if fault.kind not in others]
        if faults:
            worst = next((fault for fault in faults if fault.blinds), faults[0])
            return _of_fault(worst, health, warning=not worst.blinds)
    problems = [*link_problems(snapshot)] if snapshot else []
    if problems:
        return _Found("bad", "; ".join(problems))
    cables = list((states or {}).get("cables", ())) if health else []
    for verdict, state in (("bad", "bad"), ("strained", "warning")):
        hurt = [cable for cable in cables if cable.get("verdict") == verdict]
        if hurt:
            position = hurt[0]["slave"]
            where = _label(health, position)
            before = hurt[0]["before"]
            begin = "the computer" if before < 0 else _label(health, before)
            more = f", and {len(hurt) - 1} more" if len(hurt) > 1 else ""
            text = f"{verdict} cable between {begin} and {where}{more}: reseat or replace it"
            return _Found(state, text, None, position)  # type: ignore[arg-type]
    if snapshot is None:
        return _Found("unknown", why_not)
    if snapshot.ring == shm.Ring.NONE:
        return _Found("good", "the interface has its link")
    return _Found("good", f"the interface has its link; ring {ring_text(snapshot)}")


def _outputs(outputs: Mapping[str, Any] | None, age: float) -> _Found:
    if outputs is None:
        return _Found("unknown", "the daemon has not said who drives the outputs")
    if age > OLD_S:
        return _Found("unknown", f"the daemon has not said for {age:.0f} s who drives the outputs")
    try:
        return _drivers(outputs)
    except (AttributeError, LookupError, TypeError, ValueError) as error:
        return _Found("unknown", f"the answer about outputs makes no sense ({error!r:.60})")


def _drivers(outputs: Mapping[str, Any]) -> _Found:
    rows: list[Mapping[str, Any]] = list(outputs["outputs"])
    owners: list[Mapping[str, Any]] = list(outputs["owners"])
    if problems := outputs.get("problems"):
        return _Found("warning", f"the shared memory makes no sense: {problems[0]}")
    if not rows:
        return _Found("good", "the bus has no outputs")
    unsafe = [
        row for row in rows if row["state"] in ("safe", "stopping") and row["cause"] in _UNSAFE
    ]
    if unsafe:
        first = unsafe[0]
        silent = [owner_name(owner) for owner in owners if owner.get("state") == "lapsed"]
        reason = first["reason"] or first["cause"]
        if first["cause"] == "lapsed" and silent:
            reason = f"{silent[0]} gives no sign of life"
        text = f"{reason}: {len(unsafe)} of {len(rows)} outputs are safe, such as {first['name']}"
        return _Found("bad", text, first["since"], first["slave"])
    driven = Counter(row["owner"] for row in rows if row["owner"] >= 0)
    rows = [row for row in rows if row["state"] != "can"]  # the words of a handshake
    copied = sum(row["state"] == "copied" for row in rows)
    if not driven and not copied:
        return _Found("good", f"nobody drives the {len(rows)} outputs, so they are safe")
    parts = [
        f"{owner_name(owners[number])} drives {count} of {len(rows)} outputs"
        for number, count in driven.most_common(2)
    ]
    if len(driven) > 2:
        parts.append(f"{len(driven) - 2} more programs drive others")
    if copied:
        parts.append(f"{copied} are copied from inputs")
    free = len(rows) - driven.total() - copied
    return _Found("good", ", ".join(parts) + (f"; {free} are safe" if free else ""))


def owner_name(owner: Mapping[str, Any]) -> str:
    """`controller (process 412)`, or who holds outputs by hand; of an owner in `Outputs`."""
    if owner.get("by_hand"):
        return f"{owner.get('user') or 'somebody'} by hand"
    pid = owner.get("pid")
    return f"{owner.get('name') or 'a program'}" + (f" (process {pid})" if pid else "")


def _fault(health: Health | None, kinds: Iterable[str]) -> Fault | None:
    """The worst fault of some kinds."""
    found = [fault for fault in (health.faults if health else ()) if fault.kind in kinds]
    return max(found, key=lambda fault: (fault.stops, fault.share), default=None)


def _of_fault(fault: Fault, health: Health | None, *, warning: bool = False) -> _Found:
    slave = fault.slaves[0] if fault.slaves else None
    text = fault.text
    if slave is not None and (label := _label(health, slave)) not in text:
        text += f" ({label})"
    return _Found("warning" if warning else "bad", text, fault.since or None, slave)


def _label(health: Health | None, position: int) -> str:
    rows: Sequence[Any] = health.rows if health else ()
    return next(
        (row_label(row) for row in rows if row["position"] == position), f"slave {position}"
    )


def _lost(part: Snapshot) -> int:
    return part.counters["lost"] + part.counters["unsent"]


def _in(part: Snapshot) -> str:
    seconds = part.seconds
    if seconds > 2 * WINDOW_S:
        return " since the start"
    return f" in the last {min(WINDOW_S, seconds):.0f} s"


def _clock(moment: float) -> str:
    return time.strftime("%H:%M:%S", time.localtime(moment))

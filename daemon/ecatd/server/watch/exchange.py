"""Watches the exchange itself: how many exchanges of each domain succeed, whatever slaves say.

Counters of the engine are compared over a window of some seconds (`[health]`). A kind of failure is
reported when its share reaches a limit, and until it is below half of this limit: so one at the
limit is reported once.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Awaitable, Callable, Collection
from dataclasses import astuple, dataclass, field
from functools import partial

from ecatd.base.errors import StateError
from ecatd.config import HealthConfig
from ecatd.master.engine.process_image import DomainImage
from ecatd.master.worker import Worker
from ecatd.operations.faults import EXCHANGE, LATE, LOST, UNSENT, WORKING_COUNTER, Fault

from ..start.running_bus import RunningBus
from .reports import Reporter
from .suspects import Finding, are_damaged, find_suspects

_PERIOD = 0.5
"""Seconds between two looks at the counters."""
_ASK_AGAIN = 2.0
"""Seconds after which slaves are asked again why the working counter is wrong."""
_REPORT_AGAIN = 10.0
"""Seconds after which the log has another reason, if there is one."""
_SEEN = 8
"""Wrong counters, one of each look, that are compared with each other."""
_FEWEST = 3
"""Failures below this number are reported only if no exchange succeeds."""
_MANY, _QUIET_S = 0.1, 1.0
"""If this share has failed, so many seconds without another failure show that it is over."""
_EXCHANGES_MIN = 10
"""Exchanges of a slow domain that a window has at least."""


@dataclass(frozen=True, slots=True)
class Counts:
    """Counters of one domain, or of the whole bus: exchanges, and those that have failed.

    Attributes:
        exchanges: Number of exchanges.
        wrong: Exchanges with a wrong working counter although all frames came back.
        lost: Frames that did not come back in time.
        late: Frames that came back too late; they are part of `lost`.
        unsent: Frames that could not be sent.
        failed: Exchanges that have failed, for any of these reasons or several.
    """

    exchanges: int = 0
    wrong: int = 0
    lost: int = 0
    late: int = 0
    unsent: int = 0
    failed: int = 0

    def __sub__(self, other: Counts) -> Counts:
        pairs = zip(astuple(self), astuple(other), strict=True)
        return Counts(*(max(0, now - then) for now, then in pairs))

    def of(self, kind: str) -> int:
        """Failures of one kind."""
        if kind == LOST:
            return max(0, self.lost - self.late)
        return {WORKING_COUNTER: self.wrong, LATE: self.late, UNSENT: self.unsent}[kind]

    @property
    def none_succeeds(self) -> bool:
        """Whether all exchanges have failed."""
        return 0 < self.exchanges <= self.failed

    def share(self, kind: str) -> float:
        """Share of the exchanges that failures of one kind have spoilt, 0 to 1."""
        return min(1.0, self.of(kind) / self.exchanges) if self.exchanges else 0.0


class Window:
    """The last seconds of some counters.

    Args:
        counts: Their present values.
        now: CLOCK_MONOTONIC in seconds.
    """

    def __init__(self, counts: Counts, now: float) -> None:
        self._samples = deque([(now, counts)])

    def add(self, counts: Counts, now: float, seconds: float) -> tuple[Counts, float]:
        """Adds the present values.

        Returns:
            By how much they have risen within the window, and the seconds that it has.
        """
        self._samples.append((now, counts))
        while len(self._samples) > 2 and self._samples[1][0] <= now - seconds:
            self._samples.popleft()
        begin, first = self._samples[0]
        return counts - first, now - begin


def is_well(counts: Counts, kind: str, limit: float, *, before: bool) -> bool:
    """Whether the failures of one kind are few enough.

    Args:
        counts: Of the window.
        kind: The kind.
        limit: The share from which on they are too many.
        before: Whether they were few enough before. If not, they must be below half of the limit.
    """
    failures = counts.of(kind)
    if not counts.exchanges:
        return before
    if not before:
        return counts.share(kind) < limit / 2
    few = failures < _FEWEST and failures < counts.exchanges
    return few or counts.share(kind) < limit


@dataclass(slots=True)
class _Kind:
    """What is known of one kind of failure of one domain."""

    fault: Fault | None = None
    failures: int = 0  # since the start, when it was looked at last
    failed_at: float = 0.0  # when they have risen last
    since: float = 0.0
    asked: float = -_ASK_AGAIN
    reported: float = 0.0
    reason: str = ""
    slaves: tuple[int, ...] = ()
    exonerated: bool = False  # asked once more, the slaves explain nothing
    seen: deque[int] = field(default_factory=lambda: deque(maxlen=_SEEN))  # counters: wrong by


@dataclass(slots=True)
class _Part:
    """A domain with its window; without one, the bus: its slaves have no process data."""

    domain: DomainImage | None
    window: Window
    seconds: float
    kinds: dict[str, _Kind] = field(default_factory=lambda: {kind: _Kind() for kind in EXCHANGE})


class ExchangeWatch:
    """The watch over the exchange of one bus.

    Args:
        running: The bus.
        worker: The worker on which slaves are asked.
        report: Reports changes.
        explain: Says why frames are not sent (`UNSENT`) or get lost, as far as the interfaces know;
            empty if they know nothing.
        find_away: Positions of slaves that were not in OP, or did not answer, at some moment since
            a time (CLOCK_MONOTONIC in seconds).
    """

    def __init__(
        self,
        running: RunningBus,
        worker: Worker,
        report: Reporter,
        explain: Callable[[str], Awaitable[str]],
        find_away: Callable[[float], Collection[int]],
    ) -> None:
        self._running = running
        self._bus = running.bus
        self._shared = running.shared
        self._config = running.config.health
        self._worker = worker
        self._report = report
        self._explain = explain
        self._find_away = find_away
        now = time.monotonic()
        self._parts: list[_Part] = []
        domains: list[DomainImage | None] = [
            domain for domain in running.data.image.domains if domain.datagrams
        ]
        for domain in domains or [None]:
            divider = 1 if domain is None else domain.divider
            seconds = _EXCHANGES_MIN * divider * running.bus.cycle_time_us * 1e-6
            self._parts.append(_Part(domain, Window(self._read(domain), now), seconds))

    def set_config(self, config: HealthConfig) -> None:
        """Changes the limits."""
        self._config = config

    @property
    def faults(self) -> list[Fault]:
        """What is wrong now, causes before consequences."""
        known = (part.kinds[kind] for kind in EXCHANGE for part in self._parts)
        return [item.fault for item in known if item.fault is not None]

    async def watch(self) -> None:
        """Waits for a while, and looks."""
        await asyncio.sleep(_PERIOD)
        now = time.monotonic()
        for part in self._parts:
            seconds = max(self._config.window_s, part.seconds)
            total = self._read(part.domain)
            counts, lasted = part.window.add(total, now, seconds)
            for kind in EXCHANGE:
                known = part.kinds[kind]
                goes_on = total.of(kind) > known.failures
                known.failures = total.of(kind)
                if goes_on:
                    known.failed_at = now
                # An outage is over before the window has forgotten it.
                quiet = now - known.failed_at >= max(_QUIET_S, part.seconds / 2)
                if known.fault and quiet and counts.share(kind) >= _MANY:
                    self._end(part.domain, known, kind, known.fault)
                    part.window = Window(total, now)
                else:
                    await self._judge(part.domain, known, kind, counts, lasted, goes_on=goes_on)

    def _read(self, domain: DomainImage | None) -> Counts:
        health = self._shared.health
        if domain is None:
            # With two interfaces a frame that one of them does not take leaves by the other one.
            one = len(self._running.master.interfaces) == 1
            unsent = health.unsent if one else 0
            failed = health.lost + unsent  # one frame in a cycle, which looks for slaves
            return Counts(health.cycles, 0, health.lost, health.late, unsent, failed)
        row = self._shared.domain_status[domain.number]
        return Counts(row.exchanges, row.wkc_wrong, row.lost, row.late, row.unsent, row.wkc_bad)

    async def _judge(
        self,
        domain: DomainImage | None,
        known: _Kind,
        kind: str,
        counts: Counts,
        lasted: float,
        *,
        goes_on: bool,
    ) -> None:
        """Finds whether one kind of failure has begun, goes on or is over."""
        limit: float = {
            WORKING_COUNTER: self._config.wrong_counters,
            LOST: self._config.lost,
            LATE: self._config.late,
            UNSENT: self._config.unsent,
        }[kind]
        begins = known.fault is None
        if kind == WORKING_COUNTER and goes_on and domain is not None:
            known.seen.append(int(self._shared.domain_status[domain.number].wrong_by))
        if is_well(counts, kind, limit, before=begins):
            if known.fault is not None:
                self._end(domain, known, kind, known.fault)
            return
        if begins:
            known.since = time.time()
        # While nothing more fails, nobody can be asked why.
        changed = (begins or goes_on) and await self._find_reason(domain, known, kind, lasted)
        what = f"{self._label(domain)}: {_words(kind, counts, lasted)}"
        known.fault = Fault(
            kind,
            f"{what}; {known.reason}",
            known.since,
            None if domain is None else domain.number,
            share=round(counts.share(kind), 6),
            none_succeeds=counts.none_succeeds,
            slaves=known.slaves,
        )
        now = time.monotonic()
        if begins or (changed and now - known.reported >= _REPORT_AGAIN):
            known.reported = now
            self._report_fault(known.fault, counts, over=False)

    def _remedy(self, kind: str) -> str:
        if kind == LOST and not self._shared.health.slaves_found:
            return f"check the cable to {self._bus.slaves[0].label}, and its power"
        return _REMEDIES[kind]

    def _label(self, domain: DomainImage | None) -> str:
        return "the bus" if domain is None else self._bus.domain_label(domain.number)

    def _end(self, domain: DomainImage | None, known: _Kind, kind: str, fault: Fault) -> None:
        known.fault, known.reason, known.slaves, known.asked = None, "", (), -_ASK_AGAIN
        known.seen.clear()
        text = f"{self._label(domain)}: {_OVER[kind]} again"
        over = Fault(kind, text, fault.since, fault.domain)
        self._report_fault(over, None, over=True)

    def _report_fault(self, fault: Fault, counts: Counts | None, *, over: bool) -> None:
        # Of a slave that explains it, others report as well; it may be meant to be so.
        facts = {
            "fault": fault.kind,
            "domain": fault.domain,
            "share": fault.share,
            "exchanges": 0 if counts is None else counts.exchanges,
            "failures": 0 if counts is None else counts.of(fault.kind),
            "slaves": list(fault.slaves),
            "over": over,
        }
        level = "warning" if fault.slaves and not over else ""
        self._report("exchange", fault.text, facts, fault.slaves, good=over, level=level)

    async def _find_reason(
        self, domain: DomainImage | None, known: _Kind, kind: str, lasted: float
    ) -> bool:
        """Finds out why, and what to do; returns whether that has changed."""
        before = known.reason
        if kind != WORKING_COUNTER or domain is None:
            known.reason = await self._explain(kind) or self._remedy(kind)
            return known.reason != before
        now = time.monotonic()
        if now - known.asked < _ASK_AGAIN:
            return False
        known.asked = now
        row = self._shared.domain_status[domain.number]
        offset, wrong_by = int(row.wrong_offset), int(row.wrong_by)
        away = self._find_away(now - lasted)
        ask = partial(find_suspects, self._running, domain, offset, wrong_by, away)
        try:
            finding = await self._worker.run(ask)
        except StateError:
            finding = Finding((), ())
        if are_damaged(known.seen):
            finding = Finding((), (), damaged=True)
        if known.slaves and not finding.slaves and not known.exonerated:
            known.exonerated = True  # they may be well again, and the counter right in a moment
            return False
        known.exonerated = False
        expected = next((n.wkc_expected for n in domain.datagrams if n.offset == offset), 0)
        counter = f"{expected + wrong_by} instead of {expected}"
        known.reason = f"the counter was {counter}: {finding.text(self._bus, wrong_by)}"
        known.slaves = finding.slaves
        return known.reason != before


_OVER = {
    WORKING_COUNTER: "working counters are right",
    LOST: "frames come back",
    LATE: "frames come back in time",
    UNSENT: "frames are sent",
}
_REMEDIES = {
    LOST: "`ecatctl errors` shows which cable damages frames; check it and its plugs",
    LATE: "`ecatctl doctor` finds what delays them; or set a longer `cycle_time_us`",
    UNSENT: "`ecatctl doctor` looks at the interface",
}


def _words(kind: str, counts: Counts, lasted: float) -> str:
    """What has failed, such as `12 of 1000 exchanges had … (within 5 s)`."""
    failures = counts.of(kind)
    if kind == WORKING_COUNTER:
        what = f"{failures} of {counts.exchanges} exchanges had a wrong working counter"
    else:
        word = {LOST: "did not come back", LATE: "came back too late", UNSENT: "were not sent"}
        what = f"{failures} frames {word[kind]} in {counts.exchanges} exchanges"
    return f"{what} (within {max(1, round(lasted))} s)"

"""Verdicts on the cables of a bus, from the error counters of the ports at their ends, over time.

Counters say how many errors there were since a power-on, which may be a year ago. A verdict is
about the last hour and the last day. On a line of 100 Mbit/s, 125 million code bits come each
second, whether frames are sent or not. So three errors an hour are a bit error rate of 7e-12, and a
good cable has fewer; 60 an hour are 1e-10, the rate up to which IEEE 802.3 calls a link usable.

What each counter says is in ETG.1000.4 (registers 0x0300 to 0x0313).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from ecatd.etg.port_errors import MOST, PORT_ORDER, PortErrors, SlaveErrors

from .bus import Bus

GOOD, STRAINED, BAD, UNKNOWN = "good", "strained", "bad", "unknown"
VERDICTS = (GOOD, STRAINED, BAD, UNKNOWN)

HOUR, DAY = 3600.0, 86400.0
STRAINED_ERRORS, BAD_ERRORS = 3, 60
"""Errors within an hour."""
STRAINED_LOSSES, BAD_LOSSES = 1, 3
"""Losses of the link within an hour."""
STRAINED_DAY = 24
"""Errors within a day: one an hour."""
_FEWEST_WORSE = 3
"""Fewest errors and losses of an hour that can be an alarm."""
_WATCHED_MIN = 10.0
"""Seconds without an error after which a cable is good, if its counters were not read before."""
_SETTLED = 20.0
"""Seconds for which both ends answer before a loss of the link is the fault of the cable, and not
of a slave that was without power: ecatd knows by then that this slave has restarted."""
_BLIND_MIN = 3
"""Fewest forwarded errors, in one look, that show an error that no slave has counted."""
_AT_MASTER = -1

End = tuple[int, int]
"""Position and port; -1 for the master, with the number of its interface, 0 or 1."""


class LinkVerdict(NamedTuple):
    """What is known of a cable, or of the contacts between two terminals.

    Attributes:
        slave: Position of the slave at the end away from the master.
        port: Its port.
        before: Position of the slave on the side of the master; -1 for the master itself.
        before_port: Its port; of the master: 0 for the first interface, 1 for the second one.
        verdict: One of `VERDICTS`.
        text: Where the cable is, why the verdict is so, and what to do.
        errors: Errors within the last `seconds`.
        lost_links: How often the link was lost within the last `seconds`.
        seconds: For how long the counters were watched, at most an hour.
        worse: How many times as many errors as in the 24 hours before, if that is an alarm
            (`health.cable_factor`); else 0.
    """

    slave: int
    port: int
    before: int
    before_port: int
    verdict: str
    text: str
    errors: int
    lost_links: int
    seconds: float
    worse: float


class Reading(NamedTuple):
    """The counters of all slaves that answer, and the ports with a link.

    Attributes:
        slaves: The counters, with where each port leads.
        up: Ports with a link.
        out: The port at which the second interface is plugged in; None if there is none, or the
            ring is open.
    """

    slaves: Sequence[SlaveErrors]
    up: Collection[End] = ()
    out: End | None = None


class _Buckets:
    """Errors and losses of the last time, in parts of it; parts without any take no memory."""

    def __init__(self, length: float, parts: int) -> None:
        self._length, self._width = length, length / parts
        self._parts: deque[list[float]] = deque()  # begin, errors, losses

    def add(self, now: float, errors: int, losses: int) -> None:
        self._drop(now)
        begin = now - now % self._width
        if not self._parts or self._parts[-1][0] != begin:
            self._parts.append([begin, 0, 0])
        self._parts[-1][1] += errors
        self._parts[-1][2] += losses

    def sums(self, now: float) -> tuple[int, int]:
        self._drop(now)
        return int(sum(part[1] for part in self._parts)), int(sum(part[2] for part in self._parts))

    def _drop(self, now: float) -> None:
        while self._parts and self._parts[0][0] + self._width <= now - self._length:
            self._parts.popleft()


@dataclass(slots=True)
class _Link:
    """What is remembered of one link."""

    before: End
    since: float  # when its counters were first read, or cleared
    hour: _Buckets = field(default_factory=lambda: _Buckets(HOUR, 60))
    day: _Buckets = field(default_factory=lambda: _Buckets(DAY, 24))
    there: bool = True  # both ends have answered, and have a link
    there_since: float = float("-inf")  # since when, after a loss
    waiting: list[int] = field(default_factory=lambda: [0, 0])  # not yet the cable's: see _SETTLED
    full: str = ""  # a counter stands at its maximum: `before`, or `now` if it came there meanwhile
    alarm: bool = False
    told: tuple[str, bool] = (GOOD, False)  # the verdict that was reported last, and an alarm
    lost: dict[End, int] = field(default_factory=dict)  # losses that each end has counted

    def add_losses(self, rises: Mapping[End, int]) -> int:
        """How often the link was lost. Both ends count each loss, but may tell it later."""
        before = max(self.lost.values(), default=0)
        for end, rise in rises.items():
            self.lost[end] = self.lost.get(end, 0) + rise
        return max(self.lost.values(), default=0) - before


class Cables:
    """The cables of one bus. For one thread, but for `restarted`.

    Args:
        bus: The bus.
        factor: An alarm is due if a cable has so many times as many errors in an hour as in the 24
            hours before; 0: never.
    """

    def __init__(self, bus: Bus, factor: float = 0.0) -> None:
        self._bus = bus
        self.factor = factor
        self._links: dict[End, _Link] = {}
        self._counters: dict[End, PortErrors] = {}
        self._restarted: set[int] = set()
        self._answer: set[int] = set()

    def note(self, reading: Reading, now: float) -> None:
        """Takes new counters.

        Args:
            reading: The counters.
            now: CLOCK_MONOTONIC in seconds.
        """
        ports = {(item.position, port.port): port for item in reading.slaves for port in item.ports}
        self._answer = {item.position for item in reading.slaves}
        self._learn(ports, reading.out, now)
        rises = {
            end: _rise(self._counters[end], port)
            for end, port in ports.items()
            if end in self._counters
        }
        restarted, self._restarted = self._restarted, set()
        blind = _blind(self._path(ports), rises, ports)
        for end, link in self._links.items():
            self._note_link(end, link, (ports, rises, reading.up, restarted), blind, now)
        self._counters |= ports

    def _learn(self, ports: Mapping[End, PortErrors], out: End | None, now: float) -> None:
        """Remembers where the links are; a link that is lost keeps its place."""
        found = {end: port.to for end, port in ports.items() if port.to and port.to < end}
        if out is not None:
            found[out] = (_AT_MASTER, 1)
        for end, before in found.items():
            if end not in self._links or self._links[end].before != before:
                self._links[end] = _Link(before, now)
        taken = {before: end for end, before in found.items()}
        for end, link in list(self._links.items()):
            if taken.get(link.before, end) != end:
                del self._links[end]  # another slave is plugged in there now

    def _path(self, ports: Mapping[End, PortErrors]) -> list[End]:
        """The ports at which a frame arrives, in order, on its way out and back."""
        entries = {end[0]: end for end, port in ports.items() if port.to and port.to < end}
        path: list[End] = []
        first = next((end for end, port in ports.items() if port.to == (_AT_MASTER, 0)), None)
        waiting = [] if first is None else [(first, False)]
        while waiting:
            end, back = waiting.pop()
            path.append(end)
            if back or end != entries.get(end[0]):
                continue
            at = PORT_ORDER.index(end[1])
            exits = [
                (end[0], number)
                for number in PORT_ORDER[at + 1 :] + PORT_ORDER[:at]
                if ports[end[0], number].to
            ]
            for leave in reversed(exits):
                to = ports[leave].to
                if to is not None and to[0] > end[0]:
                    waiting += [(leave, True), (to, False)]
        return path

    def _note_link(
        self,
        end: End,
        link: _Link,
        found: tuple[Mapping[End, PortErrors], Mapping[End, PortErrors], Collection[End], set[int]],
        blind: Mapping[End, int],
        now: float,
    ) -> None:
        ports, rises, up, restarted = found
        both = [at for at in (end, link.before) if at[0] != _AT_MASTER]
        errors = sum(_errors(rises[at]) for at in both if at in rises)
        errors += sum(blind.get(at, 0) for at in both)
        losses = link.add_losses({at: rises[at].lost_links for at in both if at in rises})
        was_there = link.there
        link.there = all(at in ports and at in up for at in both)
        if link.there and not was_there:
            link.there_since = now
        self._note_full(link, both, ports)
        if restarted & {at[0] for at in both} or (
            self._optional(end[0], link.before[0]) and (losses or not (link.there and was_there))
        ):
            link.waiting = [0, 0]  # without power, or unplugged on purpose
            return
        link.waiting[0] += errors
        link.waiting[1] += losses
        if link.there and now - link.there_since >= _SETTLED and any(link.waiting):
            link.hour.add(now, *link.waiting)
            link.day.add(now, *link.waiting)
            link.waiting = [0, 0]

    def _note_full(self, link: _Link, both: Sequence[End], ports: Mapping[End, PortErrors]) -> None:
        full = [at for at in both if at in ports and _is_full(ports[at])]
        if not full:
            link.full = ""
        elif not link.full:
            before = [self._counters[at] for at in full if at in self._counters]
            link.full = "now" if any(not _is_full(port) for port in before) else "before"

    def _optional(self, slave: int, before: int) -> bool:
        """Whether a link is where a group is plugged in that may come and go."""
        group = self._bus.slaves[slave].group
        return bool(group) and (before < 0 or self._bus.slaves[before].group != group)

    def restarted(self, position: int) -> None:
        """A slave was without power: the links that were lost with it are not the cables' fault.

        Any thread may call it.
        """
        self._restarted.add(position)

    def forget(self, positions: Collection[int], now: float) -> None:
        """Forgets the past of all links at some slaves: their counters were cleared."""
        for end, link in list(self._links.items()):
            if {end[0], link.before[0]} & {*positions}:
                self._links[end] = _Link(link.before, now)
        self._counters = {
            end: port for end, port in self._counters.items() if end[0] not in positions
        }

    def judge(self, now: float) -> list[LinkVerdict]:
        """The verdicts, each link once, by position and port.

        Args:
            now: CLOCK_MONOTONIC in seconds.
        """
        return [self._judge(end, link, now) for end, link in sorted(self._links.items())]

    def changes(self, now: float) -> list[LinkVerdict]:
        """The verdicts that are news since the call before, each told once.

        A link that is lost now, or was a moment ago, is no news of this kind: events about its
        slaves, or the ring, tell that, and one of them may have had no power.
        """
        found = []
        for end, link in sorted(self._links.items()):
            if not link.there or any(link.waiting):
                continue
            verdict = self._judge(end, link, now)
            told = verdict.verdict, bool(verdict.worse)
            if verdict.verdict != UNKNOWN and told != link.told:
                news = verdict.verdict != link.told[0] or verdict.worse
                link.told = told
                if news:
                    found.append(verdict)
        return found

    def _judge(self, end: End, link: _Link, now: float) -> LinkVerdict:
        watched = now - link.since
        hour, day = link.hour.sums(now), link.day.sums(now)
        errors, losses = (count + more for count, more in zip(hour, link.waiting, strict=True))
        worse = self._worse(link, sum(hour), sum(day), watched)
        verdict, why = self._verdict(end, link, (errors, losses, day[0]), watched)
        if worse:
            why = f"{why}. That is {worse:.0f} times as many as in the 24 hours before"
            verdict = STRAINED if verdict == GOOD else verdict
        text = f"{place(self._bus, link.before, end)}: {why}"
        if verdict in (STRAINED, BAD):
            text += f": {self._advice(link, losses)}"
        ends = (*end, *link.before)
        return LinkVerdict(*ends, verdict, text, errors, losses, min(HOUR, watched), worse)

    def _verdict(
        self, end: End, link: _Link, counts: tuple[int, int, int], watched: float
    ) -> tuple[str, str]:
        errors, losses, of_day = counts
        said = f"{_counted(errors, losses)} within {_time(min(HOUR, watched))}"
        if not link.there and (answer := self._not_there(end, link)):
            return answer
        if errors >= BAD_ERRORS or losses >= BAD_LOSSES:
            return BAD, said
        if link.full == "now":
            return BAD, f"{said}, and a counter has reached {MOST}, at which it stops"
        if errors >= STRAINED_ERRORS or losses >= STRAINED_LOSSES:
            return STRAINED, said
        if of_day >= STRAINED_DAY:
            return STRAINED, f"{_counted(of_day, 0)} within {_time(min(DAY, watched))}"
        if link.full:
            return UNKNOWN, (
                f"a counter stands at {MOST}, its maximum, since before ecatd has watched it: run "
                "`ecatctl errors --reset`, and look again"
            )
        if watched < _WATCHED_MIN:
            return UNKNOWN, f"watched for {watched:.0f} s only, {_counted(errors, losses)}"
        return GOOD, said

    def _not_there(self, end: End, link: _Link) -> tuple[str, str] | None:
        """Why a link is not there, if that is known."""
        behind, before = end[0] in self._answer, link.before[0]
        name = self._bus.slaves[end[0]].label
        if behind and (before < 0 or before in self._answer):
            return BAD, "there is no link, although both sides answer"
        if self._optional(end[0], before):
            return UNKNOWN, f"{name} is not plugged in; it may come and go"
        if before < 0 or before in self._answer:
            return BAD, f"there is no link, and {name} does not answer. Check its power first"
        return UNKNOWN, "no slave at this cable answers, so its counters are not known"

    def _worse(self, link: _Link, last: int, of_day: int, watched: float) -> float:
        """How many times worse the last hour is than the day before, if that is an alarm."""
        hours = min(DAY, watched - HOUR) / HOUR
        link.alarm = link.alarm and self.factor > 0
        if self.factor <= 0 or hours < 1 or last < _FEWEST_WORSE:
            link.alarm = False
            return 0.0
        times = last * hours / max(1, of_day - last)
        link.alarm = times >= (self.factor / 2 if link.alarm else self.factor)
        return round(times, 1) if link.alarm else 0.0

    def _advice(self, link: _Link, losses: int) -> str:
        plug = "reseat or replace this cable (between terminals: their contacts)"
        if losses and link.there:
            return f"unless somebody has unplugged it, {plug}"
        return f"{plug}, and look for sources of interference near it"


def place(bus: Bus, before: End, end: End) -> str:
    """Where a link is: `between slave 3 (EK1122) port 1 and slave 7 (EK1100) port 0`."""
    return f"between {_end(bus, before)} and {_end(bus, end)}"


def _end(bus: Bus, end: End) -> str:
    position, port = end
    if position == _AT_MASTER:
        return "the second interface of the master" if port else "the master"
    return f"{bus.slaves[position].label} port {port}"


def _more(before: int, now: int) -> int:
    """By how much a counter has risen; one that is smaller was cleared, so all of it counts."""
    return now - before if now >= before else now


def _rise(before: PortErrors, now: PortErrors) -> PortErrors:
    return PortErrors.of(now.port, map(_more, before.counts, now.counts), now.to)


def risen(before: Iterable[SlaveErrors], now: Iterable[SlaveErrors]) -> Iterator[SlaveErrors]:
    """By how much the counters have risen between two readings."""
    earlier = {item.position: item for item in before}
    for item in now:
        old = earlier.get(item.position)
        if old is None:
            yield item
            continue
        yield item._replace(
            ports=[_rise(was, port) for was, port in zip(old.ports, item.ports, strict=True)],
            processing=_more(old.processing, item.processing),
            pdi=_more(old.pdi, item.pdi),
        )


def _is_full(port: PortErrors) -> bool:
    """Whether a counter that is about the link of the port counts no further."""
    return MOST in (port.invalid, port.physical, port.lost_links)


def _errors(rise: PortErrors) -> int:
    """Errors of a link: one in a frame is counted twice, as invalid and by the physical layer."""
    return max(rise.invalid, rise.physical)


def _blind(
    path: Sequence[End], rises: Mapping[End, PortErrors], ports: Mapping[End, PortErrors]
) -> dict[End, int]:
    """Errors that a slave has forwarded without counting them, by the port where they came in.

    A slave that cannot count them marks the frame nevertheless, and the next one counts the mark
    as a forwarded error. If no slave before that one has counted an error, the link is the one
    that ends at the slave before it.
    """
    for at, end in enumerate(path):
        if end not in rises:
            return {}
        forwarded = rises[end].forwarded
        if at and forwarded >= _BLIND_MIN and not _errors(rises[end]):
            return {path[at - 1]: forwarded}
        if _errors(rises[end]) or MOST in ports[end].counts:
            return {}  # this one explains what the others have forwarded
    return {}


def _counted(errors: int, losses: int) -> str:
    parts = [
        f"{count} {one if count == 1 else more}"
        for count, one, more in (
            (errors, "error", "errors"),
            (losses, "loss of the link", "losses of the link"),
        )
        if count
    ]
    return " and ".join(parts) or "no errors"


def _time(seconds: float) -> str:
    if seconds < 120:
        return f"{max(1, seconds):.0f} s"
    return f"{seconds / 60:.0f} min" if seconds <= HOUR else f"{seconds / HOUR:.0f} h"

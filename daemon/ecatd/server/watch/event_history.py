"""Numbers the events of a bus, and keeps the last ones for clients that ask later.

A flood of events of one kind about one thing becomes one event with a count, now and then: it must
not push all others out.
"""

from __future__ import annotations

import time
from collections import OrderedDict, deque
from collections.abc import Callable
from typing import Any

from ecatd.base.batch import Batch
from ecatd.operations.events import FACTS

Event = dict[str, Any]

_KEPT = 1000
_BURST, _PER_SECOND = 20, 0.5
"""A flood is more than so many events at once, with so many more each second."""
_ABOUT = ("event", *(name for name, fact in FACTS.items() if fact.subject))
_SUBJECTS_MAX = 1000


class EventHistory:
    """The last events of one run of the daemon. For the thread of the event loop.

    Args:
        send: Called with every event, as a map with its `sequence` and the `instance`.
        instance: Stands for this run of the daemon, as in its shared memory. Each run counts its
            events from 1 on.
    """

    def __init__(self, send: Callable[[Event], None], instance: int) -> None:
        self._send = send
        self._kept: deque[Event] = deque(maxlen=_KEPT)
        self._next = 1
        self._subjects: OrderedDict[tuple[Any, ...], _Subject] = OrderedDict()  # the newest last
        self._instance = instance

    def publish(self, event: Event) -> None:
        """Numbers an event, keeps it, and sends it; in a flood, later and with others."""
        about = tuple(event.get(name) for name in _ABOUT)
        if about not in self._subjects:
            self._subjects[about] = _Subject(self._pass_on)
        self._subjects.move_to_end(about)
        self._subjects[about].publish(event)
        if len(self._subjects) > _SUBJECTS_MAX:
            self._subjects.popitem(last=False)[1].close()

    def _pass_on(self, event: Event) -> None:
        numbered = {"sequence": self._next, "instance": self._instance, **event}
        self._next += 1
        self._kept.append(numbered)
        self._send(numbered)

    def since(self, sequence: int) -> dict[str, Any]:
        """Returns the events of this run from a number on.

        The reply has `instance`, `events`, `next` (the number of the next one), and `left_out`: how
        many from that number on are no longer kept.
        """
        oldest = self._next - len(self._kept)
        return {
            "instance": self._instance,
            "events": [event for event in self._kept if event["sequence"] >= sequence],
            "next": self._next,
            "left_out": max(0, oldest - max(sequence, 1)),
        }

    def close(self) -> None:
        """Passes on what a flood still holds back."""
        for subject in self._subjects.values():
            subject.close()


class _Subject:
    """The events of one kind about one thing.

    Args:
        pass_on: Gets each event, or the last one of several with their number as `times`.
    """

    def __init__(self, pass_on: Callable[[Event], None]) -> None:
        self._pass_on = pass_on
        self._level = 0.0  # rises with each event, and falls with time
        self._at = 0.0
        self._flood = Batch[Event](self._sum_up, most=1)
        self._times = 0  # of those that are held back

    def publish(self, event: Event) -> None:
        """Passes an event on, at once unless there are too many."""
        now = time.monotonic()
        self._level = max(0.0, self._level - _PER_SECOND * (now - self._at))
        self._at = now
        if self._flood.waits or self._level > _BURST - 1:  # they keep their order
            self._level = float(_BURST)
            self._times += event.get("times", 1)
            self._flood.note(event)
        else:
            self._level += 1
            self._pass_on(event)

    def _sum_up(self, last: list[Event], _left_out: int) -> None:
        times, self._times = self._times, 0
        self._pass_on({**last[-1], "times": times} if times > 1 else last[-1])

    def close(self) -> None:
        """Passes on what is held back."""
        self._flood.close()

"""Numbers the events of a bus, and keeps the last ones for clients that ask later."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

_KEPT = 1000


class EventHistory:
    """The last events of a bus.

    Args:
        send: Called with every event, as a map with its `sequence`.
    """

    def __init__(self, send: Callable[[dict[str, Any]], None]) -> None:
        self._send = send
        self._kept: deque[dict[str, Any]] = deque(maxlen=_KEPT)
        self._next = 1

    def publish(self, event: dict[str, Any]) -> None:
        """Numbers an event, keeps it, and sends it."""
        numbered = {"sequence": self._next, **event}
        self._next += 1
        self._kept.append(numbered)
        self._send(numbered)

    def since(self, sequence: int) -> dict[str, Any]:
        """Returns the events from a number on, or all of them if this run has not reached it.

        The reply has `events`, `next` (the number of the next one), and `left_out`: how many from
        that number on are no longer kept.
        """
        first = sequence if sequence <= self._next else 0
        oldest = self._next - len(self._kept)
        events = [event for event in self._kept if event["sequence"] >= first]
        return {"events": events, "next": self._next, "left_out": max(0, oldest - max(first, 1))}

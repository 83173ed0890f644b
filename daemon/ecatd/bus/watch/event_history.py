"""Numbers the events of a bus, and keeps the last ones for clients that ask later."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

_KEPT = 1000


class EventHistory:
    """The last events of one run of the daemon.

    Args:
        send: Called with every event, as a map with its `sequence` and the `instance`.

    Attributes:
        instance: Stands for this run of the daemon, as in its shared memory. Each run counts its
            events from 1 on.
    """

    def __init__(self, send: Callable[[dict[str, Any]], None]) -> None:
        self._send = send
        self._kept: deque[dict[str, Any]] = deque(maxlen=_KEPT)
        self._next = 1
        self.instance = 0

    def publish(self, event: dict[str, Any]) -> None:
        """Numbers an event, keeps it, and sends it."""
        numbered = {"sequence": self._next, "instance": self.instance, **event}
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
            "instance": self.instance,
            "events": [event for event in self._kept if event["sequence"] >= sequence],
            "next": self._next,
            "left_out": max(0, oldest - max(sequence, 1)),
        }

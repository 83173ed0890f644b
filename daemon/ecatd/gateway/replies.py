"""Queries of the network: how many are answered at a time, and who waits for whom.

Zenoh waits for room in the connection of a client that takes no answers, and closes it after
`TAKEN_WITHIN_S`. So replies are sent in threads of their own. While there are as many such clients
as threads, or as queries may be under way, others of the network wait, and nobody of this machine.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from queue import SimpleQueue

TAKEN_WITHIN_S = 2.0
"""Seconds for which Zenoh waits until a connection takes something."""
_UNDER_WAY_MAX = 64
"""Queries that have no answer yet; they take turns with those of this machine."""
_THREADS = 8


class Replies:
    """Replies to queries of the network."""

    def __init__(self) -> None:
        self._places = threading.Semaphore(_UNDER_WAY_MAX)
        self._waiting: SimpleQueue[Callable[[], None]] = SimpleQueue()
        for number in range(_THREADS):
            threading.Thread(target=self._run, name=f"reply {number}", daemon=True).start()

    def enter(self) -> None:
        """Waits for a place for a query, which `send` gives back."""
        self._places.acquire()

    def send(self, reply: Callable[[], None]) -> None:
        """Calls `reply`, which sends it, when a thread is free."""
        self._waiting.put(reply)

    def _run(self) -> None:
        while True:
            reply = self._waiting.get()
            try:
                reply()
            finally:
                self._places.release()

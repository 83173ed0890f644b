"""How many queries are answered at a time, and who waits for whom.

Zenoh waits for room in the connection of a client that takes no answers, such as a program that
somebody has stopped, and closes it after `TAKEN_WITHIN_S`. So replies are sent in threads of their
own, separate ones to the network and to this machine. If such a client has all threads of its kind,
or all queries that may be under way, others of this kind wait until its connection is closed.
Nobody else does, and the gateway works on.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from queue import SimpleQueue

TAKEN_WITHIN_S = 2.0
"""Seconds for which Zenoh waits until a connection takes something."""
UNDER_WAY_MAX = 64
"""Queries of the network that have no answer yet; they take turns with those of this machine."""
UNDER_WAY_HERE_MAX = 512
"""Queries of this machine that have no answer yet: more than may wait for slaves."""
_THREADS = 8


class Replies:
    """Replies to the queries of one Zenoh session.

    Args:
        under_way_max: Most queries that have no answer yet.
    """

    def __init__(self, under_way_max: int) -> None:
        self._places = threading.Semaphore(under_way_max)
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

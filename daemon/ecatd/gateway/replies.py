"""How many queries are answered at a time, and who waits for whom.

Zenoh waits for room in the connection of a client that takes no answers, such as a program that
somebody has stopped, and closes it after `TAKEN_WITHIN_S`. So replies are sent in threads of their
own, separate ones to the network and to this machine. If such a client has all threads of its kind,
or all queries that may be under way, others of this kind wait until its connection is closed.
Nobody else does, and the gateway works on: further queries wait here, and not in the threads in
which Zenoh receives, since these are the same for all its sessions.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextvars import ContextVar
from queue import SimpleQueue

TAKEN_WITHIN_S = 2.0
"""Seconds for which Zenoh waits until a connection takes something."""
UNDER_WAY_MAX = 64
"""Queries of the network that have no answer yet; they take turns with those of this machine."""
UNDER_WAY_HERE_MAX = 512
"""Queries of this machine that have no answer yet: more than may wait for slaves."""
IS_HERE: ContextVar[bool] = ContextVar("IS_HERE", default=True)
"""Whether the query that is being answered comes from this machine, which has places of its own."""
_THREADS = 8
_ROOM, _QUERY_BYTES = 32 << 20, 2048
"""Most bytes of queries that wait to be under way, and what one takes without its payload."""


class Replies:
    """Replies to the queries of one Zenoh session.

    Args:
        under_way_max: Most queries that have no answer yet.
        are_here: Whether they are those of this machine.

    Attributes:
        are_here: As above.
    """

    def __init__(self, under_way_max: int, *, are_here: bool) -> None:
        self.are_here = are_here
        self._places = threading.Semaphore(under_way_max)
        self._queries: SimpleQueue[tuple[int, Callable[[], None]]] = SimpleQueue()
        self._room, self._free = threading.Condition(), _ROOM
        self._waiting: SimpleQueue[Callable[[], None]] = SimpleQueue()
        threading.Thread(target=self._begin, name="queries", daemon=True).start()
        for number in range(_THREADS):
            threading.Thread(target=self._run, name=f"reply {number}", daemon=True).start()

    def take(self, begin: Callable[[], None], size: int) -> None:
        """Calls `begin`, after which `send` must follow, when there is a place for a query.

        Waits itself only if too much waits already.

        Args:
            begin: Begins to answer the query.
            size: Bytes of its payload.
        """
        size += _QUERY_BYTES
        with self._room:
            self._room.wait_for(lambda: self._free >= size)
            self._free -= size
        self._queries.put((size, begin))

    def send(self, reply: Callable[[], None]) -> None:
        """Calls `reply`, which sends it, when a thread is free."""
        self._waiting.put(reply)

    def _begin(self) -> None:
        while True:
            size, begin = self._queries.get()
            self._places.acquire()
            begin()
            with self._room:
                self._free += size
                self._room.notify_all()

    def _run(self) -> None:
        while True:
            reply = self._waiting.get()
            try:
                reply()
            finally:
                self._places.release()

"""The gateway's two Zenoh sessions: one for this machine, and one for the network.

Each has places of its own for its clients, so whatever happens at the addresses of the network,
members of the group are served at the Unix socket. Both offer the same keys.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from functools import partial

import zenoh

from .replies import UNDER_WAY_HERE_MAX, UNDER_WAY_MAX, Replies

_CLOSE_PATIENCE = 1.0
"""Seconds that Zenoh has to close its sessions."""


class Sessions:
    """The sessions, used as one.

    Args:
        sessions: The sessions; that of this machine is the first one.
    """

    def __init__(self, sessions: Sequence[zenoh.Session]) -> None:
        self._sessions = sessions
        network = sessions[1:]
        self._replies = [
            Replies(UNDER_WAY_HERE_MAX, are_here=True),
            *(Replies(UNDER_WAY_MAX, are_here=False) for _ in network),
        ]
        self._kept: list[object] = []  # else Zenoh ends them

    @property
    def network(self) -> zenoh.Session:
        """The one that connects to routers."""
        return self._sessions[-1]

    def serve(self, key: str, receive: Callable[[zenoh.Query, Replies], None]) -> None:
        """Calls `receive` with each query at a key, and with what sends its reply."""
        for session, replies in zip(self._sessions, self._replies, strict=True):
            take = partial(self._take, replies, receive)
            self._kept.append(session.declare_queryable(key, take))

    @staticmethod
    def _take(
        replies: Replies, receive: Callable[[zenoh.Query, Replies], None], query: zenoh.Query
    ) -> None:
        size = 0 if query.payload is None else len(query.payload)
        replies.take(partial(receive, query, replies), size)

    def be_alive(self, key: str) -> None:
        """Declares a liveliness token."""
        self._kept += [item.liveliness().declare_token(key) for item in self._sessions]

    def put(self, key: str, content: bytes) -> None:
        """Publishes something."""
        for item in self._sessions:
            item.put(key, content)

    def publisher(self, key: str) -> Publisher:
        """Makes a publisher."""
        return Publisher([item.declare_publisher(key) for item in self._sessions])

    def close(self) -> None:
        """Closes them."""
        # While Zenoh tries an address, closing takes 10 s. Ending this process is quicker.
        closing = [threading.Thread(target=item.close, daemon=True) for item in self._sessions]
        for thread in closing:
            thread.start()
        for thread in closing:
            thread.join(_CLOSE_PATIENCE)


class Publisher:
    """Publishes at a key in all sessions in which somebody listens.

    Args:
        publishers: Those of the sessions.
    """

    def __init__(self, publishers: Sequence[zenoh.Publisher]) -> None:
        self._publishers = publishers

    @property
    def is_wanted(self) -> bool:
        """Whether somebody listens."""
        return any(
            item.matching_status.matching  # type: ignore[attr-defined]
            for item in self._publishers
        )

    def put(self, content: bytes) -> None:
        """Publishes something."""
        for item in self._publishers:
            item.put(content)

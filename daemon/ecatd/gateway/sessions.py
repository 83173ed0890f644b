"""The gateway's two Zenoh sessions: one for this machine, and one for the network.

Each has places of its own for its clients, so whatever happens at the addresses of the network,
members of the group are served at the Unix socket. Both offer the same keys.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

import zenoh

from .replies import Replies

_CLOSE_PATIENCE = 1.0
"""Seconds that Zenoh has to close its sessions."""


class Sessions:
    """The sessions, used as one.

    Args:
        sessions: The sessions; that of this machine is the first one.
    """

    def __init__(self, sessions: Sequence[zenoh.Session]) -> None:
        self._sessions = sessions
        self._replies = Replies() if len(sessions) > 1 else None
        self._kept: list[object] = []  # else Zenoh ends them

    @property
    def network(self) -> zenoh.Session:
        """The one that connects to routers."""
        return self._sessions[-1]

    def serve(self, key: str, receive: Callable[[zenoh.Query, Replies | None], None]) -> None:
        """Calls `receive` with queries at a key; those of the network bring their replies."""

        def from_network(query: zenoh.Query) -> None:
            assert self._replies is not None
            self._replies.enter()
            receive(query, self._replies)

        here, *network = self._sessions
        self._kept.append(here.declare_queryable(key, lambda query: receive(query, None)))
        self._kept += [item.declare_queryable(key, from_network) for item in network]

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

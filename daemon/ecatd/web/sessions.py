"""Who has come in: sessions of browsers, each with what its user may see."""

from __future__ import annotations

import asyncio
import hashlib
import secrets
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

from websockets.asyncio.server import ServerConnection

from ecatd.base.errors import UsageError

from .hub import Hub

SESSION_S = 12 * 3600
"""Seconds for which a login holds: a shift."""
_SESSIONS_MAX, _OF_A_USER_MAX = 32, 8
_BUSES_MAX = 8
_ENDED = 4401
"""Why a WebSocket is closed when its session has ended."""


class Account:
    """A user, with one hub for each bus that pages of this user look at.

    Args:
        user: The name; empty for the one who has started the server.
        hub_of: Makes the hub of a bus; of the usual one for an empty name.
    """

    def __init__(self, user: str, hub_of: Callable[[str], Hub]) -> None:
        self.user = user
        self._hub_of = hub_of
        self._hubs: dict[str, Hub] = {}

    @property
    def pages(self) -> int:
        """The number of its open pages."""
        return sum(len(hub.pages) for hub in self._hubs.values())

    def hub(self, bus: str) -> Hub:
        """The hub of a bus.

        Raises:
            UsageError: It is no name of a bus, or pages look at too many already.
        """
        if bus not in self._hubs:
            self._hubs = {name: hub for name, hub in self._hubs.items() if hub.pages}
            if len(self._hubs) >= _BUSES_MAX:
                raise UsageError(f"pages look at {_BUSES_MAX} buses already: close one")
            self._hubs[bus] = self._hub_of(bus)
        return self._hubs[bus]


@dataclass(slots=True, eq=False)
class Session:
    """A browser that has come in.

    Attributes:
        account: Whose.
        connections: The WebSockets of its pages.
        ends: What ends it, if anything does.
        is_over: Whether it has ended.
    """

    account: Account
    connections: set[ServerConnection] = field(default_factory=set)
    ends: asyncio.TimerHandle | None = None
    is_over: bool = False


class Sessions:
    """The sessions, by a digest of the secret in the cookie: a look-up tells nothing of a secret.

    Args:
        lasts_s: Seconds for which each holds; None: as long as the server.
    """

    def __init__(self, lasts_s: float | None) -> None:
        self._lasts_s = lasts_s
        self._sessions: dict[bytes, Session] = {}  # in the order in which they have begun

    def begin(self, account: Account) -> str:
        """Begins a session; returns its secret.

        Of too many of a user, the oldest one ends; of too many of all, that of the user with most.
        """
        counts = Counter(item.account.user for item in self._sessions.values())
        user = account.user
        if counts[user] >= _OF_A_USER_MAX:
            self._end_oldest(user)
        elif len(self._sessions) >= _SESSIONS_MAX:
            self._end_oldest(counts.most_common(1)[0][0])
        secret = secrets.token_urlsafe(32)
        key = _digest(secret)
        self._sessions[key] = session = Session(account)
        if self._lasts_s is not None:
            loop = asyncio.get_running_loop()
            session.ends = loop.call_later(self._lasts_s, self._end, key)
        return secret

    def find(self, secret: str) -> Session | None:
        """The session with a secret; None if there is none, or it has ended."""
        return self._sessions.get(_digest(secret))

    def account(self, user: str) -> Account | None:
        """The account of a user with a session."""
        found = (item.account for item in self._sessions.values() if item.account.user == user)
        return next(found, None)

    def end(self, secret: str) -> None:
        """Ends a session and closes its pages, if there is one."""
        self._end(_digest(secret))

    def _end_oldest(self, user: str) -> None:
        self._end(next(k for k, item in self._sessions.items() if item.account.user == user))

    def _end(self, key: bytes) -> None:
        session = self._sessions.pop(key, None)
        if session is None:
            return
        session.is_over = True
        if session.ends is not None:
            session.ends.cancel()
        for connection in session.connections:
            task = asyncio.ensure_future(connection.close(_ENDED, "the session has ended"))
            task.add_done_callback(lambda done: done.cancelled() or done.exception())


def _digest(secret: str) -> bytes:
    return hashlib.sha256(secret.encode(errors="replace")).digest()

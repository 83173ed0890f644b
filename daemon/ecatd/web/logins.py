"""How the page comes in: with the token that was printed, or as a user with a password.

The server has no rights of its own over those who log in. The file of a user is an identity as
`ecatctl remote user` makes it, but its private key is locked with the password: no password, no
key. With the key, the server connects to the gateway as this user, who has there the rights of
`[[gateway.user]]`. So the gateway believes the certificate, and nothing that the server says; and
whoever takes the server over is at most those users who are logged in at that time.
"""

from __future__ import annotations

import base64
import binascii
import math
import secrets
import time
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from ecatd.base.daemon_threads import in_daemon_thread
from ecatd.base.errors import BusyError, EcatError, NotPermittedError
from ecatd.client.identity import Identity, read_identity
from ecatd.config.gateway import USER_NAME

from .hub import Hub
from .sessions import Account, Sessions
from .turns import Turns, network

_BURST, _EVERY_S = 10, 6.0
"""Tries of an address at once, and seconds until it has another one."""
_ADDRESSES_MAX = 1000
_WRONG = "User and password do not fit."


class Entrance(Protocol):
    """A way to come in."""

    by: str  #: `token` or `password`: what the page must ask for.
    advice: str  #: What to do without.

    async def account(self, shown: str, address: str) -> Account:
        """Whose a header `Authorization` is.

        Raises:
            EcatError: Nobody's, or it was tried too often.
        """


class TokenEntrance:
    """Who has the address that was printed is the user who has started the server.

    Args:
        account: The account of this user.
    """

    by = "token"
    advice = (
        "`ecatctl web` has printed the address with a token: open that one, or start it again. "
        "Each start has another token."
    )

    def __init__(self, account: Account) -> None:
        self.token = secrets.token_urlsafe(32)
        self._account = account

    async def account(self, shown: str, address: str) -> Account:
        """See `Entrance`."""
        expected = f"Bearer {self.token}"
        if not secrets.compare_digest(shown.encode(errors="replace"), expected.encode()):
            raise NotPermittedError(self.advice)
        return self._account


class PasswordEntrance:
    """Users with a password.

    Args:
        folder: The folder with a file of each user.
        sessions: The sessions, in which a user may be already.
        hub_of: Makes the hub of a bus for an identity.
    """

    by = "password"
    advice = "Log in. `sudo ecatctl remote login NAME` on the machine of the server makes a login."

    def __init__(
        self, folder: Path, sessions: Sessions, hub_of: Callable[[str, Identity], Hub]
    ) -> None:
        self._folder = folder
        self._sessions = sessions
        self._hub_of = hub_of
        self._attempts = Attempts()
        self._turns = Turns()

    async def account(self, shown: str, address: str) -> Account:
        """See `Entrance`."""
        user, password = _basic(shown)
        if not password:  # the page only asks who it is
            raise NotPermittedError(self.advice)
        near = network(address)
        self._attempts.count(near)
        async with self._turns.turn(near):
            identity = await in_daemon_thread(lambda: self._unlocked(user, password))
        if identity is None:
            raise NotPermittedError(_WRONG)
        self._turns.know(near)
        found = self._sessions.account(user)
        return found or Account(user, lambda bus: self._hub_of(bus, identity))

    def _unlocked(self, user: str, password: str) -> Identity | None:
        """The identity of a user; None if there is no such user, or the password is wrong."""
        found = self._read(user)
        # Without such a user the same work is done for another one: so the time tells nobody who
        # has a login.
        others = sorted(self._folder.glob("*.pem")) if found is None else []
        tried = found or next(filter(None, (self._read(file.stem) for file in others)), None)
        if tried is None:
            return None
        with suppress(EcatError):
            unlocked = tried.unlock(password)
            return unlocked if found is not None else None
        return None

    def _read(self, user: str) -> Identity | None:
        if not USER_NAME.fullmatch(user):
            return None
        with suppress(EcatError):
            found = read_identity(self._folder / f"{user}.pem")
            # A file with an open key would let everybody in.
            return found if found.user == user and found.is_locked else None
        return None


class Attempts:
    """Counts tries of each address, so that passwords cannot be guessed.

    Args:
        clock: The time in seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._next: OrderedDict[str, float] = OrderedDict()  # when the next one would be on time

    def count(self, address: str) -> None:
        """Counts one.

        Raises:
            BusyError: There were too many.
        """
        now = self._clock()
        begin = max(self._next.get(address, -math.inf), now - _BURST * _EVERY_S)
        if begin + _EVERY_S > now:
            wait = math.ceil(begin + _EVERY_S - now)
            raise BusyError(f"Too many tries from this address: wait {wait} s.")
        self._next[address] = begin + _EVERY_S
        self._next.move_to_end(address)
        if len(self._next) > _ADDRESSES_MAX:
            self._next.popitem(last=False)


def _basic(shown: str) -> tuple[str, str]:
    """User and password of a header (RFC 7617, in UTF-8); empty if it has none."""
    kind, _, text = shown.partition(" ")
    with suppress(binascii.Error, UnicodeDecodeError):
        user, colon, password = base64.b64decode(text, validate=True).decode().partition(":")
        if kind == "Basic" and colon and password.isprintable():
            return user, password
    return "", ""

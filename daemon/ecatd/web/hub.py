"""What all pages are told, and what they want."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Coroutine, Iterable, Mapping
from typing import Any, Protocol

from ecatd.base.errors import EcatError
from ecatd.base.version import VERSION

from .messages import encode, failure
from .page import Page

_EVENTS_MAX = 1000


class Source(Protocol):
    """Where values come from: a daemon, or a file."""

    kind: str  #: `bus` or `file`.
    title: str  #: Name of the bus, or of the file.
    may: tuple[str, ...]  #: The rights of pages.
    user: str  #: The user of the daemon who looks; empty if the way there knows none.
    buses: tuple[str, ...]  #: The buses that can be looked at, if there is a choice.

    def run(self, hub: Hub) -> Coroutine[Any, Any, None]:
        """Tells the pages what there is until it is cancelled; while no page is open, it rests."""

    async def ask(
        self, key: str, parameters: Mapping[str, Any], payload: Mapping[str, Any]
    ) -> Mapping[str, Any]:
        """Answers a question; raises EcatError."""

    def wish(self, page: Page) -> None:
        """A page wants other signals in each cycle."""


class Hub:
    """All pages, and the latest of all that they were told, for those that come later.

    Args:
        source: Where values come from.

    Attributes:
        pages: The pages.
        signals: The signals, by name.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self.pages: set[Page] = set()
        self.signals: Mapping[str, Any] = {}
        self._latest: dict[str, str] = {}
        self._events: deque[str] = deque(maxlen=_EVENTS_MAX)
        self._left_out = 0
        self._link: tuple[bool, str] | None = None
        self._task: asyncio.Task[None] | None = None

    async def serve(self, page: Page) -> None:
        """Serves a page until it is closed."""
        source = self._source
        hello = {"type": "hello", "version": VERSION, "source": source.kind, "title": source.title}
        page.tell("hello", encode(hello | self._rights()))
        for key, text in self._latest.items():
            page.tell(key, text)
        page.tell_events([*self._events], self._left_out)
        self.pages.add(page)
        if self._task is None:
            self._task = asyncio.create_task(source.run(self))
        try:
            await page.run()
        finally:
            self.pages.discard(page)
            page.signals = ()
            source.wish(page)
            if not self.pages:
                await self.rest()

    async def rest(self) -> None:
        """Watches nothing until a page comes, and forgets what would be old by then."""
        if self._task is not None:
            task, self._task = self._task, None
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
            self._latest.clear()
            self.forget_events()
            self._link = None

    async def ask(
        self, key: str, parameters: Mapping[str, Any], payload: Mapping[str, Any]
    ) -> Mapping[str, Any]:
        """Answers a question of a page; raises EcatError."""
        return await self._source.ask(key, parameters, payload)

    def wish(self, page: Page) -> None:
        """A page wants other signals in each cycle."""
        self._source.wish(page)

    def rights(self) -> None:
        """Tells what pages may, who looks, and which buses there are: something has changed."""
        for page in self.pages:
            page.tell("rights", encode({"type": "rights", **self._rights()}))

    def _rights(self) -> dict[str, Any]:
        source = self._source
        return {"may": source.may, "user": source.user, "buses": source.buses}

    def link(self, up: bool, text: str) -> None:
        """Tells how the way to the daemon is, if that is new."""
        if self._link != (up, text):
            self._link = (up, text)
            self._tell("link", {"type": "link", "up": up, "text": text, "since": time.time()})

    def describe(self, signals: Iterable[Mapping[str, Any]], shown: Iterable[str] = ()) -> None:
        """Tells which signals there are, and the names of those that the scope shows at first."""
        self.signals = {signal["name"]: signal for signal in signals}
        message = {"type": "signals", "signals": [*self.signals.values()], "shown": [*shown]}
        self._tell("signals", message)

    def value(
        self,
        key: str,
        answer: Mapping[str, Any] | EcatError,
        at: float | None = None,
        *,
        only: Page | None = None,
    ) -> None:
        """Tells what was found out about a key, or why nothing.

        Args:
            key: The key.
            answer: The answer, or the reason.
            at: Unix time, if not now.
            only: The page that it concerns; by default all.
        """
        at = time.time() if at is None else at
        message: dict[str, Any] = {"type": "value", "key": key, "at": at}
        if isinstance(answer, EcatError):
            message |= {"value": None, "failure": failure(answer)}
        else:
            message["value"] = answer
        if only is None:
            self._tell(key, message)
        else:
            only.tell(key, encode(message))

    def lamps(self, lamps: Iterable[Mapping[str, Any]], at: float) -> None:
        """Tells the lamps as they were at a Unix time."""
        self._tell("lamps", {"type": "lamps", "lamps": [*lamps], "at": at})

    def events(self, events: Iterable[Mapping[str, Any]], left_out: int) -> None:
        """Tells new events."""
        texts = [encode(event) for event in events]
        if texts or left_out:
            self._events.extend(texts)
            self._left_out += left_out
            for page in self.pages:
                page.tell_events(texts, left_out)

    def forget_events(self) -> None:
        """Begins anew with events: they were those of another run of the daemon."""
        self._events.clear()
        self._left_out = 0

    def end(self, page: Page) -> None:
        """Tells a page that it has all of a file."""
        page.tell("end", encode({"type": "end"}))

    def _tell(self, key: str, message: Mapping[str, Any]) -> None:
        text = encode(message)
        self._latest[key] = text
        for page in self.pages:
            page.tell(key, text)

"""One trace for all pages: the values of all their signals in each cycle.

If a page wants other signals, another trace is opened beside the present one, and takes over at the
cycle at which it begins: no page misses a cycle because of another one. `feed.py` brings the trace
to each page.
"""

from __future__ import annotations

import asyncio
import threading
import time
from array import array
from collections import deque
from collections.abc import AsyncGenerator, Iterable, Sequence
from contextlib import suppress

from ecatd.base.daemon_threads import in_daemon_thread
from ecatd.base.errors import EcatError, UsageError
from ecatd.client.remote import Remote
from ecatd.client.trace import Batch, Trace, read_batch
from ecatd.operations.traces import OpenTrace, ReadHistory, TraceSignal

from .batch import Cycles
from .feed import Feed
from .hub import Hub
from .page import Page
from .signals import pattern

HISTORY_S = 10.0
"""Seconds with which a signal begins, if the daemon keeps them: what the scope shows at first."""
_SIGNALS_MAX = 2000
"""Signals of all pages together: four pages, each with all it can have."""
_SETTLE_S = 0.05
"""Seconds for which more wishes are waited for: people choose several signals at once."""
_RETRY_S = 1.0
_TAKE_OVER_S = 2.0
"""Seconds for which the cycles of the next trace wait for those before them."""
_HELD_MAX = 200
"""Batches that wait for that."""


class Traces:
    """The trace of all pages.

    Args:
        hub: The pages.
    """

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._remote: Remote | None = None
        self._changed = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._now: _Running | None = None
        self._next: _Running | None = None
        self._feeds: dict[Page, Feed] = {}
        self._has_failed = False

    def use(self, remote: Remote | None) -> None:
        """Uses another session from now on, or none."""
        if self._task is not None:
            self._task.cancel()
            self._task = None
        for trace in (self._now, self._next):
            if trace is not None:
                trace.stop()
        self._now = self._next = None
        for feed in self._feeds.values():
            feed.stop()
        self._feeds.clear()
        self._remote = remote
        if remote is not None:
            self._changed.set()
            self._task = asyncio.create_task(self._run(remote))

    def wish(self) -> None:
        """Pages want other signals."""
        self._changed.set()

    async def _run(self, remote: Remote) -> None:
        while True:
            await self._changed.wait()
            await asyncio.sleep(_SETTLE_S)
            self._changed.clear()
            for page in [page for page in self._feeds if not page.signals]:
                self._feeds.pop(page).stop()
            names = self._wanted()
            latest = self._next or self._now
            if not names:
                for trace in (self._now, self._next):
                    if trace is not None:
                        trace.stop()
                self._now = self._next = None
                self._succeed()  # nothing is missing
                continue
            if latest is not None and set(names) == latest.names and not latest.has_ended:
                continue
            if self._next is not None:
                self._next.stop()
                self._next = None
            try:
                trace = await self._open(remote, names)
            except EcatError as error:
                self._fail(error)
                continue
            if self._now is None or self._now.has_ended:
                self._now = trace
            else:
                self._next = trace

    def _wanted(self) -> list[str]:
        """The signals of all pages. Those that want the most get none if they are too many."""
        wanted: set[str] = set()
        for page in sorted(self._hub.pages, key=lambda page: len(page.signals)):
            more = wanted.union(name for name in page.signals if name in self._hub.signals)
            if len(more) <= _SIGNALS_MAX:
                wanted = more
            else:
                error = UsageError(
                    f"with this page, all pages together want {len(more)} signals: at most "
                    f"{_SIGNALS_MAX} are possible. Remove some here, or close other pages"
                )
                self._hub.value(OpenTrace.key, error, only=page)
        return sorted(wanted)

    async def _open(self, remote: Remote, names: list[str]) -> _Running:
        patterns = _patterns(names)
        opened = await in_daemon_thread(lambda: remote.request(OpenTrace(patterns)))
        columns = _columns(opened["signals"], self._hub)
        running = _Running(names, columns, opened["cycle_time_us"] / 1e6, self)
        trace = await in_daemon_thread(lambda: Trace(remote.zenoh, opened, remote.timeout))
        running.start(trace)
        self._succeed()
        return running

    def _succeed(self) -> None:
        """Tells that values come, if that has failed."""
        if self._has_failed:
            self._has_failed = False
            self._hub.value(OpenTrace.key, {})

    def _fail(self, error: EcatError) -> None:
        """Tells why there are no values, and tries again."""
        self._has_failed = True
        self._hub.value(OpenTrace.key, error)
        asyncio.get_running_loop().call_later(_RETRY_S, self._changed.set)

    def take(self, trace: _Running, cycles: Cycles) -> None:
        """Takes the next cycles of a trace."""
        if trace is self._now:
            self._hand_out(trace, cycles)
        elif trace is self._next:
            trace.held.append(cycles)
        self._take_over()

    def _take_over(self) -> None:
        """Goes on with the next trace, as soon as the present one has all cycles before it."""
        after = self._next
        if after is None or not after.held:
            return
        now = self._now
        is_due = now is None or now.has_ended or now.last >= after.held[0].numbers[0] - 1
        is_late = time.monotonic() > after.began + _TAKE_OVER_S or len(after.held) > _HELD_MAX
        if is_due or is_late:
            if now is not None:
                now.stop()
            self._now, self._next = after, None
            for cycles in after.held:
                self._hand_out(after, cycles)
            after.held.clear()

    def _hand_out(self, trace: _Running, cycles: Cycles) -> None:
        trace.last = cycles.numbers[-1]
        for page in self._hub.pages:
            if page.signals:
                if page not in self._feeds:
                    self._feeds[page] = Feed(page, self._history)
                self._feeds[page].take(cycles, trace.names)

    async def _history(
        self, page: Page, names: Sequence[str], end: int
    ) -> AsyncGenerator[Cycles, None]:
        """The last seconds of some signals before a cycle, as far as the daemon keeps them."""
        remote, trace = self._remote, self._now
        if remote is None or trace is None:  # it has just ended
            return
        patterns = _patterns(names)
        columns: list[tuple[str, str]] = []
        begin, more = max(1, end - round(HISTORY_S / trace.cycle_time)), True
        while more:
            ask = ReadHistory(patterns, begin, end)
            try:
                part = await in_daemon_thread(lambda: remote.request(ask))  # noqa: B023
            except EcatError as error:  # the signals begin now
                self._hub.value(OpenTrace.key, {"history_s": 0.0, "why": str(error)}, only=page)
                return
            if not columns:
                columns = _columns(part["signals"], self._hub)
                seconds = (end - part["begin"]) * trace.cycle_time
                self._hub.value(OpenTrace.key, {"history_s": seconds}, only=page)
            begin, more = part["next"], part["more"]
            if part["batch"]["cycles"]:
                yield _cycles(read_batch(part["batch"], part["signals"]), columns)

    def ended(self, trace: _Running, error: EcatError) -> None:
        """A trace has ended."""
        if trace in (self._now, self._next):
            self._fail(error)
            self._take_over()


class _Running:
    """A trace that is read by a thread.

    Args:
        names: The signals that pages want of it.
        columns: See `_columns`.
        cycle_time: Seconds of a cycle.
        traces: Who gets its cycles.

    Attributes:
        names: The signals that it has.
        cycle_time: Seconds of a cycle.
        held: Cycles that wait for the trace before.
        last: The last cycle that was handed out.
        began: When it was opened, by `time.monotonic`.
        has_ended: Whether there will be no more.
    """

    def __init__(
        self,
        names: Sequence[str],
        columns: Sequence[tuple[str, str]],
        cycle_time: float,
        traces: Traces,
    ) -> None:
        self.names = frozenset(names) & {name for name, _ in columns}
        self.cycle_time = cycle_time
        self._columns = columns
        self._traces = traces
        self._loop = asyncio.get_running_loop()
        self._stops = threading.Event()
        self.held: list[Cycles] = []
        self.last = 0.0
        self.began = time.monotonic()
        self.has_ended = False

    def start(self, trace: Trace) -> None:
        """Begins to read."""
        threading.Thread(target=self._read, args=(trace,), daemon=True).start()

    def stop(self) -> None:
        """Reads no more."""
        self.has_ended = True
        self._stops.set()

    def _read(self, trace: Trace) -> None:
        with suppress(RuntimeError):  # the loop has ended
            try:
                with trace:
                    for batch in trace:
                        if self._stops.is_set():
                            return
                        cycles = _cycles(batch, self._columns)
                        self._loop.call_soon_threadsafe(self._traces.take, self, cycles)
            except EcatError as error:
                if not self._stops.is_set():
                    self._loop.call_soon_threadsafe(self._end, error)

    def _end(self, error: EcatError) -> None:
        if not self.has_ended:
            self.stop()
            self._traces.ended(self, error)


def _cycles(batch: Batch, columns: Sequence[tuple[str, str]]) -> Cycles:
    """A batch for pages.

    Args:
        batch: The batch.
        columns: See `_columns`.
    """
    names = [name for name, _ in columns]
    return Cycles(
        array("d", batch.cycles),
        array("d", [utc_ns / 1e6 for utc_ns in batch.utc_ns]),
        {name: column for name, column in zip(names, batch.columns, strict=True) if name},
        dict(columns),
        {names[at]: places for at, places in batch.invalid.items() if names[at]},
        batch.lost,
    )


def _patterns(names: Iterable[str]) -> str:
    return "\n".join(sorted({pattern(name) for name in names}))


def _columns(signals: Sequence[TraceSignal], hub: Hub) -> list[tuple[str, str]]:
    """The name here, and the type, of each column of a trace; no name if nobody wants it."""
    names: dict[tuple[int, str, bool], deque[str]] = {}
    for name, known in hub.signals.items():
        what = (known["slave"], known["address"], known["output"])
        names.setdefault(what, deque()).append(name)
    found = []
    for signal in signals:
        left = names.get((signal["slave"], signal["address"], signal["output"]))
        found.append((left.popleft() if left else "", signal["type"]))
    return found

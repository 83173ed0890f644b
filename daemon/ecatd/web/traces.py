"""One trace for all pages: the values of all their signals in each cycle.

If a page wants other signals, another trace is opened beside the present one, and takes over at the
cycle at which it begins: no page misses a cycle because of another one.
"""

from __future__ import annotations

import asyncio
import threading
import time
from array import array
from collections.abc import Sequence
from contextlib import suppress

from ecatd.base.daemon_threads import in_daemon_thread
from ecatd.base.errors import EcatError, UsageError
from ecatd.client.remote import Remote
from ecatd.client.trace import Batch, Trace
from ecatd.operations.traces import OpenTrace, TraceSignal

from .batch import Cycles
from .hub import Hub
from .page import SIGNALS_MAX, Page
from .signals import pattern

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
        self._sent: dict[Page, tuple[float, Sequence[str], int]] = {}
        """For each page the last cycle that it has, its signals, and the number of that wish."""

    def use(self, remote: Remote | None) -> None:
        """Uses another session from now on, or none."""
        if self._task is not None:
            self._task.cancel()
            self._task = None
        for trace in (self._now, self._next):
            if trace is not None:
                trace.stop()
        self._now = self._next = None
        self._sent.clear()
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
            self._sent = {page: sent for page, sent in self._sent.items() if page.signals}
            names = self._wanted()
            latest = self._next or self._now
            if not names:
                for trace in (self._now, self._next):
                    if trace is not None:
                        trace.stop()
                self._now = self._next = None
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
        wanted = dict.fromkeys(name for page in self._hub.pages for name in page.signals)
        return sorted(name for name in wanted if name in self._hub.signals)

    async def _open(self, remote: Remote, names: list[str]) -> _Running:
        if len(names) > SIGNALS_MAX:
            raise UsageError(
                f"all pages together want {len(names)} signals: at most {SIGNALS_MAX} are possible"
            )
        patterns = sorted({pattern(name) for name in names})
        opened = await in_daemon_thread(lambda: remote.request(OpenTrace("\n".join(patterns))))
        running = _Running(names, _columns(opened["signals"], self._hub), self)
        trace = await in_daemon_thread(lambda: Trace(remote.zenoh, opened, remote.timeout))
        running.start(trace)
        return running

    def _fail(self, error: EcatError) -> None:
        """Tells why there are no values, and tries again."""
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
            last, names, generation = self._sent.get(page, (0.0, (), -1))
            if generation != page.generation and trace.names.issuperset(page.signals):
                names, generation = page.signals, page.generation
            new = cycles.after(last)
            if new is not None and names and trace.names.issuperset(names):
                page.tell_cycles(new, names, generation)
            self._sent[page] = (cycles.numbers[-1], names, generation)

    def ended(self, trace: _Running, error: EcatError) -> None:
        """A trace has ended."""
        if trace in (self._now, self._next):
            self._fail(error)
            self._take_over()


class _Running:
    """A trace that is read by a thread.

    Args:
        names: The signals that pages want of it.
        columns: The names of its columns; empty for a column that nobody wants.
        traces: Who gets its cycles.

    Attributes:
        names: The signals that it has.
        held: Cycles that wait for the trace before.
        last: The last cycle that was handed out.
        began: When it was opened, by `time.monotonic`.
        has_ended: Whether there will be no more.
    """

    def __init__(
        self, names: Sequence[str], columns: Sequence[tuple[str, str]], traces: Traces
    ) -> None:
        self.names = frozenset(names) & {name for name, _ in columns}
        self._columns = columns
        self._types = dict(columns)
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
                        cycles = self._cycles(batch)
                        self._loop.call_soon_threadsafe(self._traces.take, self, cycles)
            except EcatError as error:
                if not self._stops.is_set():
                    self._loop.call_soon_threadsafe(self._end, error)

    def _end(self, error: EcatError) -> None:
        if not self.has_ended:
            self.stop()
            self._traces.ended(self, error)

    def _cycles(self, batch: Batch) -> Cycles:
        names = [name for name, _ in self._columns]
        return Cycles(
            array("d", batch.cycles),
            array("d", [utc_ns / 1e6 for utc_ns in batch.utc_ns]),
            {name: column for name, column in zip(names, batch.columns, strict=True) if name},
            self._types,
            {names[at]: places for at, places in batch.invalid.items() if names[at]},
            batch.lost,
        )


def _columns(signals: Sequence[TraceSignal], hub: Hub) -> list[tuple[str, str]]:
    """The name here, and the type, of each column of a trace."""
    left = dict(hub.signals)
    found = []
    for signal in signals:
        what = (signal["slave"], signal["address"], signal["output"])
        name = next(
            (
                name
                for name, known in left.items()
                if (known["slave"], known["address"], known["output"]) == what
            ),
            "",
        )
        left.pop(name, None)
        found.append((name, signal["type"]))
    return found

"""What one page has of the trace of all pages, and what it gets next.

A signal that a page has just chosen begins with its last seconds. They come while the other signals
of the page go on: what the trace has of the signal meanwhile waits, and follows its history.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Callable, Sequence
from contextlib import aclosing

from .batch import Cycles
from .page import Page

_TAKEN_WITHIN_S = 5.0
"""Seconds in which a page must take a part of the history, or there is no more of it."""
_HELD_MAX = 400
"""Batches that wait for the history: 20 s. What takes longer will not catch up."""

History = Callable[[Page, Sequence[str], int], AsyncGenerator[Cycles, None]]


class Feed:
    """What a page gets.

    Args:
        page: The page.
        history: Finds, for a page, cycles of some signals before a cycle.
    """

    def __init__(self, page: Page, history: History) -> None:
        self._page = page
        self._history = history
        self._last = 0.0
        self._names: Sequence[str] = ()
        self._generation = -1
        self._begun: frozenset[str] = frozenset()
        """The signals whose last seconds the page has."""
        self._held: list[Cycles] = []
        self._task: asyncio.Task[None] | None = None
        self._filling: frozenset[str] = frozenset()
        """The signals whose last seconds come now."""

    def take(self, cycles: Cycles, names: frozenset[str]) -> None:
        """Takes the next cycles of a trace with the signals `names`."""
        if self._task is not None and self._task.done():
            self._task.result()  # a defect must not be silent
        page, last = self._page, self._last
        self._last = cycles.numbers[-1]
        new = cycles.after(last)
        if new is None:
            return
        # Who chooses several signals one after the other gets the last seconds of all, whole.
        is_busy = self._task is not None and self._filling.issubset(page.history)
        if self._generation != page.generation and names.issuperset(page.signals) and not is_busy:
            self._switch(new)
        if self._task is not None:
            self._held.append(new)
        if self._names and names.issuperset(self._names):
            page.tell_cycles(new, self._names, self._generation)

    def _switch(self, new: Cycles) -> None:
        """Goes over to what the page wants now."""
        self.stop()
        page = self._page
        self._begun &= page.history
        chosen = page.history - self._begun
        self._generation = page.generation
        self._names = tuple(name for name in page.signals if name not in chosen)
        if chosen:
            self._filling = chosen
            names = tuple(name for name in page.signals if name in chosen)
            self._task = asyncio.create_task(self._fill(names, int(new.numbers[0])))

    async def _fill(self, names: Sequence[str], end: int) -> None:
        page, generation, signals = self._page, self._generation, self._page.signals
        is_quick = True
        async with aclosing(self._history(page, names, end)) as parts:
            async for cycles in parts:
                is_quick = page.tell_history(cycles, names, generation)
                try:
                    await asyncio.wait_for(page.drained(), _TAKEN_WITHIN_S)
                except TimeoutError:
                    is_quick = False
                if not is_quick or len(self._held) > _HELD_MAX:
                    is_quick = False
                    break
        for cycles in self._held:
            if is_quick and cycles.columns.keys() >= {*names}:
                is_quick = page.tell_history(cycles, names, generation)
        self._held.clear()
        self._begun |= {*names}
        self._names = signals
        self._task = None

    def stop(self) -> None:
        """Ends what still comes from before."""
        if self._task is not None:
            self._task.cancel()
            self._task = None
        self._held.clear()

"""History: the values of entries in cycles of the last seconds, for whoever has just begun to look.

A reader asks for one part after the other, as quickly as it takes them, so nobody else gets them,
and nothing waits for a reader that takes none. What has read a part goes on with the next one.
"""

from __future__ import annotations

import asyncio
import time

from ecatd.operations.bus_client import BusClient
from ecatd.operations.handlers import handles
from ecatd.operations.traces import History, ReadHistory
from ecatd.trace.columns import Columns, described

from .kept_frames import KeptFrames
from .replies import IS_HERE

_CYCLES_MAX, _VALUES_MAX = 500, 100_000
"""Cycles, and values, of a part: some ms of work, so that traces come in time."""
_READERS_MAX = 8
"""Readers that can go on. One more: the one that has waited longest begins anew, which takes it
longer."""
_ABANDONED_S = 5.0
"""Seconds after which a reader that does not ask is forgotten."""


class Histories:
    """The histories that are being read.

    Args:
        server: The bus server.
        bus: Name of the bus.
    """

    def __init__(self, server: BusClient, bus: str) -> None:
        self._server = server
        self._bus = bus
        self._turn = asyncio.Lock()
        self._queues = {is_here: asyncio.Lock() for is_here in (True, False)}
        self._rest_until = 0.0
        self._readers: dict[bool, dict[tuple[str, int], _Reader]] = {True: {}, False: {}}
        """Those of this machine, and of the network, by what they are asked next."""

    @handles(ReadHistory)
    async def read(self, request: ReadHistory) -> History:
        """Returns a part.

        Parts are made one after the other; this machine and the network take turns.

        Raises:
            UsageError: There are too many entries.
            StateError: No entry fits a pattern, or the bus server keeps no frames.
        """
        async with self._queues[IS_HERE.get()], self._turn:
            # Half of the time is for traces and all else, however many ask.
            await asyncio.sleep(max(0.0, self._rest_until - time.monotonic()))
            began = time.monotonic()
            readers = self._readers[IS_HERE.get()]
            reader = readers.pop((request.patterns, request.begin), None)
            if reader is None:
                frames = await KeptFrames.open(self._server, self._bus, request.begin)
                try:
                    # With many entries it takes a while, in which others get their answers.
                    reader = await asyncio.to_thread(_Reader, frames, request.patterns)
                finally:
                    frames.close()
            answer = await reader.read(request.begin, request.end)
            if answer["more"]:
                _keep(readers, (request.patterns, answer["next"]), reader)
            now = time.monotonic()
            self._rest_until = now + (now - began)
            return answer


class _Reader:
    """What reads a history.

    Args:
        frames: The frames.
        patterns: Those of the entries.
    """

    def __init__(self, frames: KeptFrames, patterns: str) -> None:
        signals = frames.choose(patterns)
        self._frames = frames
        self._columns = Columns(signals, frames.layout)
        self._signals = [described(signal) for signal in signals]
        self._most = max(1, min(_CYCLES_MAX, _VALUES_MAX // len(signals)))
        self._cycles = frames.cycles()
        self._last = 0

    async def read(self, begin: int, end: int) -> History:
        """Reads the next part, up to the cycle `end`."""
        frames, lost = self._frames, False
        while not (is_done := await asyncio.to_thread(self._collect, end)) and frames.more:
            await frames.fetch()
            lost |= frames.lost
            self._cycles = frames.cycles()
        more = is_done and len(self._columns) == self._most
        batch = self._columns.take()
        numbers, after = batch.cycles, self._last
        self._last = numbers[-1] if numbers else after
        if not after and not frames.has_first:
            begin = numbers[0] if numbers else end
        return {
            "signals": self._signals,
            "begin": begin,
            "batch": batch.to_map(frames.clock_ns, after, lost),
            "next": self._last + 1 if self._last else begin,
            "more": more,
        }

    def _collect(self, end: int) -> bool:
        """Takes what was fetched; returns whether this part has all it can."""
        if len(self._columns) == self._most:
            return True
        for cycle, images in self._cycles:
            if cycle.number >= end:
                return True
            self._columns.add(cycle, images)
            if len(self._columns) == self._most:
                return True
        return False


def _keep(readers: dict[tuple[str, int], _Reader], key: tuple[str, int], reader: _Reader) -> None:
    """Keeps what can go on, for a while."""

    def forget() -> None:
        if readers.get(key) is reader:
            del readers[key]

    readers[key] = reader
    if len(readers) > _READERS_MAX:
        del readers[next(iter(readers))]
    asyncio.get_running_loop().call_later(_ABANDONED_S, forget)

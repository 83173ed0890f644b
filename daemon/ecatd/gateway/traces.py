"""Traces: the value of each of some entries in every cycle, in batches.

The bus server keeps the last frames of the cycle (`[flight_recorder]`). While somebody listens, the
gateway reads them some times a second and takes the values out of them, so a busy machine delays a
trace, and loses nothing. Readers with the same patterns share a trace.
"""

from __future__ import annotations

import asyncio
import hashlib
import time
from collections.abc import Sequence

import zenoh

from ecatd.base.errors import BusyError, EcatError
from ecatd.base.log import Log
from ecatd.operations.bus_client import BusClient
from ecatd.operations.encoding import pack
from ecatd.operations.handlers import handles
from ecatd.operations.traces import OpenTrace, Trace
from ecatd.operations.zenoh_keys import SCHEMA, bus_key
from ecatd.trace.columns import Columns, described

from .kept_frames import KeptFrames
from .replies import IS_HERE
from .sessions import Publisher, Sessions

_TRACES_MAX, _HERE_MAX = 8, 4
"""Traces, and how many more this machine can open than the network."""
_PERIOD_S = 0.05
"""Seconds between two batches."""
_ABANDONED_S = 5.0
"""Seconds after which a trace without readers ends."""


class Traces:
    """All traces of a bus.

    Args:
        session: The gateway's sessions.
        server: The bus server.
        bus: Name of the bus.
        full_name: Its name in keys.
        log: The log, for the reason if the values end.
    """

    def __init__(
        self, session: Sessions, server: BusClient, bus: str, full_name: str, log: Log
    ) -> None:
        self._session = session
        self._server = server
        self._bus = bus
        self._full_name = full_name
        self._log = log
        self._opening = asyncio.Lock()
        self._traces: dict[str, _OpenTrace] = {}
        self._source: KeptFrames | None = None
        self._task: asyncio.Task[None] | None = None

    @handles(OpenTrace)
    async def open(self, request: OpenTrace) -> Trace:
        """Opens a trace, or finds the one that is open already.

        Raises:
            UsageError: There are too many entries.
            StateError: No entry fits a pattern, or the bus server keeps no frames.
            BusyError: There are too many traces.
        """
        name = hashlib.sha256(request.patterns.encode()).hexdigest()[:16]
        async with self._opening:
            if name not in self._traces:
                self._traces[name] = await self._make(name, request.patterns)
            trace = self._traces[name]
            trace.asked = time.monotonic()
        return trace.description

    async def _make(self, name: str, patterns: str) -> _OpenTrace:
        most = _TRACES_MAX + _HERE_MAX * IS_HERE.get()
        if len(self._traces) >= most:
            # Somebody who chooses one signal after the other leaves many of them.
            self._traces = {n: t for n, t in self._traces.items() if not t.was_left}
        if len(self._traces) >= most:
            raise BusyError(f"{most} traces are open already; try again when some have ended")
        if self._source is None:
            self._source = await KeptFrames.open(self._server, self._bus)
            self._task = asyncio.create_task(self._run(self._source))
        # With many entries it takes a while, in which others get their answers.
        return await asyncio.to_thread(self._choose, self._source, name, patterns)

    def _choose(self, source: KeptFrames, name: str, patterns: str) -> _OpenTrace:
        signals = source.choose(patterns)
        key = bus_key(self._full_name, "ro", "trace", name)
        return _OpenTrace(
            self._session.publisher(key),
            Columns(signals, source.layout),
            {
                "key": key,
                "cycle_time_us": round(source.client.cycle_time * 1e6),
                "signals": [described(signal) for signal in signals],
            },
        )

    async def _run(self, source: KeptFrames) -> None:
        """Publishes until nobody listens any more."""
        try:
            while True:
                begin = time.monotonic()
                async with self._opening:
                    self._traces = {n: t for n, t in self._traces.items() if t.is_wanted()}
                    if not self._traces:
                        break
                    traces = [*self._traces.values()]
                await source.fetch()
                await asyncio.to_thread(_publish, source, traces)
                if not source.more:
                    await asyncio.sleep(max(0.0, begin + _PERIOD_S - time.monotonic()))
        except EcatError as error:
            self._log.warning(f"traces have ended: {error}")
        except zenoh.ZError:
            pass  # the gateway ends
        except Exception as error:  # a defect in traces must not be silent
            self._log.error(f"defect in a trace: {error!r}")
        finally:
            self._source = None
            self._traces.clear()
            source.close()

    def close(self) -> None:
        """Ends all traces."""
        if self._task is not None:
            self._task.cancel()


def _publish(source: KeptFrames, traces: Sequence[_OpenTrace]) -> None:
    for cycle, images in source.cycles():
        for trace in traces:
            trace.columns.add(cycle, images)
    for trace in traces:
        trace.publish(source.clock_ns, source.lost)


class _OpenTrace:
    def __init__(
        self,
        publisher: Publisher,
        columns: Columns,
        description: Trace,
    ) -> None:
        self._publisher = publisher
        self.columns = columns
        self.description = description
        self.asked = time.monotonic()
        self._last = 0
        self._lost = False
        self._was_read = False

    @property
    def was_left(self) -> bool:
        """Whether nobody listens any more."""
        return self._was_read and not self._publisher.is_wanted

    def publish(self, clock_ns: int, lost: bool) -> None:
        """Publishes what was collected, if it is something."""
        self._lost |= lost
        if not len(self.columns):
            return
        batch = self.columns.take()
        message = batch.to_map(clock_ns, self._last, self._lost)
        self._last, self._lost = batch.cycles[-1], False
        self._was_read |= self._publisher.is_wanted  # it may be left before the next look
        self._publisher.put(pack({"schema": SCHEMA, **message}))

    def is_wanted(self) -> bool:
        """Whether somebody listens, or has just opened it."""
        if self._publisher.is_wanted:
            self.asked = time.monotonic()
            self._was_read = True
        return time.monotonic() - self.asked < _ABANDONED_S

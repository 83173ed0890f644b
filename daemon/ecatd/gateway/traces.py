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

from ecatd.base.errors import BusyError, EcatError, UsageError
from ecatd.base.log import Log
from ecatd.client import Client
from ecatd.client.patterns import find_signals
from ecatd.operations.bus_client import BusClient
from ecatd.operations.encoding import pack
from ecatd.operations.frames import NEWEST, ReadFrames
from ecatd.operations.handlers import handles
from ecatd.operations.image import DomainImage, ReadImage
from ecatd.operations.traces import OpenTrace, Trace, TraceBatch
from ecatd.operations.zenoh_keys import SCHEMA, bus_key
from ecatd.trace.columns import Columns, described
from ecatd.trace.cycles import CycleReader

from .sessions import Publisher, Sessions

_TRACES_MAX, _SIGNALS_MAX, _PATTERNS_MAX = 8, 10000, 100
_PERIOD_S = 0.05
"""Seconds between two batches."""
_ABANDONED_S = 5.0
"""Seconds after which a trace without readers ends."""
_RING = "cycle"


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
        self._source: _Source | None = None
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
        if len(self._traces) >= _TRACES_MAX:
            raise BusyError(
                f"{_TRACES_MAX} traces are open already; try again when some have ended"
            )
        if self._source is None:
            self._source = await _Source.open(self._server, self._bus)
            self._task = asyncio.create_task(self._run(self._source))
        # With many entries it takes a while, in which others get their answers.
        return await asyncio.to_thread(self._choose, self._source, name, patterns)

    def _choose(self, source: _Source, name: str, patterns: str) -> _OpenTrace:
        lines = patterns.split("\n")
        if len(lines) > _PATTERNS_MAX:
            raise UsageError(f"{len(lines)} patterns: at most {_PATTERNS_MAX} are possible")
        signals = find_signals(source.client, lines)
        if len(signals) > _SIGNALS_MAX:
            raise UsageError(
                f"{len(signals)} entries fit '{patterns}': at most {_SIGNALS_MAX} are possible"
            )
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

    async def _run(self, source: _Source) -> None:
        """Publishes until nobody listens any more."""
        try:
            while True:
                begin = time.monotonic()
                async with self._opening:
                    self._traces = {n: t for n, t in self._traces.items() if t.is_wanted()}
                    if not self._traces:
                        break
                    traces = [*self._traces.values()]
                more = await source.publish(traces)
                if not more:
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
            source.client.close()

    def close(self) -> None:
        """Ends all traces."""
        if self._task is not None:
            self._task.cancel()


class _Source:
    """Where the values come from: frames that the bus server keeps.

    Args:
        server: The bus server.
        client: A client of the bus.
        layout: Which datagrams carry which bytes of the image of each domain.
        reader: What reads the frames.
        position: Where it goes on.
    """

    def __init__(
        self,
        server: BusClient,
        client: Client,
        layout: Sequence[DomainImage],
        reader: CycleReader,
        position: int,
    ) -> None:
        self._server = server
        self.client = client
        self.layout = layout
        self._reader = reader
        self._position = position

    @classmethod
    async def open(cls, server: BusClient, bus: str) -> _Source:
        """Begins with the next cycle.

        Raises:
            StateError: The bus server keeps no frames.
        """
        layout = (await server.ask(ReadImage()))["domains"]
        frames = await server.ask(ReadFrames(_RING, NEWEST))
        client = await asyncio.to_thread(Client, bus)
        try:
            client.sample()
            reader = CycleReader(
                layout,
                round(client.cycle_time * 1e9),
                client.cycle,
                time.monotonic_ns(),
            )
        except EcatError:
            client.close()
            raise
        return cls(server, client, layout, reader, frames["position"])

    async def publish(self, traces: list[_OpenTrace]) -> bool:
        """Publishes what is new; returns whether there is more."""
        frames = await self._server.ask(ReadFrames(_RING, self._position))
        self._position = frames["position"]
        lost = frames["overwritten"] > 0
        if lost:
            self._reader.restart()
        await asyncio.to_thread(self._publish, traces, frames["records"], frames["clock_ns"], lost)
        return bool(frames["more"])

    def _publish(self, traces: list[_OpenTrace], records: bytes, clock_ns: int, lost: bool) -> None:
        for cycle in self._reader.read(records):
            for trace in traces:
                trace.columns.add(cycle, self._reader.images)
        for trace in traces:
            trace.publish(clock_ns, lost)


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

    def publish(self, clock_ns: int, lost: bool) -> None:
        batch = self.columns.take()
        if not batch.cycles:
            return
        message: TraceBatch = {
            "cycles": batch.cycles.tobytes(),
            "times_ns": batch.times_ns.tobytes(),
            "clock_ns": clock_ns,
            "columns": [column.tobytes() for column in batch.columns],
            "invalid": [[at, *places] for at, places in enumerate(batch.invalid) if places],
            "after": self._last,
            "lost": lost,
        }
        self._last = batch.cycles[-1]
        self._publisher.put(pack({"schema": SCHEMA, **message}))

    def is_wanted(self) -> bool:
        """Whether somebody listens, or has just opened it."""
        if self._publisher.is_wanted:
            self.asked = time.monotonic()
        return time.monotonic() - self.asked < _ABANDONED_S

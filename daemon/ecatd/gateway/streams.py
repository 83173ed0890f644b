"""Streams for readers that cannot take the values of each cycle: minimum, mean and maximum.

A reader requests a pattern and a rate, and gets the key under which its values are published. The
rows are computed in C (`ecat_summarize`) from the values of every cycle, so no peak is lost. A
thread takes them one after the other, and another one publishes them, as that takes longer than a
cycle on a large bus.
Readers with the same pattern and rate share a stream. A stream without readers ends after a while.
"""

from __future__ import annotations

import asyncio
import hashlib
import queue
import threading
import time

import zenoh

from ecatd.base.errors import BusyError, EcatError, UsageError
from ecatd.client import Client, Signal, Summaries
from ecatd.client.patterns import find_signals
from ecatd.operations.encoding import pack
from ecatd.operations.handlers import handles
from ecatd.operations.streams import OpenStream, Stream, StreamSignal
from ecatd.operations.zenoh_keys import SCHEMA, bus_key

from .sessions import Sessions

_STREAMS_MAX, _SIGNALS_MAX = 16, 2000
_RATES = 0.1, 200.0
"""Lowest and highest rate in Hz."""
_ABANDONED_S = 5.0
"""Seconds after which a stream without readers ends."""
_UNSEEN = (None, None, None, 0)
"""The row of an entry that could not be trusted in any cycle."""
_LATE_S = 5.0
"""Seconds for which a cycle may be late."""
_WAITING_MAX = 20
"""Most rows that wait until they are published. More are lost."""


class Streams:
    """All streams of a bus.

    Args:
        session: The gateway's sessions.
        bus: Name of the bus.
        full_name: Its name in keys.
    """

    def __init__(self, session: Sessions, bus: str, full_name: str) -> None:
        self._session = session
        self._bus = bus
        self._full_name = full_name
        self._lock = threading.Lock()
        self._streams: dict[str, _Stream] = {}

    @handles(OpenStream)
    async def open(self, request: OpenStream) -> Stream:
        """Opens a stream, or finds the one that is open already.

        Raises:
            UsageError: The rate is out of range, or there are too many entries.
            StateError: No entry fits the pattern.
            BusyError: There are too many streams.
        """
        return await asyncio.to_thread(self._open, request.pattern, float(request.hz))

    def _open(self, pattern: str, rate: float) -> Stream:
        low, high = _RATES
        if not low <= rate <= high:
            raise UsageError(f"hz={rate:g}: {low:g} to {high:g} are possible")
        name = hashlib.sha256(f"{pattern} {rate:g}".encode()).hexdigest()[:16]
        with self._lock:
            self._streams = {n: s for n, s in self._streams.items() if s.is_open}
            if name not in self._streams:
                if len(self._streams) >= _STREAMS_MAX:
                    raise BusyError(
                        f"{_STREAMS_MAX} streams are open already; try again when some have ended"
                    )
                key = bus_key(self._full_name, "ro", "stream", name)
                self._streams[name] = _Stream(self._session, self._bus, key, pattern, rate)
            stream = self._streams[name]
            stream.asked = time.monotonic()
        return stream.description

    def close(self) -> None:
        """Ends all streams."""
        for stream in self._streams.values():
            stream.ends.set()


class _Stream:
    def __init__(self, session: Sessions, bus: str, key: str, pattern: str, rate: float) -> None:
        self._client = Client(bus)
        try:
            self._client.sample()
            self._signals = find_signals(self._client, [pattern])
            if len(self._signals) > _SIGNALS_MAX:
                raise UsageError(
                    f"{len(self._signals)} entries fit '{pattern}': at most {_SIGNALS_MAX} are "
                    "possible"
                )
        except EcatError:
            self._client.close()
            raise
        self._cycles = max(1, round(1 / (rate * self._client.cycle_time)))
        self._publisher = session.publisher(key)
        self.asked = time.monotonic()
        self.ends = threading.Event()
        self.description: Stream = {
            "key": key,
            "rate": 1 / (self._cycles * self._client.cycle_time),
            "cycles": self._cycles,
            "signals": [_described(signal) for signal in self._signals],
        }
        self._rows: queue.SimpleQueue[tuple[int, bytes] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._take, name="stream", daemon=True)
        self._thread.start()
        threading.Thread(target=self._publish, name="publish", daemon=True).start()

    @property
    def is_open(self) -> bool:
        """Whether the stream still runs."""
        return self._thread.is_alive() and not self.ends.is_set()

    def _take(self) -> None:
        try:
            with self._client:
                summaries = self._client.summaries(self._signals)
                domains = {slave.domain for slave in self._client.slaves()}
                while not self.ends.is_set():
                    row = summaries.take(self._cycles, _LATE_S)
                    if self._rows.qsize() < _WAITING_MAX:
                        # That of the last sample: another one may have ended since.
                        cycle = max(self._client.domain(number).cycle for number in domains)
                        self._rows.put((cycle, row))
        except EcatError:
            pass  # the daemon ends, and with it the gateway: readers must open another stream
        finally:
            self._rows.put(None)

    def _publish(self) -> None:
        try:
            while (taken := self._rows.get()) is not None:
                cycle, row = taken
                values = [
                    (low, mean, high, count) if count else _UNSEEN
                    for low, high, mean, _, count in Summaries.rows(row)
                ]
                message = {"schema": SCHEMA, "cycle": cycle, "values": values}
                self._publisher.put(pack(message))
                if not self._is_wanted():
                    break
        except zenoh.ZError:
            pass  # the gateway ends
        finally:
            self.ends.set()

    def _is_wanted(self) -> bool:
        if self._publisher.is_wanted:
            self.asked = time.monotonic()
        return time.monotonic() - self.asked < _ABANDONED_S


def _described(signal: Signal) -> StreamSignal:
    return {
        "name": signal.path,
        "slave": signal.slave,
        "address": signal.address,
        "unit": signal.unit,
    }

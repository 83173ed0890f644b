"""The frames of the cycle that the bus server keeps (`[flight_recorder]`), read cycle by cycle."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ecatd.base.entry_patterns import is_glob
from ecatd.base.errors import UsageError
from ecatd.base.pcapng import read_records
from ecatd.client import Client, Signal
from ecatd.client.patterns import find_signals
from ecatd.operations.bus_client import BusClient
from ecatd.operations.frames import ReadFrames
from ecatd.operations.image import DomainImage, ReadImage
from ecatd.trace.cycles import Cycle, CycleReader

_RING = "cycle"
_SIGNALS_MAX, _GLOBS_MAX = 10000, 100
"""Entries, and patterns each of which must be compared with the names of all entries."""
_DRIFT = 1e-3
"""How much the cycle may differ from its nominal time."""


class KeptFrames:
    """Reads the frames from a cycle on.

    Args:
        server: The bus server.
        client: A client of the bus; it is closed with this.
        layout: Which datagrams carry which bytes of the image of each domain.
        reader: What reads the frames.
        since_ns: CLOCK_MONOTONIC from which on it reads; 0: all there are.
        first: Number of the first cycle.

    Attributes:
        client: As above.
        layout: As above.
        first: As above.
        has_first: Whether the frames of the first cycle were kept when this began.
        more: Whether there is more to fetch.
        lost: Whether frames were overwritten before the last `fetch`.
        clock_ns: Unix time minus CLOCK_MONOTONIC.
    """

    def __init__(
        self,
        server: BusClient,
        client: Client,
        layout: Sequence[DomainImage],
        reader: CycleReader,
        since_ns: int,
        first: int,
    ) -> None:
        self._server = server
        self._reader = reader
        self._since_ns = since_ns
        self._position = 0
        self._records = b""
        self.client = client
        self.layout = layout
        self.first = first
        self.has_first = True
        self.more = True
        self.lost = False
        self.clock_ns = 0

    @classmethod
    async def open(cls, server: BusClient, bus: str, first: int | None = None) -> KeptFrames:
        """Begins.

        Args:
            server: The bus server.
            bus: Name of the bus.
            first: Number of the first cycle; 0 for the oldest one, None for the next one.

        Raises:
            StateError: The bus server keeps no frames.
        """
        layout = (await server.ask(ReadImage()))["domains"]
        client = await asyncio.to_thread(Client, bus)
        try:
            client.sample()
            newest, now_ns = client.cycle, time.monotonic_ns()
            cycle_ns = round(client.cycle_time * 1e9)
            first = newest + 1 if first is None else first
            # Before it, each domain has an exchange. The reader leaves one cycle out, and the
            # newest one may have ended a while ago.
            dividers = [client.domain(number).divider for number in range(len(layout))]
            before = 3 + max(dividers, default=1)
            age = max(0, newest - first)
            since_ns = now_ns - round(cycle_ns * (age * (1 + _DRIFT) + before))
            reader = CycleReader(layout, cycle_ns, newest, now_ns)
            since_ns = max(1, since_ns) if first else 0
            found = cls(server, client, layout, reader, since_ns, first)
            await found._begin()
        except BaseException:
            client.close()
            raise
        return found

    async def _begin(self) -> None:
        frames = await self._fetch(self._since_ns)
        oldest = next(read_records(frames["records"]), None)
        self.has_first = oldest is not None and oldest.time_ns <= self._since_ns

    async def fetch(self) -> None:
        """Fetches the next frames; read the `cycles` of those before to their end."""
        if self._records:  # `open` has fetched them
            return
        self.lost = (await self._fetch())["overwritten"] > 0
        if self.lost:
            self._reader.restart()

    async def _fetch(self, since_ns: int = 0) -> Mapping[str, Any]:
        frames = await self._server.ask(ReadFrames(_RING, self._position, since_ns))
        self._position, self._records = frames["position"], frames["records"]
        self.more, self.clock_ns = frames["more"], frames["clock_ns"]
        return frames

    def cycles(self) -> Iterator[tuple[Cycle, Sequence[bytearray]]]:
        """Each cycle that ends in what was fetched, with the image of each domain then."""
        records, self._records = self._records, b""
        for cycle in self._reader.read(records):
            if cycle.number >= self.first:
                yield cycle, self._reader.images

    def choose(self, patterns: str) -> list[Signal]:
        """The entries that fit patterns, which stand in lines.

        Raises:
            UsageError: There are too many.
            StateError: No entry fits a pattern.
        """
        lines = patterns.split("\n")
        if (count := sum(is_glob(line) for line in lines)) > _GLOBS_MAX:
            raise UsageError(
                f"{count} patterns with * or ?: at most {_GLOBS_MAX} are possible; choose more "
                "general ones such as '4/*', or whole names, of which there may be more"
            )
        signals = find_signals(self.client, lines)
        if len(signals) > _SIGNALS_MAX:
            raise UsageError(
                f"{len(signals)} entries fit '{patterns[:100]}': at most {_SIGNALS_MAX} are "
                "possible; choose fewer slaves, or only some entries of each"
            )
        return signals

    def close(self) -> None:
        """Ends the client."""
        self.client.close()

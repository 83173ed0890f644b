"""Watches the cables: reads the error counters now and then, and reports verdicts that change."""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress

from ecatd.base.errors import StateError
from ecatd.config import HealthConfig
from ecatd.description.cables import BAD, GOOD, STRAINED, Cables, LinkVerdict
from ecatd.master.port_errors import read_port_errors
from ecatd.master.worker import Worker
from ecatd.operations.faults import CABLE, Fault

from ..start.running_bus import RunningBus
from .reports import Reporter

_PERIOD = 10.0
"""Seconds between two looks. A look costs a frame for some 40 slaves, beside the cyclic ones."""


class CableWatch:
    """The watch over the cables of one bus.

    Args:
        running: The bus.
        cables: The verdicts; requests add what they read.
        worker: The worker on which slaves are asked.
        report: Reports changes.
    """

    def __init__(
        self, running: RunningBus, cables: Cables, worker: Worker, report: Reporter
    ) -> None:
        self._master = running.master
        self._cables = cables
        self._worker = worker
        self._report = report
        self._alarms: dict[tuple[int, int], Fault] = {}  # by slave and port
        self._begun = False

    def set_config(self, config: HealthConfig) -> None:
        """Changes from when on a cable is worse than before."""
        self._cables.factor = config.cable_factor

    @property
    def faults(self) -> list[Fault]:
        """Cables that are much worse than in the 24 hours before."""
        return [*self._alarms.values()]

    async def watch(self) -> None:
        """Waits for a while, unless it is the first time, and looks."""
        if self._begun:
            await asyncio.sleep(_PERIOD)
        self._begun = True
        await self.look()

    async def look(self) -> None:
        """Reads the counters, and reports each verdict that has changed."""
        found = await self._worker.run(lambda: read_port_errors(self._master))
        now = time.monotonic()
        self._cables.note(found, now)
        for item in self._cables.changes(now):
            self._tell(item)
        self._alarms = {
            end: Fault(CABLE, item.text, self._since(end))
            for item in self._cables.judge(now)
            if item.worse
            for end in [(item.slave, item.port)]
        }

    def _since(self, end: tuple[int, int]) -> float:
        return self._alarms[end].since if end in self._alarms else time.time()

    def _tell(self, item: LinkVerdict) -> None:
        good = item.verdict == GOOD
        facts = item._asdict()
        for name in ("text", "errors", "lost_links", "seconds"):
            del facts[name]
        text = f"the cable {item.text}" if good else f"{item.verdict} cable {item.text}"
        level = "error" if item.verdict == BAD else ""
        self._report("cable", text, facts, (item.slave,), good=good, level=level)

    async def explain(self) -> str:
        """Which cables damage frames now, and what to do; empty if none is known to."""
        with suppress(StateError):  # the worker is busy
            await self.look()
        found = [
            item.text
            for item in self._cables.judge(time.monotonic())
            if item.verdict in (STRAINED, BAD)
        ]
        return "; ".join(found[:1] + [f"and {len(found) - 1} more cables"] * (len(found) > 1))

"""Watches whether the cycle and the distributed clocks of a running bus stay in step."""

from __future__ import annotations

import asyncio
import time

from ecatd.description.bus import Slave
from ecatd.master.engine.engine import Event
from ecatd.master.engine.shared_memory import SharedMemory
from ecatd.master.worker import Worker
from ecatd.operations.faults import Fault
from ecatd.shm.contract import DcState

from ..start.clocks import IN_STEP_NS, Clocks
from .reports import Reporter, Throttle

_PERIOD = 1.0
_AGAIN_NS = IN_STEP_NS // 2
"""A clock is in step again only below this difference, so that one at the limit fills no log."""


class ClockWatch:
    """The watch over the clocks of one bus, which were in step when it began.

    Args:
        clocks: The clocks.
        shared: The shared memory; the differences of clocks are written there.
        worker: The worker on which they are read.
        report: Reports changes.
    """

    def __init__(
        self,
        clocks: Clocks,
        shared: SharedMemory,
        worker: Worker,
        report: Reporter,
    ) -> None:
        self._clocks = clocks
        self._shared = shared
        self._worker = worker
        self._report = report
        self._lost = False  # at least once
        self._lost_at = 0.0  # Unix time of the last loss
        self._astray: set[int] = set()
        self._states = Throttle(self._report_state, _PERIOD)

    def handle(self, event: Event) -> None:
        """Takes an event: the cycle has lost the reference clock, or is locked to it again."""
        if event.value != DcState.LOCKED:
            self._lost_at = time.time()
        if self._lost or event.value != DcState.LOCKED:  # the first lock is not reported
            self._lost = True
            self._states.note(event)

    @property
    def faults(self) -> list[Fault]:
        """What is wrong now."""
        if self._shared.health.dc_state != DcState.LOCKING:
            return []
        text = f"the cycle is not in step with the reference clock, that of {self._reference}"
        return [Fault("clock", text, self._lost_at)]

    @property
    def _reference(self) -> str:
        return self._clocks.reference.label

    def close(self) -> None:
        """Ends all reports. Call it on the event loop's thread."""
        self._states.close()

    def _report_state(self, event: Event) -> None:
        state, health = DcState(event.value), self._shared.health
        reference = self._reference
        text = f"the cycle follows the clock of {reference} again"
        if state != DcState.LOCKED:
            text = (
                f"the cycle has lost the clock of {reference}: it was "
                f"{health.dc_offset_ns / 1000:.1f} µs off when the clock was last read"
            )
        facts = {
            "state": state.name.lower(),
            "offset_ns": health.dc_offset_ns,
            "drift_ppb": health.dc_drift_ppb,
            "cycle": event.cycle,
        }
        self._report("clock", text, facts, good=state == DcState.LOCKED)

    async def watch(self) -> None:
        """Waits a second, reads the differences of all clocks, and reports those out of step.

        Raises:
            StateError: The worker has too much to do.
        """
        await asyncio.sleep(_PERIOD)
        differences = await self._worker.run(self._read)
        self._log_differences(differences)
        for slave in self._clocks.followers:
            if slave.position in differences:
                self._judge(slave, differences[slave.position])

    def _log_differences(self, differences: dict[int, int]) -> None:
        health = self._shared.health
        worst = max(differences, key=lambda position: abs(differences[position]), default=None)
        most = (
            "" if worst is None else f"; slave {worst} is {differences[worst] / 1000:+.1f} µs off"
        )
        self._report.log.debug(
            f"the cycle is {health.dc_offset_ns / 1000:+.1f} µs from the reference clock (drift "
            f"{health.dc_drift_ppb} ppb){most}"
        )

    def _read(self) -> dict[int, int]:
        """Reads differences in ns by position, without slaves that are gone. Runs on the worker."""
        differences = self._clocks.differences()
        for position, difference in differences.items():
            self._shared.slave_status[position].dc_difference_ns = difference
        return differences

    def _judge(self, slave: Slave, difference: int) -> None:
        known = slave.position in self._astray
        astray = abs(difference) > (_AGAIN_NS if known else IN_STEP_NS)
        if astray == known:
            return
        self._astray ^= {slave.position}
        text = f"the clock of {slave.label} is in step again"
        if astray:
            text = (
                f"the clock of {slave.label} is out of step: {difference / 1000:+.1f} µs from that "
                f"of {self._clocks.reference.label}"
            )
        facts = {"slave": slave.position, "difference_ns": difference}
        self._report("clock_difference", text, facts, [slave.position], good=not astray)

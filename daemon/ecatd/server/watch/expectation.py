"""Compares a bus that runs with the expected one, once it is quiet after a change.

Missing slaves are not reported here: `presence.py` does that at once. Of a device in the place of a
slave, recovery has reported why it is left alone.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ecatd.base.errors import StateError
from ecatd.config.expected_bus import Comparison, Difference, compare
from ecatd.config.expected_slave import device
from ecatd.description.bus import Slave
from ecatd.master.wire_scan import scanning_wire
from ecatd.master.worker import Worker
from ecatd.operations.wire import found_slaves, known_slaves

from ..start.expectation import restart_text
from ..start.running_bus import RunningBus
from .reports import Reporter

_QUIET_S = 1.0
"""Seconds without a change, after which the wire is looked at."""

LeftAlone = Mapping[int, tuple[int, int] | None]
Key = tuple[Any, ...]
"""What makes a difference the same one, wherever it is on the wire."""


class ExpectationWatch:
    """The comparison of one bus.

    Args:
        running: The bus.
        worker: The worker on which devices are asked.
        report: Reports differences.
    """

    def __init__(self, running: RunningBus, worker: Worker, report: Reporter) -> None:
        self._bus = running.bus
        self._master = running.master
        self._worker = worker
        self._report = report
        expected = running.found.expectation
        self._config = expected.config
        self._positions = expected.positions
        self._reported = _keyed(expected.differences, expected.wire)
        self._added: set[Key] = set()  # devices that the next start would use
        self._changed_at: float | None = None
        self._wire: list[Slave | None] = []  # who is where; None for devices that are new

    def note(self) -> None:
        """Notes that devices may have come or gone."""
        self._changed_at = time.monotonic()

    @property
    def waits(self) -> bool:
        """Whether there was a change after which nobody has looked."""
        return self._changed_at is not None

    async def look(self, left_alone: LeftAlone) -> None:
        """Looks at the wire if it has changed and is quiet again, and tells what is new.

        Args:
            left_alone: By position, vendor ID and product code of a device in the place of a
                slave, where recovery has told why it is left alone.
        """
        if self._changed_at is None or time.monotonic() < self._changed_at + _QUIET_S:
            return
        self._changed_at = None
        bus, config = self._bus, self._config
        steps = scanning_wire(bus, self._master, config, again=False)
        try:
            devices = await self._worker.run_steps(steps)
        except StateError as error:
            self._report.log.debug(f"the wire cannot be compared with the expected bus: {error}")
            self.note()
            return
        here = {item["position"] for item in devices}
        # While slaves are away, others may be behind the same cable, and are not told again.
        whole = all(slave.group or slave.position in here for slave in bus.slaves)
        self._wire = [
            None if at["position"] is None else bus.slaves[at["position"]] for at in devices
        ]
        wire = found_slaves(bus, devices)
        found = compare(config, wire, known=known_slaves(self._positions, devices))
        self._report_differences(found.differences, wire, left_alone, whole=whole)
        new = [wire[n] for n, item in enumerate(devices) if item["position"] is None]
        self._report_added(found, new if len(wire) > len(bus.slaves) else [], whole=whole)

    def _report_differences(
        self,
        found: Sequence[Difference],
        wire: Sequence[Slave],
        left_alone: LeftAlone,
        *,
        whole: bool,
    ) -> None:
        """Tells differences that are new, and that all are gone."""
        rest = [
            item for item in found if item.found and not self._is_reported(item, wire, left_alone)
        ]
        now, before = _keyed(rest, wire), self._reported
        for key, item in now.items():
            if key not in before:
                self._report_one(item)
        self._reported = now if whole else before | now
        if self._reported.keys() == before.keys():
            return
        differences = [item.text for item in self._reported.values()]
        text = "bus not as expected: " + "; ".join(differences)
        if not found:
            text = "the bus is as expected again"
            self._report.write("expected_bus", text, good=True)
        severity = "error" if found else "info"
        facts = {"differences": differences, "text": text}
        self._report.publish("expected_bus", severity=severity, **facts)

    def _report_one(self, item: Difference) -> None:
        where = f" It is {self._before(item.found[0])}." if item.kind == "extra" else ""
        self._report.write(
            "expected_bus",
            f"bus not as expected: {item.text}.{where} The bus goes on; "
            f"{restart_text(strict=item.strict)}",
            level="error" if item.strict else "warning",
        )

    def _before(self, place: int) -> str:
        """Where on the wire a place is: positions of the bus do not count new devices."""
        before = [slave for slave in self._wire[:place] if slave is not None]
        return f"behind {before[-1].label}" if before else "in front of all others"

    def _is_reported(self, item: Difference, wire: Sequence[Slave], left_alone: LeftAlone) -> bool:
        """Whether recovery has told why the devices of a difference are left alone."""
        if item.expected:
            places = {self._positions.get(n) for n in item.expected}
            return item.kind != "wrong place" and places <= left_alone.keys()
        return any((wire[n].vendor, wire[n].product) in left_alone.values() for n in item.found)

    def _report_added(self, found: Comparison, new: Sequence[Slave], *, whole: bool) -> None:
        """Tells which new devices the next start would use."""
        refused = any(item.strict for item in found.differences)
        added = [item for item in new if item.position not in found.unexpected and not refused]
        for item in added:
            if _identity(item) not in self._added:
                identity = device(item.vendor, item.product)
                where = f"{self._before(item.position)} is not part of the bus"
                text = f"{item.label} {where} ({identity}): restart ecatd to use it"
                self._report.write("expected_bus", text, good=True)
        now = {_identity(item) for item in added}
        self._added = now if whole else self._added | now


def _keyed(differences: Iterable[Difference], wire: Sequence[Slave]) -> dict[Key, Difference]:
    """Differences by what makes them the same wherever they are on the wire."""
    seen: Counter[Key] = Counter()
    keyed = {}
    for item in differences:
        if item.found:
            key = (item.kind, item.expected, *(_identity(wire[n]) for n in item.found))
            seen[key] += 1
            keyed[*key, seen[key]] = item
    return keyed


def _identity(slave: Slave) -> tuple[int, int, int, int]:
    return slave.vendor, slave.product, slave.revision, slave.serial

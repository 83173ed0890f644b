"""Watches which slaves are present, and their AL states.

In each cycle the engine reads the number of slaves, and their AL states, ORed. When one of these
changes, this module reads the AL status of all slaves to find the one that has changed.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from itertools import groupby
from typing import Any

from ecatd.config import RecoveryConfig
from ecatd.etg.al import AL_ERROR_FLAG, AlState
from ecatd.master.al_states import SlaveState
from ecatd.master.frames.datagrams import aprd
from ecatd.master.worker import Worker

from ..start.running_bus import RunningBus
from .expectation import ExpectationWatch
from .interfaces import InterfaceWatch
from .presence import Presence, Wrong, name_slaves
from .repair import Repair
from .reports import Reporter

_SLOW_PERIOD = 2.0
"""Seconds between looks while all slaves are in OP. The engine notices every change then; looks
are only a safety net."""
_PERIOD = 0.25
"""The same while a slave is not in OP. The engine sees only the ORed states, so this slave can hide
the change of another one."""
_PAUSE, _LONGEST_PAUSE = 0.02, 1.0
"""Shortest time between two looks, which grows while each of them finds something to report."""
_STATION_ADDRESS = 0x0010
_ALIAS = 0x0012
_TRIES = 3
_NAMES_MAX = 3
"""Slaves that change alike and are named in lines of their own; more share one."""


class SlaveWatch:
    """The watch over the slaves of one bus.

    Args:
        running: The bus.
        worker: The worker on which slaves are asked.
        report: Reports changes.
        interfaces: The watch over the interfaces: whether another master is at work, or no frame
            can come back.
        restarted: See `Repair`.

    Attributes:
        repair: Brings slaves back to OP.
        states: AL status of every slave when it was last read.
    """

    def __init__(
        self,
        running: RunningBus,
        worker: Worker,
        report: Reporter,
        interfaces: InterfaceWatch,
        restarted: Callable[[int], None],
    ) -> None:
        self._bus = running.bus
        self._master = running.master
        self._health = running.shared.health
        self._rows = running.shared.slave_status
        self._worker = worker
        self._report = report
        self.repair = Repair(running, worker, report.of("recovery"), self._look_again, restarted)
        self._expectation = ExpectationWatch(running, worker, report)
        self._by_hand = running.config.recovery.slaves != "all"
        self._interfaces = interfaces
        self._foreign = interfaces.is_foreign
        self._silent = False  # no slave answers, and no interface says why
        self._changed = asyncio.Event()
        self._change_cycle: int | None = None  # of the first change that nobody has looked at yet
        self._cycle: dict[str, int] = {}  # the same of the last look, as facts; empty: not known
        self._pause = _PAUSE
        self._optional = running.optional
        self._absent, awaited = running.found.absent, sorted(running.found.awaited)
        self._counted = len(running.bus.slaves) - len(self._absent) - len(awaited)
        self._found = self._added = 0
        self._twice: list[int] = []  # positions of slaves at whose address another one answers, too
        self._restart_without = running.found.expectation.restart_without
        # What was last reported about missing and new slaves. The start has reported its own.
        self._presence = Presence(
            *(running.bus, self._counted, tuple(awaited)), absent=len(self._absent)
        )
        self.states: list[SlaveState] = []
        self._away: dict[int, float] = {}  # when a slave was last seen without OP, by position
        self._set_up = running.set_up
        self._aliases: list[int | None] = [None] * len(running.bus.slaves)

    async def change(self, positions: Sequence[int], state: AlState) -> None:
        """Brings slaves to a state because somebody wants it; see `Repair.change`."""
        self._report.log.debug(f"{name_slaves(self._bus, positions)}: a client wants {state.name}")
        try:
            await self.repair.change(positions, state)
        finally:
            await self.look()

    def wanted(self, position: int) -> AlState:
        """The state in which a slave should be."""
        return self.repair.wanted(position)

    @property
    def others(self) -> str:
        """What devices are there beside the slaves of the bus, in words; empty: none.

        A device that answers at the address of a slave is one of them.
        """
        more = self._twice or self._found > len(self._bus.slaves)
        return self._presence.text(self._restart_without) if more else ""

    def set_recovery(self, config: RecoveryConfig) -> None:
        """Changes which slaves are recovered, and how often it is tried; see `Repair`."""
        self._by_hand = config.slaves != "all"
        self.repair.set_recovery(config)
        self._changed.set()

    def find_away(self, since: float) -> list[int]:
        """Positions of slaves that were not in OP, or did not answer, at a look since a time.

        Args:
            since: CLOCK_MONOTONIC in seconds.
        """
        return [position for position, seen in self._away.items() if seen >= since]

    def close(self) -> None:
        """Ends what is done to slaves; on the event loop's thread."""
        self.repair.close()

    def on_change(self, found: int, cycle: int) -> None:
        """The engine has seen another number of slaves, or another AL state, in a cycle."""
        if self._change_cycle is None:
            self._change_cycle = cycle
        self._report.log.debug(f"{found} slaves answer, or their AL states have changed")
        if found != self._counted:
            self._counted = found
            self._expectation.note()
        self._changed.set()

    async def refresh(self) -> None:
        """Reads AL states and station aliases now; a slave uses the alias of its last start."""
        await self.look()
        stations = self._master.stations
        answers = await self._worker.run(
            lambda: self._master.registers.read_all(stations, _ALIAS, 2)
        )
        self._aliases = [
            int.from_bytes(answer.data, "little") if answer.wkc else None for answer in answers
        ]

    def present(self, position: int) -> dict[str, Any]:
        """What is known of a slave now and may differ from its description."""
        return {
            "alias": self._aliases[position],
            **self._set_up.device(position),
            "read_at": self._set_up.read_at(position),
        }

    def read(self) -> list[SlaveState]:
        """Reads the AL states into shared memory; returns those that have changed.

        On the worker.
        """
        before = self.states
        for _ in range(_TRIES):
            self.states = self._master.al_states.read()
            self._found = int(self._health.slaves_found)
            # The engine counts more slaves than answered here: an answer may be lost.
            if sum(bool(item.al_state) for item in self.states) >= min(
                self._found, len(self.states)
            ):
                break
        now_s = time.monotonic()
        away = {item.position: now_s for item in self.states if item.al_state != AlState.OP}
        self._away = self._away | away  # a new map, since the event loop reads the old one
        changed = [now for i, now in enumerate(self.states) if not before or now != before[i]]
        self._find_strangers(sum(bool(item.al_state) for item in self.states))
        for now in changed:
            row = self._rows[now.position]
            if now.al_code:  # before the state: whoever sees an error must see its code
                row.al_code = now.al_code
            row.al_state, row.al_code = now.al_state, now.al_code
        return changed

    def _find_strangers(self, present: int) -> None:
        """Looks who is there beside the slaves that answer at their address; on the worker."""
        self._added, self._twice = 0, []
        stations = self._master.stations
        if self._found > len(stations) and not self._answers(self._found - 1):
            self._found = len(stations)  # the counter of a damaged frame: it says any number
        if self._found <= present:
            return
        answers = self._master.registers.exchange(
            [aprd(position, _STATION_ADDRESS, 2) for position in range(self._found)]
        )
        wire = [
            int.from_bytes(answer.data, "little") if answer.wkc == 1 else None for answer in answers
        ]
        self._twice = [n for n, station in enumerate(stations) if wire.count(station) > 1]
        if self._found > len(stations):
            pairs = zip(wire, stations, strict=False)
            new = (n for n, (at, station) in enumerate(pairs) if at not in (None, station))
            self._added = next(new, len(stations))

    def _answers(self, position: int) -> bool:
        """Whether a slave answers at a place on the wire."""
        asked = [aprd(position, _STATION_ADDRESS, 2)]
        return any(self._master.registers.exchange(asked)[0].wkc for _ in range(_TRIES))

    async def watch(self) -> None:
        """Waits for the next change, or for a while, and looks."""
        healthy = self._is_well() and self._presence.wrong == Wrong.NOTHING and not self._strangers
        healthy = healthy and not self._expectation.waits
        with suppress(TimeoutError):
            await asyncio.wait_for(self._changed.wait(), _SLOW_PERIOD if healthy else _PERIOD)
        self._changed.clear()
        something = await self.look()
        foreign = not self._is_well() and self._foreign()
        self.repair.act(self.states, self._strangers, self._cycle, foreign=foreign)
        if self._expectation.waits and not self.repair.busy and not self._foreign():
            await self._expectation.look(self.repair.left_alone())
        await asyncio.sleep(self._pause)
        self._pause = min(2 * self._pause, _LONGEST_PAUSE) if something else _PAUSE

    @property
    def _strangers(self) -> int:
        """Number of slaves that are there beside those that answer at their address."""
        return max(0, self._found - sum(bool(item.al_state & 0x0F) for item in self.states))

    def _is_well(self) -> bool:
        """Whether all slaves are in OP, but for optional ones that are absent."""
        return all(
            item.al_state == AlState.OP or (not item.al_state and item.position in self._optional)
            for item in self.states
        )

    async def _look_again(self) -> None:
        """Looks after a repair, and sees to it that the next one does not wait for a change.

        A slave that came meanwhile may hide its coming: the ORed AL states have not changed.
        """
        await self.look()
        self._changed.set()

    async def look(self) -> bool:
        """Reads the AL states, and reports every change; returns whether there was one."""
        self._cycle = {} if self._change_cycle is None else {"cycle": self._change_cycle}
        self._change_cycle = None
        changed = await self._worker.run(self.read)
        blinding = "" if self._found else await self._interfaces.find_blinding()
        if not self._found and not blinding and not self._silent:
            # Before the cable is blamed: the kernel may tell in a moment what has happened.
            await self._interfaces.settle()
            self._found = int(self._health.slaves_found)
            blinding = await self._interfaces.find_blinding()
        self._silent = not self._found and not blinding
        self._report_presence(blinding)
        present = [item for item in changed if item.al_state & 0x0F]
        for item in changed:
            facts = {"slave": item.position, "al_state": item.al_state, "al_code": item.al_code}
            facts |= self._cycle
            text = f"{self._bus.slaves[item.position].label}: {item.describe()}"
            severity = "info" if self._is_good(item) else ""
            self._report.publish("al_state", severity=severity, **facts, text=text)
        for positions, item in _group(present):
            text = f"{name_slaves(self._bus, positions)}: {item.describe()}"
            self._report.write("al_state", text, positions, good=self._is_good(item))
        return bool(changed)

    def _is_good(self, item: SlaveState) -> bool:
        """Whether a new state is good news.

        OP is what everybody wants; leaving it may be wanted, too, but somebody should know.
        Optional slaves pass the other states each time they come.
        """
        optional = item.position in self._optional and not item.al_state & AL_ERROR_FLAG
        return item.al_state == AlState.OP or optional

    def _report_presence(self, blinding: str) -> None:
        """Reports, once, that slaves are missing or that there are more, and when that is over.

        Args:
            blinding: Why no frame can come back; empty if nothing is known of that.
        """
        found = self._found
        gone = [item.position for item in self.states if not item.al_state & 0x0F]
        slaves = self._bus.slaves
        lost = [position for position in gone if position not in self._optional]
        absent = [position for position in gone if position in self._optional]
        self._report_absent(absent)
        presence = Presence(
            *(self._bus, found, tuple(lost), self._added, tuple(self._twice), len(absent)),
            *(self._by_hand, blinding),
        )
        if presence.is_like(self._presence):
            return
        self._presence = presence
        self._expectation.note()
        text = presence.text(self._restart_without)
        good = not text
        text = text or f"all {len(slaves) - len(absent)} slaves answer, and no others"
        facts = {"found": found, "expected": len(slaves), "missing": lost, **self._cycle}
        self._report("slaves", text, facts, lost, good=good)

    def _report_absent(self, absent: list[int]) -> None:
        """Reports that optional slaves have left; recovery reports that they are back."""
        left = [position for position in absent if position not in self._absent]
        self._absent = set(absent)
        if left:
            self._expectation.note()
            text = f"{name_slaves(self._bus, left)} left the bus (optional)"
            self._report("absent", text, {"slaves": left, **self._cycle}, left)


def _group(states: Iterable[SlaveState]) -> list[tuple[list[int], SlaveState]]:
    """States that are alike, together where they are many."""
    groups = []

    def key(item: SlaveState) -> tuple[int, int]:
        return item.al_state, item.al_code

    for _, items in groupby(sorted(states, key=key), key):
        alike = list(items)
        if len(alike) > _NAMES_MAX:
            groups.append(([item.position for item in alike], alike[0]))
        else:
            groups += [([item.position], item) for item in alike]
    return groups

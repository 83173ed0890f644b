"""Which slaves are there, and in which AL state.

The engine reads in each cycle how many slaves there are and their AL states, ORed, and tells when
that changes. Then all slaves are asked here, so that the one that has changed is named.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from itertools import groupby

from ecatd.log import Log
from ecatd.model.al import AlState
from ecatd.model.bus import Bus, positions_text
from ecatd.model.errors import StateError

from ..datagrams import aprd
from ..mailbox import Mailbox
from ..master import SlaveState
from ..start.bring_up import RunningBus
from .recovery import TRIES, Recovery

_SLOW_PERIOD = 2.0
"""Seconds between looks while all slaves are in OP: then every change is told by the engine, and
this is the safety net."""
_PERIOD = 0.25
"""The same while they are not: then the state of one can hide the change of another."""
_PAUSE, _LONGEST_PAUSE = 0.02, 1.0
"""Shortest time between two looks, which grows while each of them finds something to tell."""
_RECOVERY_TIMEOUT = 1.0
_STATION_ADDRESS = 0x0010
_TRIES = 3
_NAMES_MAX = 3
"""Slaves that change alike and are named in lines of their own; more share one."""


class SlaveWatch:
    """The watch over the slaves of one bus.

    Args:
        running: The bus.
        mailbox: The worker on which slaves are asked.
        log: Where changes are told.
        tell: Publishes an event: its kind, and facts.

    Attributes:
        states: AL status of every slave when it was last read.
    """

    def __init__(
        self, running: RunningBus, mailbox: Mailbox, log: Log, tell: Callable[..., None]
    ) -> None:
        self._bus = running.bus
        self._master = running.master
        self._health = running.segment.health
        self._rows = running.segment.slave_status
        self._mailbox = mailbox
        self._log = log
        self._tell = tell
        self._recovery = Recovery(len(self._bus.slaves))
        self._changed = asyncio.Event()
        self._pause = _PAUSE
        self._found = self._added = 0
        self._told = ""  # what was last told about missing and new slaves
        self.states: list[SlaveState] = []

    def want(self, positions: Iterable[int], state: AlState) -> None:
        """Somebody has asked slaves for a state, which is not changed behind his back."""
        self._recovery.want(positions, state)

    def on_change(self, found: int) -> None:
        """The engine has seen another number of slaves, or another AL state."""
        self._log.debug(f"{found} slaves answer, or their AL states have changed")
        self._changed.set()

    def read(self) -> list[SlaveState]:
        """Reads the AL states into shared memory; returns those that have changed.

        On the mailbox worker.
        """
        before = self.states
        for _ in range(_TRIES):
            self.states = self._master.states()
            self._found = int(self._health.slaves_found)
            # If the engine sees all slaves, it was perhaps only the answer that got lost.
            if self._found < len(self.states) or all(item.al_state for item in self.states):
                break
        changed = [now for i, now in enumerate(self.states) if not before or now != before[i]]
        self._added = self._find_added(self._found) if self._found > len(self.states) else 0
        for now in changed:
            row = self._rows[now.position]
            row.al_state, row.al_code = now.al_state, now.al_code
        return changed

    def _find_added(self, found: int) -> int:
        """Position of the first slave that was not there at the start; on the mailbox worker."""
        answers = self._master.registers.exchange(
            [aprd(position, _STATION_ADDRESS, 2) for position in range(found)]
        )
        for position, (answer, station) in enumerate(
            zip(answers, self._master.stations, strict=False)
        ):
            if answer.wkc and int.from_bytes(answer.data, "little") != station:
                return position
        return len(self._master.stations)

    async def watch(self) -> None:
        """Waits for the next change, or for a while, and looks."""
        healthy = all(item.al_state == AlState.OP for item in self.states) and not self._told
        with suppress(TimeoutError):
            await asyncio.wait_for(self._changed.wait(), _SLOW_PERIOD if healthy else _PERIOD)
        self._changed.clear()
        something = await self.look()
        await self._recover()
        await asyncio.sleep(self._pause)
        self._pause = min(2 * self._pause, _LONGEST_PAUSE) if something else _PAUSE

    async def look(self) -> bool:
        """Reads the AL states, and tells of every change; returns whether there was one."""
        changed = await self._mailbox.run(self.read)
        self._tell_presence()
        present = [item for item in changed if item.al_state & 0x0F]
        for item in changed:
            self._tell(
                "al_state",
                slave=item.position,
                al_state=item.al_state,
                al_code=item.al_code,
                text=item.describe(),
            )
        for positions, item in _group(present):
            # OP is what everybody wants; leaving it may be wanted, too, but somebody should know.
            tell = self._log.info if item.al_state == AlState.OP else self._log.warning
            tell(f"{_name(self._bus, positions)}: {item.describe()}")
        return bool(changed)

    def _tell_presence(self) -> None:
        """Tells, once, that slaves are missing or that there are more, and when that is over."""
        found = self._found
        lost = [item.position for item in self.states if not item.al_state & 0x0F]
        text = describe_presence(self._bus, found, lost, self._added)
        if text == self._told:
            return
        self._told = text
        if text:
            self._log.error(text)
        else:
            self._log.info(f"all {len(self._bus.slaves)} slaves answer, and no others")
        self._tell("slaves", found=found, expected=len(self._bus.slaves), missing=lost, text=text)

    async def _recover(self) -> None:
        """Asks slaves for OP that their watchdog has taken out of it."""
        due, given_up = self._recovery.look(self.states, time.monotonic())
        for position in given_up:
            self._log.error(
                f"{self._bus.slaves[position].label}: left OP {TRIES} times because no process "
                f"data came, and stays in SAFEOP: look for lost frames (`ecatctl stats`), then "
                f"`ecatctl state OP --slave {position}`"
            )
            self._tell("given_up", slave=position)
        if not due:
            return
        names = _name(self._bus, due)
        try:
            await self._mailbox.run(lambda: self._master.reach(AlState.OP, _RECOVERY_TIMEOUT, due))
        except StateError as error:
            self._log.warning(f"{names}: not back to OP after the watchdog: {error}")
        else:
            self._log.info(f"{names}: back to OP after the watchdog")
        self._tell("recovery", slaves=due)
        await self.look()


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


def _name(bus: Bus, positions: Sequence[int]) -> str:
    """How messages name one slave or several: `slave 2 (EL1018)`, `slaves 0, 3-7`."""
    if len(positions) == 1:
        return bus.slaves[positions[0]].label
    return f"slaves {positions_text(positions)}"


def describe_presence(bus: Bus, found: int, lost: Sequence[int], added: int = 0) -> str:
    """What is wrong with the number of slaves, in words; empty if nothing is.

    Args:
        bus: The bus as it was brought up.
        found: Slaves that answer a broadcast.
        lost: Positions of those that do not answer at their address.
        added: Where there are more: position of the first new one.
    """
    count = len(bus.slaves)
    if found > count:
        who = "a slave was" if found == count + 1 else f"{found - count} slaves were"
        where = f"behind {bus.slaves[added - 1].label}" if added else "in front of all others"
        return (
            f"slave count changed: {count}, now {found}: {who} added {where}; restart ecatd to use "
            f"{'it' if found == count + 1 else 'them'}"
        )
    if not lost:
        return ""
    if len(lost) == count:
        if found:
            return (
                f"no slave answers at its address, though {found} are there: they were switched "
                f"off and on, or exchanged; restart ecatd to use them"
            )
        return (
            f"no slave answers: check the cable to {bus.slaves[0].label}, and its power; the bus "
            f"goes on by itself when they are back"
        )
    if found == count:
        return (
            f"no answer from {_name(bus, lost)} at {'its' if len(lost) == 1 else 'their'} "
            f"address, though {count} slaves are there: switched off and on, or exchanged; "
            f"restart ecatd to use {'it' if len(lost) == 1 else 'them'}"
        )
    first = bus.slaves[lost[0]]
    missing = f"{len(lost)} slave{'s' * (len(lost) != 1)} missing"
    if list(lost) == list(range(lost[0], count)):
        before = bus.slaves[lost[0] - 1].label
        return (
            f"slave count changed: {count}, now {found}: no answer from {first.label} on: "
            f"{missing}; check the cable behind {before}, and the power of {first.label}"
        )
    return (
        f"slave count changed: {count}, now {found}: no answer from {_name(bus, lost)}: {missing}; "
        f"check cables and power"
    )

"""Decides which slaves are brought back to OP, how, and when. `repair.py` does the work.

A slave that left OP for lack of frames or SYNC signals is asked for OP again: first a few times
quickly, then slowly for as long as OP is wanted. A slave that does not stay in OP, has restarted or
has lost its address, is set up as at the start. A slave that gives another reason is left alone.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field

from ecatd.description.conditions import Condition
from ecatd.etg.al import (
    AL_ERROR_FLAG,
    AL_SYNCHRONIZATION,
    AL_WATCHDOG,
    AlState,
    al_remedy,
    al_status_text,
    comes_from_outside,
    needs_set_up,
)
from ecatd.master.al_states import SlaveState

QUICK_TRIES = 3
_PAUSES = (0.5, 2.0)
"""Seconds between the first tries."""
_STEADY = 10.0
"""Seconds in OP after which the tries of a slave are counted from 0 again."""
_ASKED_ONLY = 2
"""Tries in which OP is only requested. After them the slave is set up anew."""
_PATIENCE = 3.0
"""Seconds for which a slave that left OP without an error is left alone. If another master has
done that, its frames are noticed in this time."""
_LEFT_ALONE = (Condition.EXCHANGED, Condition.MISSING)


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a slave did not come back.

    Attributes:
        text: A sentence about "it", the slave; empty if there is nothing in its place.
        condition: What it is from now on; `WAITING` is tried again.
        device: Vendor ID and product code of a device in its place.
        early: Whether the try does not count, because the wire was changing, or another slave of
            the same try went away.
    """

    text: str
    condition: Condition = Condition.WAITING
    device: tuple[int, int] | None = None
    early: bool = False


@dataclass(slots=True)
class Plan:
    """What follows from the states of the slaves. All are positions.

    Attributes:
        fallen: Slaves that have left OP, or the bus, since the last look.
        ask: Slaves to be asked for OP now.
        set_up: Slaves to be set up anew now.
        recovered: Slaves that are back in OP, and the seconds that it took; infinity for a slave
            that is there for the first time.
        slow: Slaves that have used up their quick tries; reported once.
        refused: Slaves that gave a reason of their own, in words; reported once.
    """

    fallen: list[int] = field(default_factory=list)
    ask: list[int] = field(default_factory=list)
    set_up: list[int] = field(default_factory=list)
    recovered: dict[int, float] = field(default_factory=dict)
    slow: list[int] = field(default_factory=list)
    refused: dict[int, str] = field(default_factory=dict)


@dataclass(slots=True)
class _Slave:
    wanted: AlState = AlState.OP
    down_since: float | None = None
    op_since: float = 0.0
    state: int = AlState.OP  # AL status when it was last seen
    changed_at: float = 0.0
    code: int = 0  # the last reason that it gave
    watchdog: bool = False  # its watchdog took it out of OP, and it has not been in OP since
    thorough: bool = False  # somebody else may have changed its settings
    tries: int = 0
    not_before: float = 0.0
    told_slow: bool = False
    told: Failure | None = None  # the failure that was last reported
    missing: bool = False
    busy: bool = False  # a repair is at work on it
    condition: Condition = Condition.FINE
    text: str = ""

    def is_odd(self, now: float) -> bool:
        """Whether another master may have changed the slave's state."""
        by_itself = self.tries or self.code or self.watchdog or self.state & AL_ERROR_FLAG
        return not by_itself and bool(self.state) and now - self.changed_at < _PATIENCE

    def begin_anew(self) -> None:
        """Counts tries from 0 again."""
        self.tries, self.not_before, self.told_slow, self.told = 0, 0.0, False, None


class Recovery:
    """The policy for the slaves of one bus.

    Args:
        count: Number of slaves; all of them are wanted in OP.
        mode: `recovery.slaves` of the configuration: "all", "watchdog" or "none".
        retry_s: Seconds between slow tries.
        optional: Positions of the slaves that may be absent.
        absent: Positions of those that are absent from the start.
    """

    def __init__(
        self,
        count: int,
        mode: str = "all",
        retry_s: float = 10.0,
        optional: Collection[int] = (),
        absent: Collection[int] = (),
    ) -> None:
        self._slaves = [_Slave() for _ in range(count)]
        self._optional = optional
        for position in absent:
            slave = self._slaves[position]
            slave.state, slave.missing, slave.condition = AlState.NONE, True, Condition.ABSENT
            slave.down_since = -math.inf
        self._mode = mode
        self._retry_s = retry_s
        self._wire = (0, count)  # strangers, and slaves that answer

    def set_policy(self, mode: str, retry_s: float) -> None:
        """Changes the policy; arguments as above."""
        self._mode, self._retry_s = mode, retry_s
        for slave in self._slaves:
            if slave.condition == Condition.LEFT:  # perhaps it is no longer left alone
                slave.condition = Condition.FINE

    def want(self, positions: Iterable[int], state: AlState) -> None:
        """Sets the state in which slaves are wanted; recovery leaves them alone until `done`."""
        for position in positions:
            down_since = self._slaves[position].down_since
            self._slaves[position] = _Slave(wanted=state, down_since=down_since, busy=True)

    def wanted(self, position: int) -> AlState:
        """The state in which a slave is wanted."""
        return self._slaves[position].wanted

    def condition(self, position: int) -> tuple[Condition, str]:
        """Returns the condition of a slave, and a text where there is more to say."""
        slave = self._slaves[position]
        if slave.down_since is None:
            return Condition.FINE, ""
        return slave.condition, slave.text

    def left_alone(self) -> dict[int, tuple[int, int] | None]:
        """Slaves in whose places something was found that is left alone, and which device it is."""
        return {
            n: slave.told.device
            for n, slave in enumerate(self._slaves)
            if slave.down_since is not None and slave.condition in _LEFT_ALONE and slave.told
        }

    def down_for(self, position: int, now: float) -> float | None:
        """Seconds since a slave left OP; None if it has not, or was never there."""
        since = self._slaves[position].down_since
        return None if since is None or math.isinf(since) else now - since

    def look(
        self, states: Sequence[SlaveState], strangers: int, now: float, *, foreign: bool = False
    ) -> Plan:
        """Decides what to do, from the present states. Each decision counts as a try.

        Args:
            states: AL status of all slaves, 0 of those that do not answer at their address.
            strangers: Slaves on the wire beside those that answer at their address.
            now: CLOCK_MONOTONIC in seconds.
            foreign: Whether another master is at work; then nothing is done.
        """
        plan = Plan()
        wire = strangers, sum(bool(item.al_state) for item in states)
        changed, self._wire = wire != self._wire, wire
        for item in states:
            slave = self._slaves[item.position]
            self._note(plan, slave, item, now, foreign)
            if changed and not item.al_state:
                slave.not_before = 0.0  # a repair that runs looked before that
            if slave.down_since is None or slave.busy or foreign or slave.is_odd(now):
                continue
            steps = self._choose(slave, item, strangers)
            if steps is None:
                self._explain(plan, slave, item)
            elif now >= slave.not_before:
                self._count(slave, now)
                (plan.ask if steps == "ask" else plan.set_up).append(item.position)
            elif slave.tries == QUICK_TRIES and slave.condition == Condition.WAITING:
                if not slave.told_slow:
                    plan.slow.append(item.position)
                slave.told_slow = True
        return plan

    def _note(self, plan: Plan, slave: _Slave, item: SlaveState, now: float, foreign: bool) -> None:
        if item.al_state != slave.state:
            slave.state, slave.changed_at = item.al_state, now
        if item.al_state == AlState.OP:
            if slave.down_since is not None and slave.wanted == AlState.OP and not slave.busy:
                plan.recovered[item.position] = now - slave.down_since
            if not slave.busy:
                slave.down_since = None
                slave.code, slave.watchdog, slave.thorough = 0, False, False
                slave.condition, slave.text = Condition.FINE, ""
            slave.op_since = slave.op_since or now
            slave.missing = False
            if now - slave.op_since >= _STEADY:
                slave.begin_anew()
            return
        slave.op_since = 0.0
        if slave.wanted != AlState.OP:
            slave.down_since = None
            return
        if slave.down_since is None:
            slave.down_since = now
            plan.fallen.append(item.position)
        slave.thorough = slave.thorough or foreign
        if foreign:
            slave.code = 0  # the slave answers another master: its reason does not concern this bus
        elif item.al_state & AL_ERROR_FLAG:
            slave.code = item.al_code
            slave.watchdog = slave.watchdog or item.al_code == AL_WATCHDOG
        if slave.missing == bool(item.al_state) and not slave.busy:
            slave.begin_anew()  # it has come or gone: earlier failures say nothing about it
        slave.missing = not item.al_state
        if slave.tries and not slave.busy and slave.condition == Condition.FINE:
            slave.condition = Condition.WAITING  # it was in OP only for a moment, if at all
        if item.al_state in (AlState.NONE, AlState.INIT) and slave.condition == Condition.REFUSED:
            slave.begin_anew()  # it was switched off, which may have cured it
            slave.condition, slave.code = Condition.MISSING, 0

    def _choose(self, slave: _Slave, item: SlaveState, strangers: int) -> str | None:
        """`"ask"`, `"set up"`, or None where nothing can or should be done."""
        state = item.al_state & 0x0F
        if self._mode == "none" or state == AlState.BOOT:
            return None  # firmware may be on its way
        if self._mode == "watchdog":
            return "ask" if slave.watchdog and state == AlState.SAFEOP else None
        if state == AlState.NONE:
            return "set up" if strangers else None
        if slave.condition == Condition.REFUSED or not comes_from_outside(slave.code):
            return None
        if state in (AlState.INIT, AlState.PREOP) or slave.thorough or needs_set_up(slave.code):
            return "set up"
        asked_only = 1 if slave.code in AL_SYNCHRONIZATION else _ASKED_ONLY
        return "ask" if slave.tries < asked_only else "set up"

    def _explain(self, plan: Plan, slave: _Slave, item: SlaveState) -> None:
        """Sets why nothing is done for a slave; reports it once if a person has to act."""
        if not item.al_state & 0x0F:
            absent = item.position in self._optional
            slave.condition = Condition.ABSENT if absent else Condition.MISSING
            slave.text, slave.told = "", None  # a slave that is put in later is reported again
        elif self._mode != "all" or item.al_state & 0x0F == AlState.BOOT:
            slave.condition, slave.text = Condition.LEFT, ""
        elif slave.condition != Condition.REFUSED:
            slave.condition = Condition.REFUSED
            slave.text = (
                f"AL status 0x{slave.code:04X}, {al_status_text(slave.code).lower()}: "
                f"{al_remedy(slave.code)}; then `ecatctl state {item.position} OP`"
            )
            plan.refused[item.position] = slave.text

    def _count(self, slave: _Slave, now: float) -> None:
        slave.tries = min(slave.tries + 1, QUICK_TRIES)
        slave.busy = True
        if slave.condition != Condition.EXCHANGED:  # it stays so until another slave is found there
            slave.condition, slave.text = Condition.RECOVERING, ""
        pauses = (*_PAUSES, self._retry_s)
        slave.not_before = now + min(pauses[slave.tries - 1], self._retry_s)

    def done(self, position: int, failure: Failure | None) -> bool:
        """Ends a try; the next look reads the state of the slave.

        Returns:
            Whether the failure differs from that of the try before.
        """
        slave = self._slaves[position]
        slave.busy = False
        if slave.down_since is None or slave.wanted != AlState.OP:
            return False
        slave.condition, slave.text = Condition.FINE, ""
        if failure is None:
            return False
        slave.condition, slave.text = failure.condition, failure.text
        if failure.early:
            slave.tries, slave.not_before = slave.tries - 1, 0.0
            return False
        news = failure != slave.told
        slave.told = failure
        return news

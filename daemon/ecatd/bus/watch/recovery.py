"""Brings slaves back to OP that left it because no process data came for a while.

After an outage of the whole bus every slave with outputs is in SAFEOP with AL status code 0x001B
(sync manager watchdog). Once it answers again there is nothing wrong with it, and outputs are
governed by the leases of their owners; so the daemon asks for OP again, if OP is what was wanted.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ecatd.model.al import AL_ERROR_FLAG, AL_WATCHDOG, AlState

from ..master import SlaveState

TRIES = 3
_PAUSES = (0.5, 2.0, 0.0)
"""Seconds after each try before the next one."""
_STEADY = 10.0
"""Seconds in OP after which a slave may fall as often again."""


@dataclass(slots=True)
class _Slave:
    wanted: AlState = AlState.OP
    fallen: bool = False  # by its watchdog, and not been in OP since
    tries: int = 0
    not_before: float = 0.0
    op_since: float = 0.0
    given_up: bool = False


class Recovery:
    """Decides which slaves are asked for OP, and when.

    Args:
        count: Number of slaves; all of them are wanted in OP.
    """

    def __init__(self, count: int) -> None:
        self._slaves = [_Slave() for _ in range(count)]

    def want(self, positions: Iterable[int], state: AlState) -> None:
        """Somebody has asked for a state: it is respected, and counting begins anew."""
        for position in positions:
            self._slaves[position] = _Slave(wanted=state)

    def look(self, states: Iterable[SlaveState], now: float) -> tuple[list[int], list[int]]:
        """What follows from the present states.

        Args:
            states: The states.
            now: CLOCK_MONOTONIC in seconds.

        Returns:
            The slaves that are to be asked for OP now, which counts as a try; and those that have
            fallen again after the last try, each told once.
        """
        due, given_up = [], []
        for item in states:
            slave = self._slaves[item.position]
            self._note(slave, item, now)
            if not slave.fallen or item.al_state & 0x0F != AlState.SAFEOP:
                continue
            if slave.tries == TRIES:
                if not slave.given_up:
                    given_up.append(item.position)
                slave.given_up = True
            elif now >= slave.not_before:
                slave.tries += 1
                slave.not_before = now + _PAUSES[slave.tries - 1]
                due.append(item.position)
        return due, given_up

    def _note(self, slave: _Slave, item: SlaveState, now: float) -> None:
        if item.al_state == AlState.OP:
            slave.fallen = False
            slave.op_since = slave.op_since or now
            if now - slave.op_since >= _STEADY:
                slave.tries = 0
                slave.given_up = False
            return
        slave.op_since = 0.0
        fell = item.al_state == AlState.SAFEOP | AL_ERROR_FLAG and item.al_code == AL_WATCHDOG
        slave.fallen = slave.fallen or (fell and slave.wanted == AlState.OP)

"""Which slaves are missing, which are new, and what is said of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum, auto

from ecatd.description.bus import Bus, positions_text


def name_slaves(bus: Bus, positions: Sequence[int]) -> str:
    """How messages name one slave or several: `slave 2 (EL1018)`, `slaves 0, 3-7`."""
    if len(positions) == 1:
        return bus.slaves[positions[0]].label
    return f"slaves {positions_text(positions)}"


class Wrong(Enum):
    """What is wrong with the number of slaves."""

    NOTHING = auto()
    TWICE = auto()
    """Two devices answer at an address."""
    ADDED = auto()
    RESTARTED = auto()
    """They are there, but do not answer at their addresses."""
    BLIND = auto()
    """No frame comes back, and the interfaces know why."""
    SILENT = auto()
    MISSING = auto()


@dataclass(frozen=True, slots=True)
class Presence:
    """Which slaves are there, and which devices beside them.

    Attributes:
        bus: The bus as it was brought up.
        found: Slaves that answer a broadcast.
        lost: Positions of those that do not answer at their address, and must be there.
        added: Where there are more: position of the first new one.
        twice: Positions of those at whose address another device answers, too.
        absent: Number of optional slaves that do not answer at their address.
        by_hand: Whether slaves that were without power do not come back by themselves.
        blinding: Why no frame can come back, as the interfaces know it: it is no fault of slaves.
    """

    bus: Bus
    found: int
    lost: tuple[int, ...]
    added: int = 0
    twice: tuple[int, ...] = ()
    absent: int = 0
    by_hand: bool = False
    blinding: str = ""

    @property
    def count(self) -> int:
        """How many slaves should answer."""
        return len(self.bus.slaves) - self.absent

    @property
    def wrong(self) -> Wrong:
        """What is wrong."""
        if self.twice:
            return Wrong.TWICE
        if self.found > len(self.bus.slaves):  # up to that, they may be optional ones that come
            return Wrong.ADDED
        if not self.lost:
            return Wrong.NOTHING
        if self.found == self.count or (self.found and len(self.lost) == self.count):
            return Wrong.RESTARTED
        if len(self.lost) < self.count:
            return Wrong.MISSING
        return Wrong.BLIND if self.blinding else Wrong.SILENT

    def is_like(self, other: Presence) -> bool:
        """Whether there is nothing to say of it that was not said of another one."""
        return self._said == other._said

    @property
    def _said(self) -> tuple[object, ...]:
        """What its text depends on."""
        wrong = self.wrong
        number = (self.count, self.found)
        return {
            Wrong.NOTHING: (wrong,),
            Wrong.TWICE: (wrong, self.twice),
            Wrong.ADDED: (wrong, *number, self.added),
            Wrong.RESTARTED: (wrong, *number, self.lost, self.by_hand),
            Wrong.BLIND: (wrong, self.blinding),
            Wrong.SILENT: (wrong,),
            Wrong.MISSING: (wrong, *number, self.lost),
        }[wrong]

    def text(self, restart_without: Callable[[Sequence[int]], str]) -> str:
        """What is wrong, in words; empty if nothing is.

        What a restart would do with others is said by `expectation.py`, when it knows who they are.

        Args:
            restart_without: What a restart would do without slaves; see `Expectation`.
        """
        bus, found, count, lost = self.bus, self.found, self.count, self.lost
        one = len(lost) == 1
        match self.wrong:
            case Wrong.NOTHING:
                return ""
            case Wrong.TWICE:
                alone = len(self.twice) == 1
                each, where = ("its", "address") if alone else ("their", "addresses")
                return (
                    f"two devices answer at the {where} of {name_slaves(bus, self.twice)}, and "
                    f"both get {each} outputs: one was cut off but kept its power, and the other "
                    f"has replaced it; remove one of them, or switch one off and on"
                )
            case Wrong.ADDED:
                who = "a slave was" if found == count + 1 else f"{found - count} slaves were"
                where = "in front of all others"
                if self.added:
                    where = f"behind {bus.slaves[self.added - 1].label}"
                return f"slave count changed from {count} to {found}: {who} added {where}"
            case Wrong.RESTARTED:
                command = f"`ecatctl state {lost[0]} OP`" if one else "`ecatctl state OP`"
                ask = f"; {command} brings back what is there" if self.by_hand else ""
                if len(lost) == count:
                    return (
                        f"no slave answers at its address, though {found} are there: they were "
                        f"switched off and on, or exchanged{ask}"
                    )
                return (
                    f"no answer from {name_slaves(bus, lost)} at {'its' if one else 'their'} "
                    f"address, though {count} slaves are there: switched off and on, or "
                    f"exchanged{ask}"
                )
            case Wrong.BLIND:
                return f"no slave answers, because no frame comes back: {self.blinding}"
            case Wrong.SILENT:
                return (
                    f"no slave answers: check the cable to {bus.slaves[0].label} and the power; "
                    f"the bus goes on by itself when the slaves answer again"
                )
        missing = f"{len(lost)} slave{'s' * (not one)} missing"
        changed, restart = f"slave count changed from {count} to {found}", restart_without(lost)
        if lost == (*range(lost[0], count),):
            before, first = bus.slaves[lost[0] - 1].label, bus.slaves[lost[0]].label
            behind = "" if one else " and all slaves behind it"
            return (
                f"{changed}: no answer from {first}{behind}, {missing}; check the cable behind "
                f"{before}, and the power of {first}{restart}"
            )
        return (
            f"{changed}: no answer from {name_slaves(bus, lost)}, {missing}; check their cables "
            f"and their power{restart}"
        )

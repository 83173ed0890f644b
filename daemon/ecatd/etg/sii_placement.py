"""Decides which PDOs of an SII can lie in their sync managers; daemon and simulator use this rule.

A PDO can lie in its sync manager if the SII describes a sync manager of this number, its usage is
the direction of the PDO, and the ESC has memory for all PDOs of this sync manager. Three witnesses
say a direction: usage and control register of a sync manager, and the category of a PDO in it. Two
of them are believed, whatever the third says.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import combinations

from .pdo import Pdo
from .sii import (
    CATEGORY_SYNC_MANAGER,
    UNASSIGNED,
    USAGE_INPUTS,
    USAGE_OUTPUTS,
    SiiSyncManager,
)

_DIRECTION = {USAGE_OUTPUTS: 0x04, USAGE_INPUTS: 0x00}  # in the control register of a buffered one
_DIRECTION_MASK = 0x0F
_OTHER = {USAGE_OUTPUTS: USAGE_INPUTS, USAGE_INPUTS: USAGE_OUTPUTS}
_PURPOSES = {
    0: "unknown",
    1: "the mailbox that the master writes",
    2: "the mailbox that the master reads",
    USAGE_OUTPUTS: "outputs",
    USAGE_INPUTS: "inputs",
}


class Placement:
    """Places the default PDOs of one slave, one after the other.

    Args:
        managers: The sync managers of the slave (category 41); the list may be filled later, but
            before the first PDO is placed.
    """

    def __init__(self, managers: Sequence[SiiSyncManager]) -> None:
        self._managers = managers
        self._bits: Counter[int] = Counter()  # of the PDOs so far, by sync manager
        self.outvoted: list[tuple[int, str, str]] = []
        """Sync managers that contradict themselves: number, what is wrong, and what counts."""

    def place(self, pdo: Pdo, usage: int) -> str:
        """Places a PDO in its sync manager, or returns why that is not possible.

        Sets the usage of a sync manager if the SII does not say it and the control register fits,
        and usage or control register if the other one and the PDO outvote it (`outvoted`).

        Args:
            pdo: The PDO.
            usage: `USAGE_OUTPUTS` or `USAGE_INPUTS`.

        Returns:
            The reason in words; empty if the PDO has been placed.
        """
        number = pdo.sync_manager
        if not self._managers:
            return f"but category {CATEGORY_SYNC_MANAGER} describes none"
        if number >= len(self._managers):
            return f"but 0 to {len(self._managers) - 1} are described; {UNASSIGNED} stands for none"
        manager = self._managers[number]
        if manager.usage == 0 and manager.control & _DIRECTION_MASK == _DIRECTION[usage]:
            manager.usage = usage  # the SII does not say, but its control register does
        if number not in self._bits and not manager.virtual:
            self._vote(number, manager, usage)
        if manager.usage != usage:
            purpose = _PURPOSES.get(manager.usage, "not known")
            return f"whose usage is {manager.usage} ({purpose}), not {usage} ({_PURPOSES[usage]})"
        bits = self._bits[number] + pdo.bit_length
        size = (bits + 7) // 8
        if not manager.holds(size):
            return (
                f"whose PDOs take {size} bytes from 0x{manager.start:04X} up to this one: memory "
                "is from 0x1000 to 0xFFFF, and digital outputs from 0x0F00 to 0x0F03"
            )
        self._bits[number] = bits
        return ""

    def overlaps(self) -> Iterator[tuple[int, int]]:
        """Pairs of sync managers whose areas share bytes, with the default PDOs or by their length.

        Of a buffered one only the first buffer counts: what is free behind it is not certain.
        """
        areas = [
            (number, item.start, item.start + ((self._bits[number] + 7) // 8 or item.length))
            for number, item in enumerate(self._managers)
            if item.usage and not item.virtual and not item.is_placeholder
        ]
        for (one, start, end), (other, begin, stop) in combinations(areas, 2):
            if start < stop and begin < end:
                yield one, other

    def _vote(self, number: int, manager: SiiSyncManager, usage: int) -> None:
        """Corrects usage or control register, if the other one and the first PDO contradict it."""
        other = _OTHER[usage]
        by_control = next(
            (
                kind
                for kind, bits in _DIRECTION.items()
                if manager.control & _DIRECTION_MASK == bits
            ),
            0,
        )
        ours, theirs = _PURPOSES[usage], _PURPOSES[other]
        if (manager.usage, by_control) == (other, usage):
            wrong = f"its usage is {other} ({theirs})"
            counts = f"its control register (0x{manager.control:02X}) and its PDOs count: {ours}"
            manager.usage = usage
        elif (manager.usage, by_control) == (usage, other):
            wrong = f"its control register 0x{manager.control:02X} is one for {theirs}"
            counts = f"its usage ({usage}) and its PDOs count: {ours}"
            manager.control = manager.control & ~_DIRECTION_MASK | _DIRECTION[usage]
        else:
            return
        self.outvoted.append((number, wrong, counts))

"""Which PDOs of an SII have a place in the slave: the one rule, for daemon and simulator.

A PDO lies in its sync manager if there is one of that number, it is for process data of that
direction, and there is memory for all of its PDOs.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from .pdo import Pdo
from .sii import (
    CATEGORY_SYNC_MANAGER,
    UNASSIGNED,
    USAGE_INPUTS,
    USAGE_OUTPUTS,
    SiiSyncManager,
)

_DIRECTION = {USAGE_OUTPUTS: 0x04, USAGE_INPUTS: 0x00}  # of a buffered one, in its control register
_DIRECTION_MASK = 0x0F
_PURPOSES = {
    0: "unknown",
    1: "the mailbox that the master writes",
    2: "the mailbox that the master reads",
    USAGE_OUTPUTS: "outputs",
    USAGE_INPUTS: "inputs",
}


class Placement:
    """The PDOs that one slave maps by default, one after the other.

    Args:
        managers: Its sync managers (category 41), which are complete before the first PDO comes.
    """

    def __init__(self, managers: Sequence[SiiSyncManager]) -> None:
        self._managers = managers
        self._bits: Counter[int] = Counter()  # of the PDOs so far, by sync manager

    def place(self, pdo: Pdo, usage: int) -> str:
        """Gives a PDO its place, or says why it has none.

        Args:
            pdo: The PDO.
            usage: `USAGE_OUTPUTS` or `USAGE_INPUTS`.

        Returns:
            The reason in words; empty if the PDO has its place.
        """
        number = pdo.sync_manager
        if not self._managers:
            return f"but category {CATEGORY_SYNC_MANAGER} describes none"
        if number >= len(self._managers):
            return f"but 0 to {len(self._managers) - 1} are described; {UNASSIGNED} would be none"
        manager = self._managers[number]
        if manager.usage == 0 and manager.control & _DIRECTION_MASK == _DIRECTION[usage]:
            manager.usage = usage  # the SII does not say, but its control register does
        if manager.usage != usage:
            purpose = _PURPOSES.get(manager.usage, "nothing known")
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

"""Decides which PDOs of an SII can lie in their sync managers; daemon and simulator use this rule.

A PDO can lie in its sync manager if the SII describes a sync manager of this number, its usage is
the direction of the PDO, and the ESC has memory for all PDOs of this sync manager.
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

_DIRECTION = {USAGE_OUTPUTS: 0x04, USAGE_INPUTS: 0x00}  # in the control register of a buffered one
_DIRECTION_MASK = 0x0F
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

    def place(self, pdo: Pdo, usage: int) -> str:
        """Places a PDO in its sync manager, or returns why that is not possible.

        Sets the usage of a sync manager if the SII does not say it and the control register fits.

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

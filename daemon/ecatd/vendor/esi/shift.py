"""Computes where a module has its objects and PDOs, by its slot (ETG.2000, DependOnSlot)."""

from __future__ import annotations

from dataclasses import dataclass

from .xml import Element

_PDOS = (range(0x1600, 0x1800), range(0x1A00, 0x1C00))


@dataclass(frozen=True, slots=True)
class Shift:
    """How far the slot of a module moves the indices that depend on it.

    Attributes:
        objects: Added to the index of an object.
        pdos: Added to the index of a PDO.
    """

    objects: int = 0
    pdos: int = 0

    def index(self, element: Element, *, moves: bool = False) -> int:
        """The index in an element, moved if it depends on the slot.

        Args:
            element: The element.
            moves: Whether it depends on the slot although the element does not say so.

        Raises:
            MalformedError: It is not an index, or beyond 0xFFFF.
        """
        index = element.number(high=0xFFFF)
        if not index or not (element.flag("DependOnSlot") or moves):
            return index
        moved = index + (self.pdos if any(index in pdos for pdos in _PDOS) else self.objects)
        if moved > 0xFFFF:
            element.fail(f"<{element.tag}> 0x{index:04X} would be 0x{moved:X} in this slot")
        return moved


UNMOVED = Shift()

"""The slots of a modular device, with the expected and the present modules (ETG.5001)."""

from __future__ import annotations

from collections.abc import Sequence

from ecatd.etg.datatypes import DataType

from .objects import Access, Dictionary, DictionaryObject, Variable
from .pdo_objects import follow_list_procedure
from .state_machine import AlCode, RefusedError

_PROFILE, _CONFIGURED, _DETECTED = 0xF000, 0xF030, 0xF050
MODULE_OBJECTS = (_PROFILE, _CONFIGURED, _DETECTED)
"""The profile of the device, the idents of expected modules, and those of present modules."""


class ModuleSlots:
    """The objects of a modular device, and its check before SAFEOP.

    Args:
        objects: The dictionary, to which the objects are added.
        idents: Module ident of each slot, slot 1 first; 0 for an empty slot.
        index_distance: Distance between the objects of two neighbouring slots.
    """

    def __init__(self, objects: Dictionary, idents: Sequence[int], index_distance: int) -> None:
        self._idents = list(idents)
        u16, u32 = DataType.UNSIGNED16, DataType.UNSIGNED32
        objects.record(
            _PROFILE,
            "Modular device profile",
            [
                Variable(_PROFILE, 1, "Module index distance", u16, value=index_distance),
                Variable(_PROFILE, 2, "Maximum number of modules", u16, value=len(idents)),
            ],
        )
        writable = Access.READ | Access.WRITE_PREOP
        empty = [0] * len(idents)
        self._configured: DictionaryObject = objects.array(
            _CONFIGURED, "Configured module ident list", u32, empty, writable
        )
        self._configured.entries[0].value = 0
        follow_list_procedure(self._configured)
        objects.array(_DETECTED, "Detected module ident list", u32, idents)

    def check(self) -> None:
        """Compares the modules that a master expects, if it has written any, with the present ones.

        Raises:
            RefusedError: They differ.
        """
        entries = self._configured.entries
        count = int(entries[0].value)
        wanted = [int(entries[slot].value) for slot in range(1, count + 1)]
        if wanted and wanted + [0] * (len(self._idents) - count) != self._idents:
            raise RefusedError(AlCode.MODULES)

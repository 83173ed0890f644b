"""A generic modular device: an island with slots for digital and analog modules (ETG.5001)."""

from __future__ import annotations

from dataclasses import dataclass

from ecatd.base.errors import UsageError
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo

from ..slave.device import Device
from ..slave.sii import Mailbox
from ..slave.sync_managers import default_size, derive
from .parameters import Parameter, revision_of

_DISTANCE = 0x10  # between the objects of two neighbouring slots
_SLOTS = 16
_WIDEST = 4  # bytes of a module
_EMPTY = "-"


@dataclass(frozen=True, slots=True)
class _Module:
    """A type of module: its ident, and its channels."""

    ident: int
    count: int
    type: DataType
    bits: int
    output: bool


_MODULES = {
    "DI8": _Module(0x0108, 8, DataType.BOOLEAN, 1, output=False),
    "DO8": _Module(0x0208, 8, DataType.BOOLEAN, 1, output=True),
    "AI2": _Module(0x0302, 2, DataType.INTEGER16, 16, output=False),
    "AO2": _Module(0x0402, 2, DataType.INTEGER16, 16, output=True),
}


class ModularIO(Device):
    """Island of modules in slots: digital and analog inputs and outputs.

    A module in slot n has its inputs from 0x6000 + (n - 1) * 0x10 on, its outputs from 0x7000 +
    (n - 1) * 0x10 on, and the PDO 0x1A00 + n - 1 or 0x1600 + n - 1.

    Args:
        modules: The modules in their slots, slot 1 first, such as "DI8, DO8, -, AI2"; "-" is an
            empty slot, and all slots after the last module are empty.
        slots: Number of slots.
    """

    vendor = 0x0000FFFF
    product = 0x00000E10
    revision = 1
    order = "ModularIO"
    name = "Island with slots for modules"
    mailbox = Mailbox()
    module_distance = _DISTANCE
    pdos_in_sii = False
    parameters = (
        Parameter("modules", f"in their slots: {', '.join(_MODULES)}, or - for none", "DI8, DO8"),
        Parameter("slots", "number of slots", 8, 1, _SLOTS),
    )

    def __init__(self, modules: str = "DI8, DO8", slots: int = 8) -> None:
        names = [name.strip() for name in modules.split(",")]
        if len(names) > slots:
            raise UsageError(f"{self.order}: {len(names)} modules for {slots} slots")
        self._names = names + [_EMPTY] * (slots - len(names))
        plugged = [_find(name) for name in self._names]
        self.modules = [module.ident if module else 0 for module in plugged]
        pdos = [
            (module, _pdo(module, name, slot))
            for slot, (name, module) in enumerate(zip(self._names, plugged, strict=True))
            if module
        ]
        self.rx_pdos = tuple(pdo for module, pdo in pdos if module.output)
        self.tx_pdos = tuple(pdo for module, pdo in pdos if not module.output)
        # Modules come and go, and the island is the same. So process data begin where they do with
        # any modules: a master may have read the EEPROM of another island of this identity only.
        sizes = default_size(self.rx_pdos), default_size(self.tx_pdos)
        self.sync_managers = derive(self.mailbox, *sizes, _WIDEST * slots)
        self.revision = revision_of(self.parameters[1:], slots)
        super().__init__()

    def with_module(self, slot: int, module: str) -> Device:
        """Makes the same island with another module in a slot."""
        if not 1 <= slot <= len(self._names):
            raise UsageError(f"{self.order} has slots 1 to {len(self._names)}, not {slot}")
        names = self._names.copy()
        names[slot - 1] = module
        return ModularIO(", ".join(names), len(names))


def _find(name: str) -> _Module | None:
    if name in (_EMPTY, ""):
        return None
    if name not in _MODULES:
        known = ", ".join(_MODULES)
        raise UsageError(f"there is no module '{name}': write {known}, or {_EMPTY} for none")
    return _MODULES[name]


def _pdo(module: _Module, name: str, slot: int) -> Pdo:
    """Makes the PDO of a module; `slot` counts from 0 here."""
    index = (0x7000 if module.output else 0x6000) + slot * _DISTANCE
    entries = [
        Entry(index, channel, f"Channel {channel}", module.type, module.bits)
        for channel in range(1, module.count + 1)
    ]
    mapping, manager = (0x1600, 2) if module.output else (0x1A00, 3)
    return Pdo(mapping + slot, f"{name} in slot {slot + 1}", manager, entries)

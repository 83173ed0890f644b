"""Puts modules into the slots of a device (ETG.5001)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product

from .device import EsiDevice, EsiModule
from .dictionary import read_dictionary
from .reader import note_exclusions, read_commands, read_pdos
from .shift import Shift


def plug(device: EsiDevice, idents: Sequence[int]) -> EsiDevice:
    """A device with modules in its slots: their PDOs, start-up commands and objects are its own.

    Args:
        device: The device without modules.
        idents: Ident of the module in each slot, slot 1 first; 0 for an empty slot. Modules that
            the file does not describe add nothing.

    Raises:
        ConfigError: The description of a module is malformed.
    """
    plugged = replace(
        device,
        outputs=list(device.outputs),
        inputs=list(device.inputs),
        commands=list(device.commands),
        misplaced=list(device.misplaced),
        idns=list(device.idns),
    )
    objects = {item.index: item for item in device.objects}
    modules = {module.ident: module for module in device.modules}
    shift = Shift()
    for ident, slot in zip(idents, device.slots, strict=False):
        if ident in modules:
            element = modules[ident].element
            outputs = read_pdos(element.all("RxPdo"), plugged, shift)
            inputs = read_pdos(element.all("TxPdo"), plugged, shift)
            for new, known in ((outputs, plugged.outputs), (inputs, plugged.inputs)):
                for one, other in product(new, known):
                    note_exclusions(element, one, [other])
                    note_exclusions(element, other, [one])
                known += new
            coe = element.find("Mailbox", "CoE")
            plugged.commands += read_commands(coe, shift) if coe else []
            dictionary = element.find("Profile", "Dictionary")
            brought = read_dictionary(dictionary, shift) if dictionary else []
            objects |= {item.index: item for item in brought}
        shift = Shift(shift.objects + slot.index_step, shift.pdos + slot.pdo_step)
    plugged.objects = [objects[index] for index in sorted(objects)]
    return plugged


def module_problems(device: EsiDevice, idents: Sequence[int]) -> Iterator[str]:
    """Finds the modules that do not fit the slots of a device.

    Args:
        device: The device.
        idents: As for `plug`.

    Yields:
        Sentences without a subject, such as `has a module in slot 9, but the device has 8 slots`.
    """
    modules = {module.ident: module for module in device.modules}
    for number, ident in enumerate(idents, 1):
        if not ident:
            continue
        if number > len(device.slots):
            yield f"has a module in slot {number}, but the device has {len(device.slots)} slots"
            continue
        slot, module = device.slots[number - 1], modules.get(ident)
        if module is None or not slot.takes(module):
            known = [f"{item.type} (0x{item.ident:08X})" for item in _fitting(device, number)]
            what = f"{module.type} (0x{ident:08X})" if module else f"the module 0x{ident:08X}"
            yield (
                f"has {what} in slot {number}, which takes {', '.join(known[:8]) or 'none'}"
                f"{f' and {len(known) - 8} more' if len(known) > 8 else ''}"
            )


def _fitting(device: EsiDevice, number: int) -> list[EsiModule]:
    return [module for module in device.modules if device.slots[number - 1].takes(module)]

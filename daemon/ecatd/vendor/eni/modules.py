"""Finds in ENI files the list of modules that a modular device should expect (ETG.5001)."""

from __future__ import annotations

from collections.abc import Iterable

from ecatd.config import ModuleConfig
from ecatd.description.modules import CONFIGURED

from .network import CoeCommand

_SIZE = 4


def is_about_modules(command: CoeCommand) -> bool:
    """Whether a command writes the list on the way to OP."""
    up = not {"IP", "PS", "SO"}.isdisjoint(command.transitions)
    return command.index == CONFIGURED and bool(command.data) and not command.disabled and up


def find_modules(commands: Iterable[CoeCommand]) -> list[ModuleConfig]:
    """The modules that the commands write, by slot.

    With complete access, a byte with their number and a byte of padding come first (ETG.1000.6).
    """
    idents: dict[int, int] = {}
    for command in filter(is_about_modules, commands):
        data, slot = command.data, command.subindex
        if command.complete and slot == 0:
            data, slot = data[2:], 1
        for at in range(0, len(data) if slot else 0, _SIZE):
            idents[slot + at // _SIZE] = int.from_bytes(data[at : at + _SIZE], "little")
    return [ModuleConfig(slot, ident) for slot, ident in sorted(idents.items()) if ident]

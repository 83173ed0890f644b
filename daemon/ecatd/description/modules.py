"""Compares the modules that a modular device should have with those in its slots (ETG.5001)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ecatd.base.errors import SdoAbortError

from .bus import Module

CONFIGURED, DETECTED = 0xF030, 0xF050
"""Objects: the module idents that the device should expect, and those that it has detected."""

_TOLD = 4  # slots in one message


def no_slots_text(abort: SdoAbortError) -> str:
    """Why a slave takes no list of modules, without the slave."""
    return (
        f"has no slots for modules (0x{CONFIGURED:04X}: {abort}): remove its [[slave.module]] "
        "tables"
    )


def module_differences(wanted: Sequence[Module], there: Sequence[Module]) -> str:
    """Describes the differences slot by slot; empty if all is as expected.

    Args:
        wanted: The modules that are expected, slot 1 first; slots behind them are empty.
        there: The modules that the device has detected, in the same way.

    Returns:
        A text such as `slot 2 should have DO8 (0x00000208), but is empty`.
    """
    count = max(len(wanted), len(there))
    names = {module.ident: module.name for module in wanted}
    there = [replace(module, name=names.get(module.ident, module.name)) for module in there]
    pairs = zip(_filled(wanted, count), _filled(there, count), strict=True)
    texts = [
        _difference(slot, expected, found)
        for slot, (expected, found) in enumerate(pairs, 1)
        if expected.ident != found.ident
    ]
    more = len(texts) - _TOLD
    return "; ".join(texts[:_TOLD]) + (f"; and {more} more" if more > 0 else "")


def other_modules(wanted: Sequence[Module], there: Sequence[Module]) -> str:
    """Which other modules a slave has, and what to do; empty if all is as expected.

    It is a sentence without its subject, the slave.
    """
    text = module_differences(wanted, there)
    what_to_do = "put the right ones in, or correct its [[slave.module]] tables"
    return f"has other modules: {text}; {what_to_do}" if text else ""


def _filled(modules: Sequence[Module], count: int) -> list[Module]:
    return [*modules, *[Module(0)] * (count - len(modules))]


def _difference(slot: int, expected: Module, found: Module) -> str:
    if not expected.ident:
        return f"slot {slot} should be empty, but has {found.label}"
    if not found.ident:
        return f"slot {slot} should have {expected.label}, but is empty"
    return f"slot {slot} should have {expected.label}, but has {found.label}"

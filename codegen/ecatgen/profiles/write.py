"""Writes device profiles as a TOML file that `file.py` reads as the same ones."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator

from ..units import QUANTITIES
from .profile import DeviceProfile, EntryProfile, Meaning

_HEAD = (
    "# Device profiles that units and meanings are from; --profiles with this folder takes them.\n"
)


def profiles_file(devices: Iterable[DeviceProfile]) -> str:
    """The content of a file with these devices."""
    return _HEAD + "".join(f"{line}\n" for device in devices for line in _device(device))


def _device(device: DeviceProfile) -> Iterator[str]:
    yield "\n[[device]]"
    yield f"description = {_text(device.description)}"
    if device.facts:
        yield f"source = {_text(device.facts)}"
    if device.vendor != -1:
        yield f"vendor = 0x{device.vendor:08X}"
    if device.products:
        yield f"product = [{', '.join(f'0x{code:08X}' for code in sorted(device.products))}]"
    if device.has:
        has = ", ".join(_text(f"0x{index:04X}:{subindex:02X}") for index, subindex in device.has)
        yield f"has = [{has}]"
    for entry in device.entries:
        yield "\n[[device.entry]]"
        yield from _entry(entry)
        yield from _meaning(entry.meaning)


def _entry(entry: EntryProfile) -> Iterator[str]:
    yield f"index = 0x{entry.index:04X}"
    yield f"subindex = {sorted(entry.subindices)}"
    if entry.count != 1:
        yield f"step = {entry.step}"
        yield f"count = {entry.count}"


def _meaning(meaning: Meaning) -> Iterator[str]:
    for key in ("unit", "display_unit", "note"):
        if text := getattr(meaning, key):
            yield f"{key} = {_text(text)}"
    if meaning.quantity != QUANTITIES.get(meaning.unit, ""):
        yield f"quantity = {_text(meaning.quantity)}"
    if meaning.scale != 1 or meaning.offset != 0:
        yield f"scale = {meaning.scale!r}"
        yield f"offset = {meaning.offset!r}"
    if meaning.values:
        pairs = ", ".join(f"{value.number} = {_text(value.name)}" for value in meaning.values)
        yield f"values = {{ {pairs} }}"
    if not meaning.connector:
        yield "connector = false"


def _text(text: str) -> str:
    """A basic string of TOML: as in JSON, but for the character DEL."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007F")

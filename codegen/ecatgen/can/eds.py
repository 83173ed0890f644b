"""Reads EDS and DCF files of CANopen devices: the PDOs that are mapped by default."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ecatd.base.errors import StateError, UsageError
from ecatd.etg.datatypes import DataType, is_signed
from ecatd.etg.pdo import Entry

from ..text import one_line
from .messages import EXTENDED_MAX, STANDARD_MAX, TYPES, CanMessage, CanSignal, checked

_INVALID, _EXTENDED = 1 << 31, 1 << 29
_PDOS = 512
_DUMMIES = 8
"""Mapped indices below are data types, which keep bits free."""

_LIMIT = 20_000_000
_UNSIGNED = {
    *(DataType.BOOLEAN, DataType.UNSIGNED8, DataType.UNSIGNED16, DataType.UNSIGNED24),
    *(DataType.UNSIGNED32, DataType.UNSIGNED40, DataType.UNSIGNED48, DataType.UNSIGNED56),
    DataType.UNSIGNED64,
}


def read_eds(path: Path, node: int) -> tuple[tuple[CanMessage, ...], tuple[str, ...]]:
    """Returns the PDOs of a CANopen device, and a sentence for all that was left out.

    Args:
        path: The EDS or DCF file.
        node: Node ID of the device.

    Raises:
        StateError: The package canopen is missing.
        UsageError: The file cannot be read, or has no PDO that is on by default.
    """
    try:
        from canopen.objectdictionary import import_od
    except ImportError as error:
        raise StateError(
            f"{path}: reading EDS files needs the package canopen: pip install 'ecatd[can]'"
        ) from error
    if path.stat().st_size > _LIMIT:
        raise UsageError(f"{path}: this file is larger than {_LIMIT // 1_000_000} MB")
    logging.getLogger("canopen").setLevel(logging.CRITICAL)  # all that matters is said here
    try:
        dictionary = import_od(str(path), node)
    except Exception as error:
        # The parser raises errors of many kinds for files that are not what it expects.
        raise UsageError(
            f"{path}: this cannot be read as an EDS file: {one_line(str(error))[:200]}; correct it "
            "there, or ask the maker of the device for another one"
        ) from error
    messages: list[CanMessage] = []
    left_out: list[str] = []
    for first, sent, name in ((0x1400, True, "RPDO"), (0x1800, False, "TPDO")):
        for number in range(_PDOS):
            if first + number not in dictionary:
                continue
            label = f"Node{node} {name}{number + 1}"
            message, sentences = _pdo(dictionary, first + number, node, label, sent=sent)
            left_out += sentences
            if message is not None:
                messages.append(message)
    if not messages:
        reasons = "; ".join(left_out) or "it has no objects 0x1400 or 0x1800"
        raise UsageError(f"{path}: the device has no PDO that can be used by default: {reasons}")
    return tuple(messages), tuple(left_out)


def _pdo(
    dictionary: Any, index: int, node: int, name: str, *, sent: bool
) -> tuple[CanMessage | None, list[str]]:
    cob = _number(dictionary, index, 1)
    if cob is None:
        return None, [f"{name}: object 0x{index:04X}:01 has no default, so its COB-ID is unknown"]
    if cob & _INVALID:
        return None, [f"{name} is off by default (0x{index:04X}:01 = 0x{cob:08X})"]
    extended = bool(cob & _EXTENDED)
    identifier = cob & (EXTENDED_MAX if extended else STANDARD_MAX)
    mapping = index + 0x200
    count = _number(dictionary, mapping, 0)
    if count is None:
        return None, [f"{name}: object 0x{mapping:04X} has no default, so its mapping is unknown"]
    if count > 64:
        return None, [f"{name}: 0x{mapping:04X}:00 = {count}, but a PDO has at most 64 entries"]
    signals: list[CanSignal] = []
    sentences: list[str] = []
    at = 0
    for subindex in range(1, count + 1):
        word = _number(dictionary, mapping, subindex)
        if word is None:
            return None, [
                f"{name}: object 0x{mapping:04X}:{subindex:02X} has no default, so its mapping is "
                "unknown"
            ]
        length = word & 0xFF
        if word >> 16 >= _DUMMIES:
            entry, reason = _entry(dictionary, word >> 16, word >> 8 & 0xFF, length)
            if entry is None:
                sentences.append(f"{name}: {reason}")
            else:
                signals.append(CanSignal(entry, at))
        at += length
    message = CanMessage(
        name=name,
        identifier=identifier,
        extended=extended,
        length=(at + 7) // 8,
        sent=sent,
        period_ms=0 if sent else _number(dictionary, index, 5) or 0,
        note=_transmission(_number(dictionary, index, 2), node, sent=sent),
        signals=tuple(signals),
    )
    found, more = checked(message)
    return found, sentences + more


def _transmission(kind: int | None, node: int, *, sent: bool) -> str:
    who = f"node {node} takes" if sent else f"node {node} sends"
    if kind is None:
        return ""
    if kind <= 240:
        return f"{who} it with SYNC (transmission type {kind})"
    return f"transmission type {kind}"


def _number(dictionary: Any, index: int, subindex: int) -> int | None:
    """The default of an object, or the value that a DCF file sets; None if there is none."""
    variable = _variable(dictionary, index, subindex)
    for name in ("value", "default"):
        value = getattr(variable, name, None)
        if isinstance(value, int) and 0 <= value < 1 << 32:
            return value
    return None


def _variable(dictionary: Any, index: int, subindex: int) -> Any:
    try:
        item = dictionary[index]
        if hasattr(item, "subindices") or hasattr(item, "names"):
            return item[subindex]
        return item if subindex == 0 else None
    except (KeyError, IndexError, TypeError):
        return None


def _entry(dictionary: Any, index: int, subindex: int, length: int) -> tuple[Entry | None, str]:
    """The entry for a mapped object, or why there is none."""
    address = f"0x{index:04X}:{subindex:02X}"
    variable = _variable(dictionary, index, subindex)
    if variable is None:
        return None, f"object {address} is mapped, but the file does not have it"
    kind = _kind(variable.data_type)
    bits = len(variable) if kind else 0
    name = " ".join(dict.fromkeys(_names(variable)))
    if not kind:
        return None, f"object {address} ({name}) is no number"
    if bits != length and not (variable.data_type == DataType.BOOLEAN and length in (1, 8)):
        return None, f"object {address} ({name}) has {bits} bits, but {length} are mapped"
    factor = variable.factor if isinstance(variable.factor, int | float) else 1
    return (
        Entry(
            index=1,
            subindex=0,
            name=name,
            data_type=TYPES[kind],
            bit_length=length,
            unit=one_line(str(variable.unit or "")),
            scale=float(factor),
            minimum=_limit(variable.min, factor, kind),
            maximum=_limit(variable.max, factor, kind),
            note=f"object {address}",
        ),
        "",
    )


def _names(variable: Any) -> Iterator[str]:
    """Names of an object: that of a member of a record has the name of the record before it."""
    parent = getattr(variable.parent, "name", "")
    if isinstance(parent, str) and parent:
        yield one_line(parent)
    yield one_line(str(variable.name))


def _kind(data_type: int | None) -> str:
    if data_type in _UNSIGNED:
        return "unsigned"
    if data_type == DataType.REAL32:
        return "float"
    if data_type == DataType.REAL64:
        return "double"
    return "signed" if data_type is not None and is_signed(data_type) else ""


def _limit(value: Any, factor: float, kind: str) -> float | None:
    if kind in ("float", "double") or not isinstance(value, int):
        return None
    return float(value * factor)

"""Reads EDS and DCF files of CANopen devices: the PDOs that are mapped by default."""

from __future__ import annotations

from pathlib import Path

from ecatd.base.errors import UsageError
from ecatd.etg.datatypes import DataType, bit_length, is_signed
from ecatd.etg.pdo import Entry

from .eds_text import Eds, Variable, limit
from .messages import EXTENDED_MAX, STANDARD_MAX, TYPES, CanMessage, CanSignal, checked
from .source import number, read_text, shown

_INVALID, _EXTENDED = 1 << 31, 1 << 29
_PDOS = 512
_DUMMIES = 8
"""Mapped indices below are data types, which keep bits free."""

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
        UsageError: The file cannot be read, or has no PDO that is on by default.
        OSError: The file cannot be read.
    """
    eds = Eds(read_text(path), node)
    messages: list[CanMessage] = []
    left_out: list[str] = []
    for first, sent, name in ((0x1400, True, "RPDO"), (0x1800, False, "TPDO")):
        for at in range(_PDOS):
            if not eds.has(first + at):
                continue
            label = f"Node{node} {name}{at + 1}"
            message, sentences = _pdo(eds, first + at, node, label, sent=sent)
            left_out += sentences
            if message is not None:
                messages.append(message)
    if not messages:
        reasons = "; ".join(left_out) or "it has no objects 0x1400 or 0x1800"
        raise UsageError(f"{path}: the device has no PDO that can be used by default: {reasons}")
    return tuple(messages), tuple(left_out)


def _pdo(
    eds: Eds, index: int, node: int, name: str, *, sent: bool
) -> tuple[CanMessage | None, list[str]]:
    cob = _number(eds, index, 1)
    if cob is None:
        return None, [f"{name}: object 0x{index:04X}:01 has no default, so its COB-ID is unknown"]
    if cob & _INVALID:
        return None, [f"{name} is off by default (0x{index:04X}:01 = 0x{cob:08X})"]
    extended = bool(cob & _EXTENDED)
    identifier = cob & EXTENDED_MAX
    if not extended and identifier > STANDARD_MAX:
        return None, [
            f"{name}: the COB-ID 0x{cob:08X} (0x{index:04X}:01) has more than 11 bits, but not the "
            "bit 29 of those with 29 bits"
        ]
    mapping = index + 0x200
    count = _number(eds, mapping, 0)
    if count is None:
        return None, [f"{name}: object 0x{mapping:04X} has no default, so its mapping is unknown"]
    if count > 64:
        return None, [f"{name}: 0x{mapping:04X}:00 = {count}, but a PDO has at most 64 entries"]
    signals: list[CanSignal] = []
    sentences: list[str] = []
    at = 0
    for subindex in range(1, count + 1):
        word = _number(eds, mapping, subindex)
        if word is None:
            return None, [
                f"{name}: object 0x{mapping:04X}:{subindex:02X} has no default, so its mapping is "
                "unknown"
            ]
        length = word & 0xFF
        if word >> 16 >= _DUMMIES:
            entry, reasons = _entry(eds, word >> 16, word >> 8 & 0xFF, length)
            sentences += [f"{name}: {reason}" for reason in reasons]
            if entry is not None:
                signals.append(CanSignal(entry, at))
        at += length
    if sentences and not signals:
        return None, [*sentences, f"{name}: none of its objects can be used"]
    message = CanMessage(
        name=name,
        identifier=identifier,
        extended=extended,
        length=(at + 7) // 8,
        sent=sent,
        period_ms=0 if sent else _number(eds, index, 5) or 0,
        note=_transmission(_number(eds, index, 2), node, sent=sent),
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


def _number(eds: Eds, index: int, subindex: int) -> int | None:
    """The default of an object, or the value that a DCF file sets; None if there is none."""
    variable = eds.variable(index, subindex)
    value = variable.value if variable else None
    return value if value is not None and 0 <= value < 1 << 32 else None


def _entry(eds: Eds, index: int, subindex: int, length: int) -> tuple[Entry | None, list[str]]:
    """The entry for a mapped object, if there is one, and sentences about what is left out."""
    address = f"0x{index:04X}:{subindex:02X}"
    variable = eds.variable(index, subindex)
    if variable is None:
        why = (
            "says different things about it"
            if eds.is_doubtful(index, subindex)
            else "does not have it"
        )
        return None, [f"object {address} is mapped, but the file {why}"]
    data_type, name = variable.data_type, variable.name
    if data_type is None:
        return None, [f"object {address} ({name}) has no data type"]
    kind, bits = _kind(data_type), bit_length(data_type)
    if not kind:
        return None, [f"object {address} ({name}) is no number"]
    if bits != length and not (data_type == DataType.BOOLEAN and length in (1, 8)):
        return None, [f"object {address} ({name}) has {bits} bits, but {length} are mapped"]
    factor = number(variable.factor or "1")
    if factor is None:
        return None, [f"object {address} ({name}) has the factor '{shown(variable.factor)}'"]
    limits, sentences = _limits(variable, data_type, kind, factor)
    entry = Entry(
        index=1,
        subindex=0,
        name=name,
        data_type=TYPES[kind],
        bit_length=length,
        unit=variable.unit,
        scale=factor,
        minimum=limits[0],
        maximum=limits[1],
        note=f"object {address}",
    )
    return entry, [f"object {address} ({name}) {sentence}" for sentence in sentences]


def _limits(
    variable: Variable, data_type: int, kind: str, factor: float
) -> tuple[list[float | None], list[str]]:
    """Smallest and largest value, and which limits are left out."""
    if kind in ("float", "double"):
        return [None, None], []
    found: list[float | None] = []
    sentences = []
    for text in variable.limits:
        raw = limit(text, data_type)
        if text and raw is None:
            sentences.append(
                f"has the limit {shown(text)}, which is no value of it; it is left out"
            )
        found.append(None if raw is None else raw * factor)
    return found[::-1] if factor < 0 else found, sentences


def _kind(data_type: int) -> str:
    if data_type in _UNSIGNED:
        return "unsigned"
    if data_type == DataType.REAL32:
        return "float"
    if data_type == DataType.REAL64:
        return "double"
    return "signed" if is_signed(data_type) else ""

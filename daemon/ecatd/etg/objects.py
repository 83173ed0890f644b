"""Names and types of standardised objects, for slaves that do not describe them.

Sources: CiA 301 and ETG.1000.6 for 0x1000 to 0x1FFF, CiA 402-2 (IEC 61800-7-201) for 0x6000 to
0x67FF. Only objects that mean the same on every slave are listed.
"""

from __future__ import annotations

from .datatypes import DataType

_I8, _I16, _I32 = DataType.INTEGER8, DataType.INTEGER16, DataType.INTEGER32
_U8, _U16, _U32 = DataType.UNSIGNED8, DataType.UNSIGNED16, DataType.UNSIGNED32
_TEXT = DataType.VISIBLE_STRING

_STANDARD: dict[tuple[int, int], tuple[str, DataType]] = {
    (0x1000, 0): ("Device type", _U32),
    (0x1001, 0): ("Error register", _U8),
    (0x1008, 0): ("Device name", _TEXT),
    (0x1009, 0): ("Hardware version", _TEXT),
    (0x100A, 0): ("Software version", _TEXT),
    (0x1018, 0): ("Identity: number of entries", _U8),
    (0x1018, 1): ("Vendor ID", _U32),
    (0x1018, 2): ("Product code", _U32),
    (0x1018, 3): ("Revision number", _U32),
    (0x1018, 4): ("Serial number", _U32),
    (0x1C00, 0): ("Sync manager types: number of entries", _U8),
    (0x1C12, 0): ("RxPDO assignment: number of PDOs", _U8),
    (0x1C13, 0): ("TxPDO assignment: number of PDOs", _U8),
}

_DRIVE: dict[int, tuple[str, DataType]] = {
    0x6007: ("Abort connection option code", _I16),
    0x603F: ("Error code", _U16),
    0x6040: ("Controlword", _U16),
    0x6041: ("Statusword", _U16),
    0x605A: ("Quick stop option code", _I16),
    0x605B: ("Shutdown option code", _I16),
    0x605C: ("Disable operation option code", _I16),
    0x605D: ("Halt option code", _I16),
    0x605E: ("Fault reaction option code", _I16),
    0x6060: ("Modes of operation", _I8),
    0x6061: ("Modes of operation display", _I8),
    0x6062: ("Position demand value", _I32),
    0x6063: ("Position actual internal value", _I32),
    0x6064: ("Position actual value", _I32),
    0x6065: ("Following error window", _U32),
    0x6066: ("Following error time out", _U16),
    0x6067: ("Position window", _U32),
    0x6068: ("Position window time", _U16),
    0x606B: ("Velocity demand value", _I32),
    0x606C: ("Velocity actual value", _I32),
    0x6071: ("Target torque", _I16),
    0x6072: ("Max torque", _U16),
    0x6073: ("Max current", _U16),
    0x6074: ("Torque demand value", _I16),
    0x6075: ("Motor rated current", _U32),
    0x6076: ("Motor rated torque", _U32),
    0x6077: ("Torque actual value", _I16),
    0x6078: ("Current actual value", _I16),
    0x6079: ("DC link circuit voltage", _U32),
    0x607A: ("Target position", _I32),
    0x607C: ("Home offset", _I32),
    0x607F: ("Max profile velocity", _U32),
    0x6080: ("Max motor speed", _U32),
    0x6081: ("Profile velocity", _U32),
    0x6083: ("Profile acceleration", _U32),
    0x6084: ("Profile deceleration", _U32),
    0x6085: ("Quick stop deceleration", _U32),
    0x6086: ("Motion profile type", _I16),
    0x6087: ("Torque slope", _U32),
    0x6098: ("Homing method", _I8),
    0x609A: ("Homing acceleration", _U32),
    0x60B0: ("Position offset", _I32),
    0x60B1: ("Velocity offset", _I32),
    0x60B2: ("Torque offset", _I16),
    0x60F4: ("Following error actual value", _I32),
    0x60FD: ("Digital inputs", _U32),
    0x60FF: ("Target velocity", _I32),
    0x6402: ("Motor type", _U16),
    0x6502: ("Supported drive modes", _U32),
}

_LIMITS = {1: ("Min position limit", _I32), 2: ("Max position limit", _I32)}
"""Entries of 0x607D, software position limit."""


def standard_object(index: int, subindex: int, *, drive: bool) -> tuple[str, DataType] | None:
    """Name and type of a standard object, or None.

    Args:
        index: Object index.
        subindex: Object subindex.
        drive: Whether the slave follows CiA 402; in other profiles the same indices mean other
            objects.
    """
    if (index, subindex) in _STANDARD:
        return _STANDARD[index, subindex]
    if (0x1C12 <= index <= 0x1C13 and subindex) and subindex < 0xFF:
        return ("Assigned PDO", _U16)
    if (0x1600 <= index < 0x1C00) and subindex:
        return ("Mapped object", _U32)
    if drive and index == 0x607D and subindex:
        return _LIMITS.get(subindex)
    if drive and subindex == 0:
        return _DRIVE.get(index)
    return None

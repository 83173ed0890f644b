"""Writes the electronic data sheet (CiA 306) of a CANopen node.

    python -m ecatsim.can.eds FILE

writes that of the drive, which the repository has.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from ecatd.etg.datatypes import STRINGS, is_real, is_signed

from ..slave.objects import Access, DictionaryObject, ObjectCode, Variable
from .canopen import CanopenNode

_MANDATORY = (0x1000, 0x1001, 0x1018)
_MANUFACTURER = range(0x2000, 0x6000)
_RATES = (10, 20, 50, 125, 250, 500, 800, 1000)
_WITH_NODE = (*range(0x1400, 0x1600), *range(0x1800, 0x1A00))
_INVALID = 1 << 31


def eds(node: CanopenNode, file_name: str, product_name: str) -> str:
    """Returns the data sheet of a node; identifiers in it are relative to the node number.

    Args:
        node: The node, as after power-on.
        file_name: Name of the file, which is in it.
        product_name: Name of the product.
    """
    lines = list(_head(node, file_name, product_name))
    objects = list(node.dictionary)
    optional = [item for item in objects if item.index not in (*_MANDATORY, *_MANUFACTURER)]
    for title, group in (
        ("MandatoryObjects", [item for item in objects if item.index in _MANDATORY]),
        ("OptionalObjects", optional),
        ("ManufacturerObjects", [item for item in objects if item.index in _MANUFACTURER]),
    ):
        lines += _section(title, _list(group))
        for item in group:
            lines += _object(node, item)
    return "\n".join(lines)


def _section(title: str, rows: Sequence[tuple[str, object]]) -> list[str]:
    return [f"[{title}]", *(f"{key}={value}" for key, value in rows), ""]


def _list(items: Sequence[DictionaryObject]) -> list[tuple[str, object]]:
    rows: list[tuple[str, object]] = [("SupportedObjects", len(items))]
    return rows + [(str(n), f"0x{item.index:04X}") for n, item in enumerate(items, 1)]


def _head(node: CanopenNode, file_name: str, product_name: str) -> Iterator[str]:
    objects = node.dictionary
    indices = [item.index for item in objects]
    identity = [f"0x{int(objects[0x1018, n].value):08X}" for n in (1, 2, 3)]
    yield from _section(
        "FileInfo",
        [
            ("FileName", file_name),
            ("FileVersion", 1),
            ("FileRevision", 0),
            ("EDSVersion", "4.0"),
            ("Description", product_name),
            ("CreatedBy", "ecatsim"),
        ],
    )
    yield from _section(
        "DeviceInfo",
        [
            ("VendorName", "ecatsim"),
            ("VendorNumber", identity[0]),
            ("ProductName", product_name),
            ("ProductNumber", identity[1]),
            ("RevisionNumber", identity[2]),
            *((f"BaudRate_{rate}", 1) for rate in _RATES),
            ("SimpleBootUpMaster", 0),
            ("SimpleBootUpSlave", 1),
            ("Granularity", 8),
            ("DynamicChannelsSupported", 0),
            ("GroupMessaging", 0),
            ("NrOfRXPDO", sum(0x1400 <= index < 0x1600 for index in indices)),
            ("NrOfTXPDO", sum(0x1800 <= index < 0x1A00 for index in indices)),
            ("LSS_Supported", 0),
        ],
    )


def _object(node: CanopenNode, item: DictionaryObject) -> list[str]:
    if item.code == ObjectCode.VAR:
        return _section(f"{item.index:X}", _variable(node, item.entries[0]))
    rows = [
        ("ParameterName", item.name),
        ("ObjectType", f"0x{int(item.code):X}"),
        ("SubNumber", len(item.entries)),
    ]
    lines = _section(f"{item.index:X}", rows)
    for subindex, entry in sorted(item.entries.items()):
        lines += _section(f"{item.index:X}sub{subindex:X}", _variable(node, entry))
    return lines


def _variable(node: CanopenNode, entry: Variable) -> list[tuple[str, object]]:
    rows: list[tuple[str, object]] = [
        ("ParameterName", entry.name),
        ("ObjectType", f"0x{int(ObjectCode.VAR):X}"),
        ("DataType", f"0x{int(entry.type):04X}"),
        ("AccessType", _access(entry)),
        ("DefaultValue", _default(node, entry)),
        ("PDOMapping", int(bool(entry.access & (Access.RX_PDO | Access.TX_PDO)))),
    ]
    if entry.minimum is not None:
        rows.append(("LowLimit", round(entry.minimum)))
    if entry.maximum is not None:
        rows.append(("HighLimit", round(entry.maximum)))
    return rows


def _access(entry: Variable) -> str:
    reads, writes = entry.access & Access.READ, entry.access & Access.WRITE
    if entry.access & Access.RX_PDO and reads and writes:
        return "rww"
    return "rw" if reads and writes else "wo" if writes else "ro"


def _default(node: CanopenNode, entry: Variable) -> str:
    value = entry.value
    if entry.type in STRINGS or isinstance(value, str | bytes):
        return str(value)
    if is_real(entry.type) or is_signed(entry.type):
        return str(value)
    number = int(value)
    with_node = (entry.index, entry.subindex) in ((0x1014, 0), (0x1200, 1), (0x1200, 2))
    with_node |= entry.index in _WITH_NODE and entry.subindex == 1 and not number & _INVALID
    if with_node:
        return f"$NODEID+0x{number - node.node_id:X}"
    return f"0x{number:X}"


if __name__ == "__main__":
    from .nodes.drive import EDS, CanopenDrive

    Path(sys.argv[1]).write_text(eds(CanopenDrive(), EDS.name, "CANopen drive"), encoding="ascii")

"""Writes a bus as XML with the elements of an ESI file (ETG.2000), for programs that read these."""

from __future__ import annotations

import re
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from ecatd.base.sanitized_output import printable
from ecatd.description.bus import Bus, Slave
from ecatd.etg.datatypes import STRINGS, DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.sii import UNASSIGNED

from .dictionary import type_in_esi


def bus_document(bus: Bus, version: str) -> str:
    """The bus as a list of devices, in the order of the wire, each with the PDOs that it has now.

    ESI has no place for units, scales and names from the configuration. They are attributes of the
    element `Meaning`, which other programs ignore.

    Args:
        bus: The bus description.
        version: Version of the program that writes it.
    """
    root = Element("EtherCATInfoList")
    about = f" bus {bus.name}, written by ecatctl {version} "
    root.append(
        ElementTree.Comment(re.sub("-(?=-)", "- ", printable(about)))
    )  # XML has no -- there
    for slave in bus.slaves:
        root.append(_slave(slave))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _slave(slave: Slave) -> Element:
    info = Element("EtherCATInfo", {"Position": str(slave.position)})
    _text(SubElement(info, "Vendor"), "Id", str(slave.vendor))
    device = SubElement(SubElement(SubElement(info, "Descriptions"), "Devices"), "Device")
    kind = SubElement(
        device,
        "Type",
        {"ProductCode": f"#x{slave.product:08X}", "RevisionNo": f"#x{slave.revision:08X}"},
    )
    kind.text = printable(slave.name)
    _text(device, "Name", slave.given_name or slave.name)
    for usage in _sync_managers(slave):
        SubElement(device, "Sm").text = usage
    for tag, pdos in (("RxPdo", slave.outputs), ("TxPdo", slave.inputs)):
        for pdo in pdos:
            device.append(_pdo(tag, pdo))
    if slave.soe:
        SubElement(SubElement(device, "Mailbox"), "SoE")
    return info


def _sync_managers(slave: Slave) -> list[str]:
    """What each sync manager is for, as far as its PDOs say it."""
    used = dict(enumerate(("MBoxOut", "MBoxIn"))) if slave.coe or slave.soe else {}
    for usage, pdos in (("Outputs", slave.outputs), ("Inputs", slave.inputs)):
        used |= {pdo.sync_manager: usage for pdo in pdos if pdo.sync_manager != UNASSIGNED}
    return [used.get(number, "") for number in range(max(used, default=-1) + 1)]


def _pdo(tag: str, pdo: Pdo) -> Element:
    manager = {} if pdo.sync_manager == UNASSIGNED else {"Sm": str(pdo.sync_manager)}
    element = Element(tag, manager)
    _text(element, "Index", f"#x{pdo.index:04X}")
    _text(element, "Name", pdo.name)
    for entry in pdo.entries:
        element.append(_entry(entry))
    return element


def _entry(entry: Entry) -> Element:
    element = Element("Entry")
    _text(element, "Index", f"#x{entry.index:04X}")
    if entry.is_gap:
        _text(element, "BitLen", str(entry.bit_length))
        return element
    _text(element, "SubIndex", str(entry.subindex))
    _text(element, "BitLen", str(entry.bit_length))
    _text(element, "Name", entry.name)
    _text(element, "DataType", _type(entry))
    if entry.is_physical:
        meaning = {"Unit": printable(entry.unit), "Scale": f"{entry.scale:.17g}"}
        SubElement(element, "Meaning", {**meaning, "Offset": f"{entry.offset:.17g}"})
    return element


def _type(entry: Entry) -> str:
    if entry.data_type in STRINGS:
        kind = {DataType.VISIBLE_STRING: "STRING", DataType.OCTET_STRING: "OCTET_STRING"}
        name = kind.get(DataType(entry.data_type), "WSTRING")
        return f"{name}({entry.bit_length // (16 if name == 'WSTRING' else 8)})"
    return type_in_esi(entry.data_type)


def _text(parent: Element, tag: str, text: str) -> None:
    SubElement(parent, tag).text = printable(text)

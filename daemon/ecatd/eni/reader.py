"""Reads ENI files (ETG.2100)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from ecatd.esi.reader import read_entry
from ecatd.esi.xml import Element, read_xml
from ecatd.model.errors import ConfigError
from ecatd.model.pdo import Pdo
from ecatd.model.sii import UNASSIGNED

from .network import (
    CoeCommand,
    EniClock,
    EniNetwork,
    EniSlave,
    EniSyncManager,
    EniTask,
    RegisterCommand,
)

_SLAVES_MAX = 65535
_UNUSED = {"ProcessImage", "Picture", "Image16x14"}
_SYNC_MANAGER = re.compile(r"Sm\d{1,2}")
_LOGICAL = (10, 11, 12)  # LRD, LWR, LRW
_HANDS_TIME_ON = (13, 14)  # ARMW, FRMW
_SYSTEM_TIME = 0x0910
_UPLOAD = 2
_KNOWN_IN_SLAVE = {"Info", "ProcessData", "Mailbox", "InitCmds", "PreviousPort", "HotConnect", "DC"}
_KNOWN_IN_CONFIG = {"Master", "Slave", "Cyclic"}


def read_network(path: Path) -> EniNetwork:
    """Reads an ENI file.

    Raises:
        ConfigError: The file cannot be read, is not an ENI file, or is malformed. The message
            begins with the file and, if known, the line.
    """
    root = read_xml(path, lambda element, depth: depth == 0 or element.tag not in _UNUSED)
    if root.tag != "EtherCATConfig":
        esi = ": this is an ESI file" if root.tag == "EtherCATInfo" else ""
        root.fail(f"an ENI file begins with <EtherCATConfig>, not with <{root.tag}>{esi}")
    config = root.need("Config")
    master = config.find("Master")
    commands = master.find("InitCmds") if master else None
    slaves = list(config.all("Slave"))
    if not slaves:
        config.fail("<Config> has no <Slave>")
    if len(slaves) > _SLAVES_MAX:
        config.fail(f"<Config> has {len(slaves)} slaves: at most {_SLAVES_MAX} are allowed")
    return EniNetwork(
        str(path),
        master.text_of("Info", "Name") if master else "",
        len(list(commands.all("InitCmd"))) if commands else 0,
        _slaves(slaves),
        [_task(element) for element in config.all("Cyclic")],
        [(item.line, item.tag) for item in config.children if item.tag not in _KNOWN_IN_CONFIG],
    )


def _slaves(elements: list[Element]) -> list[EniSlave]:
    """Reads the slaves; those behind the first one of a hot connect group belong to it."""
    slaves: list[EniSlave] = []
    group = members = 0
    for number, element in enumerate(elements):
        slave = _named(number, element)
        begin = element.find("HotConnect")
        if begin is not None:
            group += 1
            members = max(1, begin.number_of("GroupMemberCnt", 1, high=_SLAVES_MAX))
            slave.group_name = begin.text_of("GroupName")
        slave.group = group if members else 0
        members -= members > 0
        slaves.append(slave)
    return slaves


def _named(number: int, element: Element) -> EniSlave:
    """Reads a slave; names it in errors, since many files have everything on one line."""
    try:
        return _slave(element)
    except ConfigError as error:
        name = element.text_of("Info", "Name")
        raise ConfigError(f"{error} (in <Slave> {number}, '{name}')") from None


def _slave(element: Element) -> EniSlave:
    info = element.need("Info")
    automatic = info.find("AutoIncAddr")
    slave = EniSlave(
        element.line,
        info.text_of("Name"),
        info.number_of("PhysAddr", 0, high=0xFFFF),
        info.number_of("AutoIncAddr", low=-0xFFFF, high=0xFFFF) & 0xFFFF if automatic else None,
        _unsigned(info.need("VendorId")),
        _unsigned(info.need("ProductCode")),
        _unsigned(info.find("RevisionNo")),
        _unsigned(info.find("SerialNo")),
        _identification(info, element.find("HotConnect")),
    )
    data = element.find("ProcessData")
    if data is not None:
        _read_process_data(data, slave)
    mailbox = element.find("Mailbox")
    if mailbox is not None:
        _read_mailbox(mailbox, slave)
    commands = element.find("InitCmds")
    slave.registers = [_register(item) for item in commands.all("InitCmd")] if commands else []
    clock = element.find("DC")
    if clock is not None:
        slave.clock = EniClock(
            clock.line,
            clock.flag_of("ReferenceClock"),
            clock.number_of("CycleTime0", 0),
            clock.number_of("ShiftTime", 0, -(1 << 31)),
        )
    known = _KNOWN_IN_SLAVE
    slave.others += [(item.line, item.tag) for item in element.children if item.tag not in known]
    return slave


def _unsigned(element: Element | None) -> int:
    """A number of 32 bits; TwinCAT writes large ones as negative ones. 0 if it is missing."""
    if element is None or not element.text:
        return 0
    return element.number(-(1 << 31)) & 0xFFFFFFFF


def _identification(info: Element, group: Element | None) -> tuple[int, int] | None:
    """Register and value by which the master finds a slave wherever it stands."""
    named = info.find("Identification")
    if named is not None:
        return named.number_of("Ado", high=0xFFFF), named.attribute("Value", high=0xFFFF)
    for item in group.all("IdentifyCmd") if group else ():
        expected = item.find("Validate", "Data")
        if expected is not None:
            value = int.from_bytes(expected.octets(8)[:2], "little")
            return item.number_of("Ado", high=0xFFFF), value
    return None


def _read_process_data(element: Element, slave: EniSlave) -> None:
    for tag in ("Send", "Recv"):
        # A slave with several areas has several such elements.
        bits = sum(item.number_of("BitLength", 0) for item in element.all(tag))
        if tag == "Send":
            slave.output_bits = bits
        else:
            slave.input_bits = bits
    managers = [item for item in element.children if _SYNC_MANAGER.fullmatch(item.tag)]
    for item in sorted(managers, key=lambda item: int(item.tag[2:])):
        if item.text_of("Type") in ("Outputs", "Inputs"):
            slave.sync_managers.append(
                EniSyncManager(
                    int(item.tag[2:]),
                    item.text_of("Type") == "Outputs",
                    item.number_of("ControlByte", 0, high=0xFF),
                    tuple(pdo.number(high=0xFFFF) for pdo in item.all("Pdo")),
                )
            )
    slave.outputs = [_pdo(item) for item in element.all("RxPdo")]
    slave.inputs = [_pdo(item) for item in element.all("TxPdo")]


def _pdo(element: Element) -> Pdo:
    return Pdo(
        element.number_of("Index", high=0xFFFF),
        element.name(),
        element.attribute("Sm", UNASSIGNED, high=0xFF),
        [read_entry(item) for item in element.all("Entry")],
    )


def _read_mailbox(element: Element, slave: EniSlave) -> None:
    coe = element.find("CoE")
    protocols = {item.text for item in element.all("Protocol")}
    slave.coe = coe is not None or "CoE" in protocols
    commands = coe.find("InitCmds") if coe else None
    slave.objects = [_object(item) for item in commands.all("InitCmd")] if commands else []
    for item in element.children:
        inside = item.find("InitCmds")
        if item.tag != "CoE" and inside is not None and inside.find("InitCmd") is not None:
            slave.others.append((item.line, item.tag))


def _object(element: Element) -> CoeCommand:
    data = element.find("Data")
    ccs = element.number_of("Ccs", 1, high=0xFF)
    content = data.octets() if data else b""
    # ETG.2100 numbers a download 2, while most tools write 1, as in the SDO itself, where 2 is an
    # upload. A command with data is a download in both.
    if ccs not in (1, _UPLOAD):
        element.fail(f"<Ccs> is {ccs}: 1 and 2 are allowed")
    return CoeCommand(
        element.line,
        _transitions(element),
        element.number_of("Index", high=0xFFFF),
        element.number_of("SubIndex", 0, high=0xFF),
        content,
        element.flag("CompleteAccess"),
        element.flag_of("Disabled"),
        element.text_of("Comment"),
    )


def _register(element: Element) -> RegisterCommand:
    data, expected = element.find("Data"), element.find("Validate", "Data")
    return RegisterCommand(
        element.line,
        _transitions(element),
        element.number_of("Cmd", high=0xFF),
        element.number_of("Ado", 0, high=0xFFFF),
        data.octets() if data else b"",
        expected.octets() if expected else None,
        element.text_of("Comment"),
    )


def _transitions(element: Element) -> tuple[str, ...]:
    return tuple(dict.fromkeys(item.text.upper() for item in element.all("Transition")))


def _task(element: Element) -> EniTask:
    task = EniTask(element.line, element.number_of("CycleTime", 0), element.text_of("Comment"))
    for item in _datagrams(element):
        command = item.number_of("Cmd", high=0xFF)
        if command in _LOGICAL:
            data = item.find("Data")
            length = len(data.octets()) if data else item.number_of("DataLength", 0)
            task.areas.append((_unsigned(item.need("Addr")), length))
        elif command in _HANDS_TIME_ON and item.number_of("Ado", 0) == _SYSTEM_TIME:
            task.clock = item.number_of("Adp", high=0xFFFF)
        copies = item.find("CopyInfos")
        if copies is not None and copies.children:
            task.others.append((copies.line, "CopyInfos"))
    return task


def _datagrams(task: Element) -> Iterator[Element]:
    for frame in task.all("Frame"):
        yield from frame.all("Cmd")

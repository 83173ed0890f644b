"""Reads ENI files (ETG.2100)."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

from ecatd.base.errors import ConfigError
from ecatd.etg.pdo import Pdo
from ecatd.etg.sii import UNASSIGNED

from ..esi.findings import Findings
from ..esi.reader import read_entries, read_idn_commands
from ..esi.xml import Element, read_xml
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


def read_network(path: Path, findings: Findings | None = None) -> EniNetwork:
    """Reads an ENI file. Malformed parts are left out, unless slaves would have other positions.

    Args:
        path: The file.
        findings: Takes what is wrong in it; `EniNetwork.findings` of the result.

    Raises:
        ConfigError: The file cannot be read, is not an ENI file, or does not say which slaves there
            are. The message begins with the file and, if known, the line.
    """
    findings = Findings() if findings is None else findings

    def wanted(element: Element, depth: int) -> bool:
        return depth == 0 or element.tag not in _UNUSED

    root = read_xml(path, wanted, findings)
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
        findings,
        [_task(element) for element in config.all("Cyclic")],
        [(item.line, item.tag) for item in config.children if item.tag not in _KNOWN_IN_CONFIG],
    )


def _slaves(elements: list[Element]) -> list[EniSlave]:
    """Reads the slaves; those behind the first one of a hot connect group belong to it."""
    slaves: list[EniSlave] = []
    group = members = 0
    for number, element in enumerate(elements):
        element.findings.part = f"<Slave> {number}, '{element.text_of('Info', 'Name')}'"
        slave = _named(element)
        begin = element.find("HotConnect")
        if begin is not None:
            group += 1
            members = max(1, begin.number_or("GroupMemberCnt", 1, high=_SLAVES_MAX))
            slave.group_name = begin.text_of("GroupName")
        slave.group = group if members else 0
        members -= members > 0
        slaves.append(slave)
        element.findings.part = ""
    return slaves


def _named(element: Element) -> EniSlave:
    """Reads a slave; names it in errors, since many files have everything on one line."""
    try:
        return _slave(element)
    except ConfigError as error:
        raise ConfigError(f"{error} (in {element.findings.part})") from None


def _slave(element: Element) -> EniSlave:
    info = element.need("Info")
    automatic = info.find("AutoIncAddr")
    slave = EniSlave(
        element.line,
        info.text_of("Name"),
        info.number_of("PhysAddr", 0, high=0xFFFF),
        info.number_of("AutoIncAddr", low=-0xFFFF, high=0xFFFF) & 0xFFFF if automatic else None,
        info.number_of("VendorId"),
        info.number_of("ProductCode"),
        info.number_of("RevisionNo", 0),
        info.number_or("SerialNo", 0),
        _identification(info, element.find("HotConnect")),
    )
    data = element.find("ProcessData")
    if data is not None:
        _read_process_data(data, slave)
    mailbox = element.find("Mailbox")
    if mailbox is not None:
        _read_mailbox(mailbox, slave)
    slave.registers = _commands(element, _register)
    clock = element.find("DC")
    if clock is not None:
        slave.clock = EniClock(
            clock.line,
            clock.flag_of("ReferenceClock"),
            clock.number_or("CycleTime0", 0),
            clock.number_or("ShiftTime", 0, -(1 << 31)),
        )
    known = _KNOWN_IN_SLAVE
    slave.others += [(item.line, item.tag) for item in element.children if item.tag not in known]
    return slave


Command = TypeVar("Command")


def _commands(parent: Element, read: Callable[[Element], Command]) -> list[Command]:
    """The commands in the <InitCmds> of an element, without malformed ones."""
    together = parent.find("InitCmds")
    commands = []
    for item in together.all("InitCmd") if together else ():
        with item.instead("this command is left out"):
            commands.append(read(item))
    return commands


def _identification(info: Element, group: Element | None) -> tuple[int, int] | None:
    """Register and value by which the master finds a slave wherever it stands."""
    named = info.find("Identification")
    if named is not None:
        with named.instead():
            return named.number_of("Ado", high=0xFFFF), named.attribute("Value", high=0xFFFF)
    for item in group.all("IdentifyCmd") if group else ():
        expected = item.find("Validate", "Data")
        if expected is not None:
            with item.instead():
                value = int.from_bytes(expected.octets(8)[:2], "little")
                return item.number_of("Ado", high=0xFFFF), value
    return None


def _read_process_data(element: Element, slave: EniSlave) -> None:
    for tag in ("Send", "Recv"):
        with element.instead("the size of these process data is not known"):
            # A slave with several areas has several such elements.
            bits = sum(item.number_of("BitLength", 0) for item in element.all(tag))
            if tag == "Send":
                slave.output_bits = bits
            else:
                slave.input_bits = bits
    managers = [item for item in element.children if _SYNC_MANAGER.fullmatch(item.tag)]
    for item in sorted(managers, key=lambda item: int(item.tag[2:])):
        if item.text_of("Type") in ("Outputs", "Inputs"):
            with item.instead("this sync manager is left out"):
                slave.sync_managers.append(
                    EniSyncManager(
                        int(item.tag[2:]),
                        item.text_of("Type") == "Outputs",
                        item.number_of("ControlByte", 0, high=0xFF),
                        tuple(pdo.number(high=0xFFFF) for pdo in item.all("Pdo")),
                    )
                )
    for tag, pdos in (("RxPdo", slave.outputs), ("TxPdo", slave.inputs)):
        for item in element.all(tag):
            with item.instead("the entries of this PDO are not known"):
                pdos.append(_pdo(item))


def _pdo(element: Element) -> Pdo:
    return Pdo(
        element.number_of("Index", high=0xFFFF),
        element.name(),
        element.attribute("Sm", UNASSIGNED, high=0xFF),
        read_entries(element),
    )


def _read_mailbox(element: Element, slave: EniSlave) -> None:
    coe = element.find("CoE")
    protocols = {item.text for item in element.all("Protocol")}
    slave.coe = coe is not None or "CoE" in protocols
    slave.objects = _commands(coe, _object) if coe else []
    soe = element.find("SoE")
    slave.soe = soe is not None or "SoE" in protocols
    slave.idns = read_idn_commands(soe) if soe else []
    for item in element.children:
        inside = item.find("InitCmds")
        if item.tag not in ("CoE", "SoE") and inside is not None and inside.has("InitCmd"):
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
    task = EniTask(element.line, element.number_or("CycleTime", 0), element.text_of("Comment"))
    for item in _datagrams(element):
        with item.instead("this datagram is left out"):
            _read_datagram(item, task)
        copies = item.find("CopyInfos")
        if copies is not None and copies.children:
            task.others.append((copies.line, "CopyInfos"))
    return task


def _read_datagram(item: Element, task: EniTask) -> None:
    command = item.number_of("Cmd", high=0xFF)
    if command in _LOGICAL:
        data = item.find("Data")
        length = len(data.octets()) if data else item.number_of("DataLength", 0)
        task.areas.append((item.number_of("Addr"), length))
    elif command in _HANDS_TIME_ON and item.number_of("Ado", 0) == _SYSTEM_TIME:
        task.clock = item.number_of("Adp", high=0xFFFF)


def _datagrams(task: Element) -> Iterator[Element]:
    for frame in task.all("Frame"):
        yield from frame.all("Cmd")

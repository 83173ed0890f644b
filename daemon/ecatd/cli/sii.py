"""Command `sii-read`: what is in the EEPROM of a slave."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from ecatd.description.bus import Slave
from ecatd.etg.pdo import Pdo
from ecatd.etg.sii import UNASSIGNED, Sii, SiiMailbox
from ecatd.etg.sii_check import check_sii

from .arguments import add_one_slave
from .output import print_json, progress
from .saving import add_force, add_out, check_target, save_bytes

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

COMMANDS = {"mailboxes": {"sii-read": "Show what is in the EEPROM of a slave, or save it."}}

_PROTOCOLS = ("AoE", "EoE", "CoE", "FoE", "SoE", "VoE")
_COE = ("SDO", "SDO information", "PDO assignment", "PDO configuration", "upload at the start")
_USAGES = ("not used", "mailbox out", "mailbox in", "outputs", "inputs")
_AS_THEY_ARE = (
    *("vendor", "product", "revision", "serial", "alias", "name", "order", "group"),
    "complete_access",
)
_FMMUS = {1: "outputs", 2: "inputs", 3: "mailbox state"}


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments of the command."""
    add_one_slave(command)
    add_out(command, "save the bytes to this file")
    add_force(command)


def sii_read(remote: Remote, options: argparse.Namespace) -> None:
    """Reads an EEPROM, and shows or saves it."""
    if options.out is not None:
        check_target(options.out, force=options.force)
    found = remote.describe().find(options.slave)
    image = read_image(remote, found)
    sii = check_sii(image)
    if options.out is not None:
        save_bytes(options.out, image, force=options.force)
    if options.json:
        file = None if options.out is None else str(options.out)
        document = {"bus": remote.bus, "slave": found.position, "bytes": len(image), "file": file}
        print_json({**document, "sii": _document(sii)})
    elif options.out is not None:
        print(f"{options.out}: {len(image)} bytes of the EEPROM of {found.label}")
    else:
        print("\n".join(sii_lines(sii, len(image))))


def read_image(remote: Remote, found: Slave) -> bytes:
    """Reads the EEPROM of a slave, and shows how far it is; raises as `Remote.sii`."""
    with progress() as show:
        return remote.sii(found.position, lambda read: show(f"{read} bytes of the EEPROM"))


def _names(bits: int, names: tuple[str, ...]) -> list[str]:
    return [name for number, name in enumerate(names) if bits & 1 << number]


def _document(sii: Sii) -> dict[str, Any]:
    return {
        **{key: getattr(sii, key) for key in _AS_THEY_ARE},
        "mailbox_protocols": _names(sii.mailbox_protocols, _PROTOCOLS),
        "coe": _names(sii.coe, _COE),
        "ebus_current_ma": sii.ebus_current,
        "fmmus": [_FMMUS.get(item, "not used") for item in sii.fmmus],
        "sync_managers": [
            {
                **{key: getattr(item, key) for key in ("start", "length", "control", "enable")},
                "usage": _usage(item.usage),
            }
            for item in sii.sync_managers
        ],
        "outputs": [_pdo_document(pdo) for pdo in sii.outputs],
        "inputs": [_pdo_document(pdo) for pdo in sii.inputs],
        "clock_modes": [item.name for item in sii.dc],
        "problems": [str(problem) for problem in sii.problems],
    }


def _pdo_document(pdo: Pdo) -> dict[str, Any]:
    return {
        "index": pdo.index,
        "name": pdo.name,
        "sync_manager": None if pdo.sync_manager == UNASSIGNED else pdo.sync_manager,
        "entries": [
            {
                **{key: getattr(entry, key) for key in ("index", "subindex", "name")},
                "bits": entry.bit_length,
            }
            for entry in pdo.entries
        ],
    }


def _usage(usage: int) -> str:
    return _USAGES[usage] if usage < len(_USAGES) else f"usage {usage}"


def sii_lines(sii: Sii, size: int) -> Iterator[str]:
    """What is in an EEPROM of so many bytes, for a person."""
    protocols = ", ".join(_names(sii.mailbox_protocols, _PROTOCOLS)) or "none"
    coe = [*_names(sii.coe, _COE), *(["complete access"] if sii.complete_access else [])]
    for name, value in (
        ("size", f"{size} bytes"),
        ("vendor", f"0x{sii.vendor:08X}"),
        ("product", f"0x{sii.product:08X}"),
        ("revision", f"0x{sii.revision:08X}"),
        ("serial", f"0x{sii.serial:08X}" if sii.serial else "none"),
        ("alias", str(sii.alias)),
        ("name", sii.name),
        ("order code", sii.order),
        ("group", sii.group),
        ("mailbox", _mailbox(sii.mailbox)),
        ("mailbox in BOOT", _mailbox(sii.bootstrap)),
        ("protocols", protocols),
        ("CoE", ", ".join(coe)),
        ("E-bus current", f"{sii.ebus_current} mA" if sii.ebus_current else ""),
        ("FMMUs", ", ".join(_FMMUS.get(item, "not used") for item in sii.fmmus)),
        ("clock modes", ", ".join(item.name for item in sii.dc)),
    ):
        if value:
            yield f"{name:<16}{value}"
    if sii.sync_managers:
        yield "sync managers"
    for number, manager in enumerate(sii.sync_managers):
        yield (
            f"  {number}  0x{manager.start:04X}  {manager.length:>4} bytes  "
            f"control 0x{manager.control:02X}  {_usage(manager.usage)}"
        )
    for what, pdos in (("outputs", sii.outputs), ("inputs", sii.inputs)):
        if pdos:
            yield what
        for pdo in pdos:
            place = "" if pdo.sync_manager == UNASSIGNED else f"sync manager {pdo.sync_manager}"
            bits = sum(entry.bit_length for entry in pdo.entries)
            yield f"  0x{pdo.index:04X}  {bits:>4} bits  {place or 'not assigned':<14}  {pdo.name}"
    for problem in sii.problems:
        yield f"problem: {problem}"


def _mailbox(mailbox: SiiMailbox) -> str:
    if not mailbox.exists:
        return "none"
    return (
        f"out 0x{mailbox.receive:04X} ({mailbox.receive_size} bytes), "
        f"in 0x{mailbox.send:04X} ({mailbox.send_size} bytes)"
    )

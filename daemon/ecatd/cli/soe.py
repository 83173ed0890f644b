"""Commands `soe-read` and `soe-write`: IDNs of drives with SoE (IEC 61800-7-204)."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from ecatd.base.errors import StateError, UsageError
from ecatd.etg.idns import ALL_IDNS, IdnValue, idn_text, parse_idn

from .arguments import add_one_slave, bounded, hex_bytes
from .output import counted, print_json, print_table

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

COMMANDS = {
    "mailboxes": {
        "soe-read": "Read IDNs of a drive (SoE).",
        "soe-write": "Write an IDN of a drive (SoE).",
    },
}


def add_arguments(command: argparse.ArgumentParser, name: str) -> None:
    """Adds the arguments of a command."""
    reading = name == "soe-read"
    add_one_slave(command)
    command.add_argument(
        "idn",
        type=_idn,
        nargs="?" if reading else None,
        metavar="IDN",
        help="an IDN such as S-0-0047 or P-0-0100"
        + (" (default: all that the drive lists)" if reading else ""),
    )
    if not reading:
        command.add_argument(
            "value",
            metavar="VALUE",
            help="a number, text, a list such as 1,2,3, or bytes such as 'hex:04 00'",
        )
    command.add_argument(
        "--drive",
        type=bounded(0, 7),
        default=0,
        metavar="N",
        help="which drive of the slave (default: 0)",
    )


def _idn(text: str) -> int:
    try:
        return parse_idn(text)
    except UsageError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def soe_read(remote: Remote, options: argparse.Namespace) -> None:
    """Reads one IDN, or all that the drive lists in S-0-0017."""
    if options.idn is not None:
        found = remote.read_idn(options.slave, options.idn, options.drive)
        if options.json:
            print_json({"bus": remote.bus, "slave": options.slave, "idns": [_document(found)]})
        else:
            print(f"{_value(found)}  {found.name}".rstrip())
        return
    listed = remote.read_idn(options.slave, ALL_IDNS, options.drive).value
    numbers = [int.from_bytes(listed[at : at + 2], "little") for at in range(0, len(listed), 2)]
    rows: list[IdnValue] = []
    documents: list[dict[str, Any]] = []
    for number in counted(numbers, "IDNs"):
        try:
            found = remote.read_idn(options.slave, number, options.drive)
        except StateError as error:  # the drive may list what cannot be read now
            documents.append({"idn": idn_text(number), "error": error.to_reply()})
            if not options.json:
                print(f"{idn_text(number)}: {error}")
        else:
            documents.append(_document(found))
            rows.append(found)
    if options.json:
        print_json({"bus": remote.bus, "slave": options.slave, "idns": documents})
        return
    print_table(
        ("IDN", "NAME", "VALUE", "WRITE-PROTECTED IN"),
        ((idn_text(r.number), r.name, _value(r), " ".join(r.attribute.protected)) for r in rows),
    )


def soe_write(remote: Remote, options: argparse.Namespace) -> None:
    """Writes the value of an IDN."""
    text: str = options.value
    known = remote.read_idn(options.slave, options.idn, options.drive)
    data = hex_bytes(text)
    if data is None:
        data = known.attribute.encode(text.removesuffix(known.unit).strip() if known.unit else text)
    written = remote.write_idn(options.slave, options.idn, data, options.drive)
    if options.json:
        print_json({"bus": remote.bus, "slave": options.slave, "idns": [_document(written)]})


def _value(found: IdnValue) -> str:
    return f"{found.attribute.text(found.value)} {found.unit}".rstrip()


def _document(found: IdnValue) -> dict[str, Any]:
    return {
        "idn": idn_text(found.number),
        "name": found.name,
        "unit": found.unit,
        "attribute": found.attribute.raw,
        "value": found.attribute.decode(found.value),
        "data": found.value.hex(),
    }

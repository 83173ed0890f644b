"""Commands `sdo-read` and `sdo-write`."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ecatd.base.addresses import address_text
from ecatd.base.errors import UsageError
from ecatd.etg import scaling
from ecatd.etg.datatypes import (
    STRINGS,
    TYPE_NAMES,
    DataType,
    decode,
    encode,
    is_real,
    parse_type,
    type_name,
)
from ecatd.operations.objects import DATA_MAX

from . import addresses
from .arguments import add_one_slave, hex_bytes
from .output import print_json
from .saving import add_force, add_out, check_target, read_bytes, save_bytes

if TYPE_CHECKING:
    from ecatd.client.remote import Remote, SdoValue

COMMANDS = {
    "objects": {
        "sdo-read": "Read an object of a slave.",
        "sdo-write": "Write an object of a slave.",
    },
}

_WITH_UNIT = re.compile(r"([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?) +(\S.*)")
"""A number with a unit."""


def add_arguments(command: argparse.ArgumentParser, name: str) -> None:
    """Adds the arguments of a command."""
    reading = name == "sdo-read"
    add_one_slave(command)
    command.add_argument("object", type=addresses.object_, metavar="OBJECT", help=addresses.HELP)
    command.add_argument(
        "subindex",
        type=addresses.subindex,
        nargs="?",
        metavar="SUBINDEX",
        help="subindex, unless OBJECT has one" + (" (default: 0)" if reading else ""),
    )
    if not reading:
        command.add_argument(
            "value",
            metavar="VALUE",
            help="a number, a number with its unit ('1.5 V'), text, bytes ('hex:04 00'), or "
            "@FILE for the bytes of a file",
        )
    command.add_argument(
        "--type",
        metavar="TYPE",
        help=f"data type of the object, if ecatd does not know it: {', '.join(TYPE_NAMES)}",
    )
    command.add_argument(
        "--complete", action="store_true", help="transfer all subindices at once (complete access)"
    )
    if reading:
        add_out(command, "save the bytes in this file")
        add_force(command)
    command.add_argument(
        "-v",
        "--verbose",
        action="store_true",
        help="also print the name and the type of the object",
    )


def sdo_read(remote: Remote, options: argparse.Namespace) -> None:
    """Uploads an object and prints it as `ethercat upload` does: hexadecimal and decimal."""
    if options.out is not None:
        check_target(options.out, force=options.force)
    options.index, subindex = addresses.find_object(
        remote, options.slave, options.object, options.subindex
    )
    options.subindex = subindex or 0
    found = remote.sdo_read(
        options.slave, options.index, options.subindex, complete=options.complete
    )
    if options.type:
        found = found._replace(data_type=parse_type(options.type))
    value = decode(found.data_type, found.data)
    if options.out is not None:
        save_bytes(options.out, found.data, force=options.force)
    if options.json:
        print_json(_document(remote, options, found) | {"value": value})
        return
    if options.out is not None:
        print(f"{options.out}: {len(found.data)} bytes")
        return
    text = value_text(found)
    if options.verbose:
        address = address_text(options.index, options.subindex)
        text += f"  {address} {type_name(found.data_type)} {found.name}".rstrip()
        if physical := physical_text(found):
            text += f" = {physical}"
    print(text)


def value_text(found: SdoValue) -> str:
    """A value for people: an integer in hexadecimal and decimal, as `ethercat upload` has it."""
    value = decode(found.data_type, found.data)
    if isinstance(value, int) and not is_real(found.data_type):
        digits = 2 * len(found.data)
        return f"0x{int.from_bytes(found.data, 'little'):0{digits}X} {int(value)}"
    return str(value)


def physical_text(found: SdoValue) -> str:
    """The physical value, such as `4.2 V`; empty if it has none."""
    value = decode(found.data_type, found.data)
    return scaling.physical_text(value, found.unit, found.scale, found.offset)


def _document(remote: Remote, options: argparse.Namespace, found: SdoValue) -> dict[str, Any]:
    """The part of the JSON output that both commands have."""
    meaning = {"unit": found.unit, "scale": found.scale, "offset": found.offset}
    return {
        "bus": remote.bus,
        "slave": options.slave,
        "index": options.index,
        "subindex": options.subindex,
        "name": found.name,
        "type": type_name(found.data_type),
        "data": found.data.hex(),
        **(meaning if scaling.is_physical(found.unit, found.scale, found.offset) else {}),
    }


def to_write(
    remote: Remote,
    slave: int | str,
    index: int,
    subindex: int,
    text: str,
    chosen: DataType | None = None,
) -> bytes | str:
    """What a typed value stands for: bytes, or a text that the daemon converts to bytes.

    Raises:
        UsageError: The value is malformed, a file cannot be read, or a unit does not fit.
    """
    if (data := hex_bytes(text)) is not None:
        return data
    if text.startswith("@"):
        if text == "@":
            raise UsageError("'@' names no file: write it as @FILE")
        return read_bytes(Path(text[1:]), DATA_MAX)
    if chosen is not None:
        return encode(chosen, text)
    match = _WITH_UNIT.fullmatch(text)
    if match is None:
        return text
    known = remote.sdo_read(slave, index, subindex)
    if known.data_type in STRINGS:
        return text
    from ecatd.description.physical import nearest_raw
    from ecatd.etg.pdo import Entry  # loading it takes longer than the rest of the command

    entry = Entry(
        *(index, subindex, known.name, known.data_type, 8 * len(known.data)),
        unit=known.unit,
        scale=known.scale,
        offset=known.offset,
    )
    return str(nearest_raw(entry, float(match[1]), match[2]))


def sdo_write(remote: Remote, options: argparse.Namespace) -> None:
    """Downloads a value to an object; the daemon finds out the type unless `--type` is given."""
    chosen = parse_type(options.type) if options.type else None
    options.index, subindex = addresses.find_object(
        remote, options.slave, options.object, options.subindex
    )
    if subindex is None:
        raise UsageError(
            "the subindex is missing: write an object with it, such as "
            f"{address_text(options.index, 0)}"
        )
    options.subindex = subindex
    place = options.slave, options.index, subindex
    data = to_write(remote, *place, options.value, chosen)
    written = remote.sdo_write(*place, data, complete=options.complete)
    if chosen is not None:
        written = written._replace(data_type=chosen)
    if options.json:
        print_json(_document(remote, options, written))

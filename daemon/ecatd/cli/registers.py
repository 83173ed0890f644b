"""Commands `reg-read` and `reg-write`: registers of the slave controller (ESC) of a slave."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from ecatd.base.addresses import REGISTER_MOST, parse_number
from ecatd.base.errors import StateError, UsageError
from ecatd.etg.registers import (
    REGISTERS,
    Register,
    controlled,
    find_register,
    register_at,
    register_text,
)
from ecatd.operations.registers import ReadRegister, WriteRegister

from .arguments import add_one_slave, add_yes, bounded, confirm, hex_bytes
from .output import print_json, print_table

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

COMMANDS = {
    "slaves": {
        "reg-read": "Read registers of a slave.",
        "reg-write": "Write registers of a slave.",
    },
}

_FEATURES, _HAS_CLOCK = 0x0008, 0x04
_CLOCK = range(0x0910, 0x0A00)
_SIZE = 2
_NUMBER_MOST = 8
"""Sizes in bytes that are also shown as a number."""


def add_arguments(command: argparse.ArgumentParser, name: str) -> None:
    """Adds the arguments of a command."""
    add_one_slave(command)
    reading = name == "reg-read"
    command.add_argument(
        "register",
        nargs="?" if reading else None,
        metavar="REGISTER",
        help="address such as 0x0130, or name such as al_status"
        + (" (default: all that have a name)" if reading else ""),
    )
    if reading:
        command.add_argument(
            "size",
            type=bounded(1, 256),
            nargs="?",
            metavar="BYTES",
            help="number of bytes (default: the size of the register, or 2)",
        )
        return
    command.add_argument(
        "value",
        metavar="VALUE",
        help="a number, or bytes such as 'hex:04 00', lowest address first",
    )
    command.add_argument(
        "--size",
        type=bounded(1, 8),
        metavar="BYTES",
        help="size of a number in bytes (default: the size of the register, or 2)",
    )
    add_yes(command)


def _register(text: str, size: int | None) -> Register:
    """Returns the register that the user has named, with the wanted number of bytes.

    Raises:
        UsageError: There is no such register.
    """
    if text[:1].isdigit():
        address = parse_number(text, "register", REGISTER_MOST)
        found = register_at(address) or Register("", address, _SIZE, "")
    else:
        found = find_register(text)
    return found._replace(size=size or found.size)


def reg_read(remote: Remote, options: argparse.Namespace) -> None:
    """Reads registers, and prints their bytes and their number."""
    if options.register is None:
        rows = list(_all(remote, options.slave))
    else:
        register = _register(options.register, options.size)
        rows = [_row(register, remote.request(ReadRegister(options.slave, *register[1:3]))["data"])]
    if options.json:
        print_json({"bus": remote.bus, "slave": options.slave, "registers": rows})
    elif options.register is not None:
        (row,) = rows
        print(row["data"] if row["value"] is None else _number(row))
    else:
        print_table(
            ("REGISTER", "NAME", "VALUE", "WHAT"),
            (
                (f"0x{row['address']:04X}", row["name"], _number(row), register_text(row["name"]))
                for row in rows
            ),
        )


def _all(remote: Remote, slave: int | str) -> Iterator[dict[str, Any]]:
    """The registers with a name that the slave has.

    The registers of the clock are the last ones. They do not answer if the slave has no clock, or
    if its EEPROM switches the clock off.
    """
    features = int.from_bytes(remote.request(ReadRegister(slave, _FEATURES))["data"], "little")
    for item in REGISTERS:
        of_clock = item.address in _CLOCK
        if of_clock and not features & _HAS_CLOCK:
            return
        try:
            data = remote.request(ReadRegister(slave, item.address, item.size))["data"]
        except StateError:
            if of_clock:
                return
            continue
        yield _row(item, data)


def _row(item: Register, data: bytes) -> dict[str, Any]:
    value = int.from_bytes(data, "little") if len(data) <= _NUMBER_MOST else None
    return {"address": item.address, "name": item.name, "data": data.hex(" "), "value": value}


def _number(row: dict[str, Any]) -> str:
    digits = 2 * len(row["data"].split())
    return f"0x{row['value']:0{digits}X} {row['value']}"


def reg_write(remote: Remote, options: argparse.Namespace) -> None:
    """Writes registers, after a question; prints what they have afterwards."""
    register = _register(options.register, options.size)
    data = _data(options.value, register.size)
    found = remote.describe().find(options.slave)
    name = f" ({register.name})" if register.name else ""
    about = (
        f"This writes {data.hex(' ')} to register 0x{register.address:04X}{name} of {found.label}."
    )
    if decided := controlled(register.address, len(data)):
        about += f" ecatd itself controls {', '.join(decided)}, so the bus may stop working."
    confirm(options, about)
    row = _row(
        register, remote.request(WriteRegister(options.slave, register.address, data))["data"]
    )
    if options.json:
        print_json({"bus": remote.bus, "slave": options.slave, "registers": [row]})
    else:
        print(row["data"] if row["value"] is None else _number(row))


def _data(text: str, size: int) -> bytes:
    """The bytes of a value.

    Raises:
        UsageError: It is neither a number of this size, nor bytes.
    """
    if (data := hex_bytes(text)) is not None:
        return data
    try:
        return int(text, 0).to_bytes(size, "little")
    except ValueError:
        raise UsageError(f"'{text}' is not a number (10 or 0x0A)") from None
    except OverflowError:
        raise UsageError(
            f"{text} does not fit into {size} byte{'s' * (size != 1)}: give another --size"
        ) from None

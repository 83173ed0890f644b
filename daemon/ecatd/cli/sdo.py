"""Commands `sdo-read` and `sdo-write`."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ecatd.model import abort_codes
from ecatd.model.bus import Slave
from ecatd.model.datatypes import (
    TYPE_NAMES,
    DataType,
    bit_length,
    decode,
    encode,
    is_real,
    parse_type,
    type_name,
)
from ecatd.model.errors import EcatError, SdoAbortError, UsageError
from ecatd.model.objects import standard_object

from .arguments import bounded, position
from .output import print_json
from .show import pick_slaves

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

_FOUR_DIGITS = re.compile("[1-9][0-9]{3}")
_BY_SIZE = {
    1: DataType.UNSIGNED8,
    2: DataType.UNSIGNED16,
    4: DataType.UNSIGNED32,
    8: DataType.UNSIGNED64,
}


class Index(int):
    """An object index, and how it was typed."""

    typed: str


def _index(text: str) -> Index:
    value = Index(bounded(0, 0xFFFF)(text))
    value.typed = text
    return value


def add_arguments(command: argparse.ArgumentParser, name: str) -> None:
    """The arguments of each command."""
    reading = name == "sdo-read"
    command.set_defaults(run=sdo_read if reading else sdo_write)
    command.add_argument("slave", type=position, metavar="POS", help="position of the slave")
    command.add_argument("index", type=_index, help="object index, as 0x6060")
    command.add_argument(
        "subindex",
        type=bounded(0, 0xFF),
        nargs="?" if reading else None,
        default=0,
        help="object subindex" + (" (default: 0)" if reading else ""),
    )
    if not reading:
        command.add_argument("value", help="number, text, or hexadecimal bytes")
    command.add_argument(
        "--type",
        metavar="TYPE",
        help=f"data type, where it is not known: {', '.join(TYPE_NAMES)}",
    )
    command.add_argument("--complete", action="store_true", help="complete access")
    command.add_argument("-v", "--verbose", action="store_true", help="print name and type too")


def _known(slave: Slave, index: int, subindex: int) -> tuple[str, int] | None:
    """Name and type of an object: from the process data, else from the standards."""
    entries = [e for outputs in (True, False) for _, e, _ in slave.entries(outputs=outputs)]
    for entry in entries:
        if (entry.index, entry.subindex) == (index, subindex) and entry.data_type:
            return entry.name, entry.data_type
    drive = any((entry.index, entry.subindex) == (0x6041, 0) for entry in entries)
    return standard_object(index, subindex, drive=drive)


def _guess(data: bytes) -> DataType:
    """A type for data that nobody has a type for."""
    return _BY_SIZE.get(len(data), DataType.OCTET_STRING)


def sdo_read(remote: Remote, options: argparse.Namespace) -> None:
    """Uploads an object and prints it as `ethercat upload` does: hexadecimal and decimal."""
    (slave,) = pick_slaves(remote.describe(), options.slave)
    with _hint(options.index):
        value = remote.sdo_read(
            slave.position, options.index, options.subindex, complete=options.complete
        )
    name, data_type = _known(slave, options.index, options.subindex) or ("", 0)
    if options.complete:
        data_type = 0
    if options.type:
        data_type = parse_type(options.type)
    elif not data_type or _wrong_size(data_type, value.data):
        data_type = _guess(value.data)
    decoded = decode(data_type, value.data)
    if options.json:
        print_json(
            {
                "bus": remote.bus,
                "slave": slave.position,
                "index": options.index,
                "subindex": options.subindex,
                "name": name,
                "type": type_name(data_type),
                "data": value.data.hex(),
                "value": decoded,
            }
        )
        return
    text = str(decoded)
    if isinstance(decoded, int) and not is_real(data_type):
        digits = 2 * len(value.data)
        text = f"0x{int.from_bytes(value.data, 'little'):0{digits}X} {int(decoded)}"
    if options.verbose:
        address = f"0x{options.index:04X}:{options.subindex:02X}"
        text += f"  {address} {type_name(data_type)} {name}".rstrip()
    print(text)


@contextmanager
def _hint(index: Index) -> Iterator[None]:
    """Objects are known by hexadecimal numbers, and 6060 is easily typed for 0x6060."""
    try:
        yield
    except SdoAbortError as error:
        if error.code != abort_codes.NO_OBJECT or not _FOUR_DIGITS.fullmatch(index.typed):
            raise
        hint = f"{index.typed} is decimal, that is 0x{index:04X}; did you mean 0x{index.typed}?"
        raise SdoAbortError(error.code, f"{error} ({hint})") from error


def _wrong_size(data_type: int, data: bytes) -> bool:
    bits = bit_length(data_type)
    return bits > 0 and (bits + 7) // 8 != len(data)


def sdo_write(remote: Remote, options: argparse.Namespace) -> None:
    """Downloads a value to an object."""
    (slave,) = pick_slaves(remote.describe(), options.slave)
    with _hint(options.index):
        data_type = (
            parse_type(options.type) if options.type else _type_for_write(remote, slave, options)
        )
        data = encode(data_type, options.value)
        remote.sdo_write(
            slave.position, options.index, options.subindex, data, complete=options.complete
        )
    if options.json:
        print_json(
            {
                "bus": remote.bus,
                "slave": slave.position,
                "index": options.index,
                "subindex": options.subindex,
                "type": type_name(data_type),
                "data": data.hex(),
            }
        )


def _type_for_write(remote: Remote, slave: Slave, options: argparse.Namespace) -> DataType:
    """The type of the object to write, from what is known of it, else from its size."""
    known = _known(slave, options.index, options.subindex)
    if known is not None and bit_length(known[1]):
        return DataType(known[1])
    address = f"0x{options.index:04X}:{options.subindex:02X}"
    try:
        data = remote.sdo_read(slave.position, options.index, options.subindex).data
    except SdoAbortError:
        raise
    except EcatError as error:
        raise UsageError(f"the type of {address} is not known; give it with --type") from error
    if len(data) not in _BY_SIZE:
        raise UsageError(
            f"the type of {address} is not known and it has {len(data)} bytes; give it with --type"
        )
    return _BY_SIZE[len(data)]

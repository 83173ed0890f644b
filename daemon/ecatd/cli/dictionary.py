"""Command `sdos`: lists the object dictionary of a slave."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from ecatd.base.errors import EcatError, SdoAbortError, UsageError
from ecatd.etg.datatypes import STRINGS, bit_length, decode, type_alias, type_name
from ecatd.etg.dictionary import (
    Access,
    DictionaryEntry,
    DictionaryObject,
    access_text,
    mapping_text,
)
from ecatd.operations.objects import ListObjects

from . import addresses
from .arguments import add_one_slave
from .output import counted, print_json, print_table
from .sdo import physical_text, value_text

if TYPE_CHECKING:
    from ecatd.client.remote import Remote, SdoValue
    from ecatd.description.bus import Slave
    from ecatd.vendor.esi import EsiDevice

COMMANDS = {"objects": {"sdos": "List the objects of a slave: types, access rights, values."}}


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments of the command."""
    add_one_slave(command)
    command.add_argument(
        "index",
        type=addresses.object_,
        nargs="?",
        metavar="OBJECT",
        help="only this object: an index such as 0x1018, or the name of an entry (default: all)",
    )
    command.add_argument("--values", action="store_true", help="also read the values")
    add_esi(command)


def add_esi(command: argparse.ArgumentParser) -> None:
    """Adds the option `--esi`."""
    command.add_argument(
        "--esi",
        metavar="PATH",
        help="take the descriptions from this ESI file, or a folder of them, for a slave that does "
        "not describe its objects",
    )


def read_objects(
    remote: Remote, found: Slave, esi: str | None, index: int | None = None
) -> list[DictionaryObject]:
    """What the objects of a slave are, in ascending order.

    Args:
        remote: The daemon.
        found: The slave.
        esi: An ESI file or a folder of them; None to ask the slave.
        index: Only this object.

    Raises:
        StateError: The slave does not describe its objects, or no ESI file is about it.
        NoAnswerError: The slave does not answer, or does not describe its objects.
        SdoAbortError: There is no such object.
        UsageError: The ESI file describes no such object.
    """
    if esi is not None:
        described = [item for item in _from_esi(found, esi) if index in (None, item.index)]
        if not described:
            what = "no object" if index is None else f"no object 0x{index:04X}"
            raise UsageError(f"{esi}: describes {what} of {found.label}")
        return described
    if index is not None:
        return [remote.describe_object(found.position, index)]
    indices = sorted(remote.request(ListObjects(found.position))["objects"])
    described = []
    coming = remote.describe_objects(found.position, indices)
    for _, item in zip(counted(indices, "objects"), coming, strict=True):
        if isinstance(item, EcatError):
            raise item
        described.append(item)
    return described


def _from_esi(found: Slave, source: str) -> list[DictionaryObject]:
    from .esi_devices import device_of

    return objects_of(device_of(found, source))


def objects_of(device: EsiDevice) -> list[DictionaryObject]:
    """The objects that an ESI file describes."""
    return [
        DictionaryObject(
            item.index,
            item.name,
            item.code,
            item.entries[0].data_type if item.entries else 0,
            {
                entry.subindex: DictionaryEntry(
                    entry.name,
                    entry.data_type,
                    entry.bits,
                    entry.access,
                    entry.unit,
                    entry.default,
                    entry.minimum,
                    entry.maximum,
                )
                for entry in item.entries
            },
        )
        for item in device.objects
    ]


def read_value(
    remote: Remote, position: int, index: int, subindex: int, entry: DictionaryEntry
) -> SdoValue:
    """Reads an entry; name and type are those of its description, where they fit.

    Raises:
        SdoAbortError: The slave refuses.
        NoAnswerError: It does not answer.
        StateError: It has no mailbox in its present state.
    """
    found = remote.sdo_read(position, index, subindex)
    bits = bit_length(entry.data_type)
    fits = not bits or len(found.data) == (bits + 7) // 8
    if not entry.data_type or not fits:
        return found
    return found._replace(data_type=entry.data_type, name=entry.name or found.name)


def type_text(entry: DictionaryEntry) -> str:
    """The type of an entry as `--type` takes it; strings with their length in bytes."""
    name = type_alias(entry.data_type) or type_name(entry.data_type)
    fixed = bit_length(entry.data_type)
    if not fixed and entry.bit_length:
        return f"{name}({entry.bit_length // 8})"
    return name


def sdos(remote: Remote, options: argparse.Namespace) -> None:
    """Lists the objects of a slave, or one of them."""
    bus = remote.describe()
    found = bus.find_coe(options.slave)
    index = None
    if options.index is not None:
        index, _ = addresses.find_object(remote, found.position, options.index, None)
    objects = read_objects(remote, found, options.esi, index)
    rows = list(_rows(remote, found.position, objects, values=options.values))
    if options.json:
        print_json({"bus": bus.name, "slave": found.position, "objects": rows})
        return
    head = ("OBJECT", "TYPE", "ACCESS", "PDO", *(("VALUE",) if options.values else ()), "NAME")
    print_table(head, _cells(rows, options.values))


def _rows(
    remote: Remote, position: int, objects: list[DictionaryObject], *, values: bool
) -> Iterator[dict[str, Any]]:
    """The objects for JSON; each value is read when its object is yielded."""
    for item in counted(objects, "objects") if values else objects:
        entries = []
        for subindex, entry in item.entries.items():
            row: dict[str, Any] = {
                "subindex": subindex,
                "name": entry.name,
                "type": type_text(entry),
                "bits": entry.bit_length,
                "access": access_text(entry.access),
                "pdo": mapping_text(entry.access),
                "default": described_value(entry, entry.default),
                "minimum": described_value(entry, entry.minimum),
                "maximum": described_value(entry, entry.maximum),
            }
            if values and entry.access & Access.READ:
                row |= _value(remote, position, item.index, subindex, entry)
            entries.append(row)
        yield {"index": item.index, "name": item.name, "entries": entries}


def described_value(entry: DictionaryEntry, data: bytes | None) -> int | float | bool | str | None:
    """A default or limit, which a slave sends in the size of the entry; None: it sends none."""
    if data is None:
        return None
    fits = len(data) == (bit_length(entry.data_type) + 7) // 8 or entry.data_type in STRINGS
    return decode(entry.data_type, data) if fits else data.hex(" ")


def _value(
    remote: Remote, position: int, index: int, subindex: int, entry: DictionaryEntry
) -> dict[str, Any]:
    try:
        found = read_value(remote, position, index, subindex, entry)
    except SdoAbortError as error:  # an entry can have a description and not be readable now
        return {"error": error.to_reply()}
    return {
        "data": found.data.hex(),
        "value": decode(found.data_type, found.data),
        "text": value_text(found),
        "physical": physical_text(found),
    }


def _cells(rows: list[dict[str, Any]], values: bool) -> Iterator[tuple[str, ...]]:
    """The lines of the table. An object with several entries begins with a line for its name."""
    for item in rows:
        address = f"0x{item['index']:04X}"
        single = len(item["entries"]) == 1 and item["entries"][0]["subindex"] == 0
        if not single:
            yield (address, "", "", "", *([""] * values), item["name"])
        for row in item["entries"]:
            name = item["name"] or row["name"] if single else f"  {row['name']}"
            yield (
                f"{address}:{row['subindex']:02X}",
                row["type"],
                row["access"],
                row["pdo"],
                *([_shown(row)] * values),
                name,
            )


def _shown(row: dict[str, Any]) -> str:
    if "error" in row:
        return f"refused: {row['error']['text']}"
    physical = f" = {row['physical']}" if row.get("physical") else ""
    return f"{row.get('text', '')}{physical}"

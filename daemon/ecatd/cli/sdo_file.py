"""Commands `sdo-dump` and `sdo-restore`: the values of all objects of a slave, in a file.

The tables of the file are those of `[[slave.startup]]`, so they can be copied into a configuration.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ecatd.base.errors import EcatError, SdoAbortError, StateError, UsageError
from ecatd.base.toml_file import Rules, Table, integer, read_toml
from ecatd.base.version import VERSION
from ecatd.config import StartupConfig
from ecatd.config.startup import read_parameter
from ecatd.config.writer import value_text as toml_text
from ecatd.description.bus import Slave
from ecatd.etg.datatypes import STRINGS, decode, parse_type, type_alias
from ecatd.etg.dictionary import Access, DictionaryEntry, access_text

from .arguments import add_one_slave, add_yes, confirm
from .dictionary import add_esi, read_objects, read_value
from .output import counted, print_json, print_table
from .saving import add_force, add_out, check_target, save
from .sdo import physical_text, value_text

if TYPE_CHECKING:
    from ecatd.client.remote import Remote, SdoValue

COMMANDS = {
    "objects": {
        "sdo-dump": "Save the values of all objects of a slave to a file.",
        "sdo-restore": "Write the values of an sdo-dump file back to a slave, where they differ.",
    },
}

_STDOUT = "-"
_FIRST_OWN = 0x2000
"""Objects below describe the communication (ETG.1000.6): the configuration has their values."""

_COMMENT_MOST = 120
_U32 = integer(0, 0xFFFFFFFF)
_DEVICE: Rules = {
    "name": Table.text,
    "vendor": _U32,
    "product": _U32,
    "revision": _U32,
    "values": _U32,
}
_FILE: Rules = {
    "slave": lambda table, key: table.table(key).read(_DEVICE, required=("vendor", "product")),
    "startup": lambda table, key: table.array(
        key, read_parameter, "an array of tables, written as [[startup]]"
    ),
}


def add_arguments(command: argparse.ArgumentParser, name: str) -> None:
    """Adds the arguments of a command."""
    add_one_slave(command)
    if name == "sdo-dump":
        add_out(command, "the file (default: print it)")
        add_force(command)
        add_esi(command)
        return
    command.add_argument("file", metavar="FILE", type=Path, help="a file that sdo-dump has written")
    command.add_argument("--dry-run", action="store_true", help="only show what would be written")
    add_yes(command)


# --- dump ----------------------------------------------------------------------------------------


def sdo_dump(remote: Remote, options: argparse.Namespace) -> None:
    """Reads all objects of a slave, and writes those that can be restored as tables."""
    if options.out is not None and str(options.out) != _STDOUT:
        check_target(options.out, force=options.force)
    bus = remote.describe()
    found = bus.find_coe(options.slave)
    rows = [
        (item.index, subindex, item.name, entry)
        for item in read_objects(remote, found, options.esi)
        for subindex, entry in item.entries.items()
        if entry.access & Access.READ
    ]
    outputs = {(entry.index, entry.subindex) for _, entry, _ in found.entries(outputs=True)}
    lines: list[str] = [""]
    tables = refused = 0
    is_table = False
    for index, subindex, name, entry in counted(rows, "values"):
        try:
            value = read_value(remote, found.position, index, subindex, entry)
        except SdoAbortError as error:
            refused += 1
            block = [f"# 0x{index:04X}:{subindex:02X} {_one_line(name)}: {error}"]
            was_table, is_table = is_table, False
        else:
            restorable = index >= _FIRST_OWN and (index, subindex) not in outputs
            was_table, is_table = is_table, restorable and bool(entry.access & Access.WRITE)
            tables += is_table
            write = _table if is_table else _comment
            block = [*write(index, subindex, name, entry, value)]
        lines += [*([""] if is_table or was_table else []), *block]
    text = "\n".join([*_head(found, tables), *lines]) + "\n"
    if options.out is not None and str(options.out) != _STDOUT:
        save(options.out, text, force=options.force)
    elif not options.json:
        sys.stdout.write(text)
        return
    counts = {"values": len(rows) - refused, "restorable": tables, "refused": refused}
    if options.json:
        file = None if options.out is None else str(options.out)
        print_json({"bus": bus.name, "slave": found.position, "file": file, **counts})
        return
    print(
        f"{options.out}: {counts['values']} values of {found.label}; sdo-restore can write "
        f"{tables} of them back" + (f"; {refused} could not be read" if refused else "")
    )


def _head(found: Slave, values: int) -> Iterator[str]:
    yield f"# Values of all objects of {_one_line(found.label)}, written by ecatctl {VERSION}."
    yield "# `ecatctl sdo-restore SLAVE FILE` writes the tables back whose values differ. Comments"
    yield "# are values that cannot be written, that belong to the communication, or that are"
    yield "# process data."
    yield ""
    yield "[slave]"
    yield f"name = {toml_text('name', _one_line(found.name))}"
    for key in ("vendor", "product", "revision"):
        yield f"{key} = {toml_text(key, getattr(found, key))}"
    yield f"values = {values}  # tables below; without this line, some may be missing"


def _table(
    index: int, subindex: int, name: str, entry: DictionaryEntry, value: SdoValue
) -> Iterator[str]:
    yield "[[startup]]"
    yield f'object = "0x{index:04X}:{subindex:02X}"'
    alias = type_alias(value.data_type)
    if alias and value.data_type not in STRINGS and _is_finite(value):
        physical = physical_text(value)
        yield f'type = "{alias}"'
        number = toml_text("", decode(value.data_type, value.data))
        yield f"value = {number}" + (f"  # {_one_line(physical)}" if physical else "")
    else:
        text = f"  # {_one_line(value_text(value))}" if value.data_type in STRINGS else ""
        yield f'hex = "{value.data.hex(" ")}"{text}'
    yield f"comment = {toml_text('', _names(name, entry))}"


def _is_finite(value: SdoValue) -> bool:
    number = decode(value.data_type, value.data)
    return not isinstance(number, float) or math.isfinite(number)


def _comment(
    index: int, subindex: int, name: str, entry: DictionaryEntry, value: SdoValue
) -> Iterator[str]:
    physical = f" = {physical_text(value)}" if physical_text(value) else ""
    yield (
        f"# 0x{index:04X}:{subindex:02X} {_names(name, entry)} ({access_text(entry.access)}): "
        f"{_one_line(value_text(value))}{physical}"
    )


def _names(name: str, entry: DictionaryEntry) -> str:
    """The names of an object and its entry, for people."""
    return _one_line(", ".join(dict.fromkeys(filter(None, (name, entry.name)))))[:_COMMENT_MOST]


def _one_line(text: str) -> str:
    """A text from a slave, on one line."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)


# --- restore -------------------------------------------------------------------------------------


@dataclass(slots=True)
class _Row:
    """One value of the file, and the result."""

    parameter: StartupConfig  #: The parameter in the file.
    before: bytes | None  #: The value in the slave; None if it cannot be read.
    result: str  #: `differs`, `written`, or why it was not written.

    def to_json(self) -> dict[str, Any]:
        return {
            "object": self.parameter.object,
            "name": self.parameter.comment,
            "file": self.parameter.data.hex(),
            "slave": None if self.before is None else self.before.hex(),
            "result": self.result,
        }

    def cells(self) -> tuple[str, ...]:
        before = "?" if self.before is None else _text(self.parameter, self.before)
        file = _text(self.parameter, self.parameter.data)
        return self.parameter.object, before, file, self.result, self.parameter.comment


_DIFFERS, _WRITTEN = "differs", "written"


def sdo_restore(remote: Remote, options: argparse.Namespace) -> int:
    """Writes the values of a file to a slave, where they differ; returns the exit status."""
    bus = remote.describe()
    found = bus.find_coe(options.slave)
    parameters = _read(options.file, found)
    rows = [row for row in _compared(remote, found, parameters) if row.result]
    wanted = [row for row in rows if row.result == _DIFFERS]
    if wanted and not options.dry_run:
        if not options.json:
            _show(rows)
        count = f"{len(wanted)} value{'s' * (len(wanted) != 1)}"
        confirm(options, f"This writes {count} of {options.file} to {found.label}.")
        _write(remote, found.position, wanted)
    if options.json:
        same = len(parameters) - len(rows)
        found_rows = [row.to_json() for row in rows]
        print_json({"bus": bus.name, "slave": found.position, "same": same, "rows": found_rows})
    elif rows and (options.dry_run or not wanted):
        _show(rows)
    bad = [row for row in rows if row.result not in (_DIFFERS, _WRITTEN)]
    written = sum(row.result == _WRITTEN for row in rows)
    if not options.json:
        _report(found, len(parameters), wanted, written, bad, dry_run=options.dry_run)
    return StateError.exit_code if bad else 0


def _report(
    found: Slave,
    count: int,
    wanted: Sequence[_Row],
    written: int,
    bad: Sequence[_Row],
    *,
    dry_run: bool,
) -> None:
    """Reports the result."""
    if not wanted and not bad:
        print(f"{found.label} has all {count} values of the file already")
    elif dry_run:
        print(f"{len(wanted)} of {count} values would be written to {found.label}")
    else:
        unread = sum(row.before is None for row in bad)
        print(f"{written} of {len(wanted) + unread} values written to {found.label}")
    for row in bad:
        print(f"ecatctl: {row.parameter.object}: {row.result}", file=sys.stderr)


def _read(file: Path, found: Slave) -> list[StartupConfig]:
    """Reads a file, and checks that it is about such a slave.

    Raises:
        ConfigError: The file is malformed.
        UsageError: It is about another device.
    """
    data = read_toml(file).read(_FILE, required=("slave",))
    device = data["slave"]
    here = {"vendor": found.vendor, "product": found.product}
    if any(device[key] != value for key, value in here.items()):
        names = [
            f"vendor 0x{item['vendor']:08X}, product 0x{item['product']:08X}"
            for item in (device, here)
        ]
        raise UsageError(
            f"{file} has the values of another device: {names[0]}, but {found.label} is {names[1]}"
        )
    parameters: list[StartupConfig] = data.get("startup", [])
    wanted = device.get("values", len(parameters))
    if not parameters or len(parameters) != wanted:
        raise UsageError(
            f"{file} has {len(parameters)} of {wanted or 'some'} values: it may be truncated. If "
            "you have removed tables on purpose, remove the line 'values' in [slave], too"
        )
    for item in parameters:
        if item.unit is not None:
            item.table.fail("unit", "works only in the configuration: write the raw value here")
    if (revision := device.get("revision", found.revision)) != found.revision:
        print(
            f"ecatctl: {file} is of revision 0x{revision:08X}, but {found.label} is "
            f"0x{found.revision:08X}: check the differences before you go on",
            file=sys.stderr,
        )
    return parameters


def _compared(remote: Remote, found: Slave, parameters: Sequence[StartupConfig]) -> Iterator[_Row]:
    """Reads the values of the slave. The result of a value that is equal is empty."""
    for item in counted(parameters, "values"):
        try:
            now = remote.sdo_read(found.position, *item.address, complete=item.complete).data
        except SdoAbortError as error:
            yield _Row(item, None, str(error))
            continue
        same = now[: len(item.data)] == item.data
        yield _Row(item, now, "" if same else _DIFFERS)


def _write(remote: Remote, position: int, rows: Sequence[_Row]) -> None:
    """Writes the values in the order of the file, and reads each of them back.

    A slave may refuse a value because of another one that comes later in the file. So refused
    values are tried once more at the end.
    """
    try:
        refused = [row for row in counted(rows, "values") if not _write_one(remote, position, row)]
        for row in refused:
            _write_one(remote, position, row)
    except EcatError as error:
        raise type(error)(f"{error}; {_count(rows)}") from error
    except KeyboardInterrupt:
        print(f"ecatctl: interrupted; {_count(rows)}", file=sys.stderr)
        raise


def _count(rows: Sequence[_Row]) -> str:
    return f"{sum(row.result == _WRITTEN for row in rows)} of {len(rows)} values were written"


def _write_one(remote: Remote, position: int, row: _Row) -> bool:
    """Writes one value and reads it back; returns whether the slave has it now."""
    item = row.parameter
    try:
        remote.sdo_write(position, *item.address, item.data, complete=item.complete)
        after = remote.sdo_read(position, *item.address, complete=item.complete).data
    except SdoAbortError as error:
        row.result = str(error)
        return False
    except EcatError as error:
        raise type(error)(f"{item.object}: {error}") from error
    if after[: len(item.data)] != item.data:
        row.result = f"written, but the slave has {_text(item, after)} now"
        return False
    row.result = _WRITTEN
    return True


def _text(parameter: StartupConfig, data: bytes) -> str:
    if parameter.type is None:
        return data.hex(" ")
    try:
        return str(decode(parse_type(parameter.type), data))
    except UsageError:
        return data.hex(" ")


def _show(rows: Sequence[_Row]) -> None:
    print_table(("OBJECT", "SLAVE HAS", "FILE", "RESULT", "NAME"), (row.cells() for row in rows))

"""Command `startup`: compares start-up parameters with the live slaves, and captures them."""

from __future__ import annotations

import argparse
import sys
import textwrap
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ecatd.base.errors import NoAnswerError, SdoAbortError, StateError, UsageError
from ecatd.base.paths import profile_folders
from ecatd.base.sanitized_output import printable
from ecatd.config import (
    TRANSITIONS,
    TRANSITIONS_DOWN,
    Config,
    SlaveConfig,
    StartupConfig,
    load_config,
)
from ecatd.config.expected_bus import compare
from ecatd.config.meanings import object_meaning
from ecatd.config.profiles import load_profiles
from ecatd.config.resolve import with_can_objects
from ecatd.config.writer import value_text
from ecatd.description.bus import Bus, Slave
from ecatd.description.physical import physical_text
from ecatd.etg.datatypes import STRINGS, bit_length, decode, parse_type, type_alias
from ecatd.etg.dictionary import Access, DictionaryEntry, DictionaryObject
from ecatd.etg.error_codes import WRITE_ONLY
from ecatd.etg.pdo import Entry

from .arguments import connect, slave
from .bus_source import use_bus_of
from .dictionary import objects_of, read_objects
from .esi_devices import device_of
from .output import counted, print_json, print_table, shortened
from .saving import add_out, save

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

COMMANDS = {"daemon": {"startup": "Compare start-up parameters with the slaves, or capture them."}}

_FIRST_OWN = 0x2000
"""Objects below describe the communication (ETG.1000.6); PDOs have keys of their own."""


class _Outcome(StrEnum):
    """What a comparison has shown; only DIFFERENT and UNKNOWN are worth an exit status."""

    SAME = "as configured"
    DIFFERENT = "different"
    UNKNOWN = "not verified"
    SECRET = "cannot be read"
    OPTIONAL = "optional"  # not as configured; a slave may refuse the parameter
    REPLACED = "not what a slave in OP has"


class _Compared(NamedTuple):
    """A parameter, and what its slave has: `outcome` is for decisions, `row` for people."""

    outcome: _Outcome
    row: dict[str, Any]


_ACTIONS = """\
actions:
  verify [SLAVE]             compare the start-up parameters of the configuration with the slaves
  capture SLAVE              write those objects of a slave as [[slave.startup]] tables whose values
                             are not the defaults: those that the slave itself tells, or with --esi
                             those of its ESI file

exit status:
  0 done, no difference   7 verify: a slave has another value of a parameter that is not optional,
  or cannot be asked for it
"""


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments of the command."""
    command.epilog = _ACTIONS
    command.formatter_class = argparse.RawDescriptionHelpFormatter
    command.add_argument("action", choices=_RUN, metavar="ACTION", help="one of the actions below")
    command.add_argument(
        "slave", nargs="?", type=slave, metavar="SLAVE", help="the slave, by position or name"
    )
    command.add_argument(
        "--config",
        metavar="FILE",
        type=Path,
        help="verify: a configuration (default: the one that the daemon uses)",
    )
    command.add_argument(
        "--esi",
        metavar="PATH",
        help="capture: take the defaults from the ESI file of the slave, or a folder of them",
    )
    add_out(command, "capture: write the tables to this file")


def startup(options: argparse.Namespace) -> int:
    """Carries out one action; returns the exit status."""
    if options.action == "capture" and options.slave is None:
        raise UsageError("startup capture needs SLAVE: the position or name of the slave")
    if options.action == "capture" and options.config is not None:
        raise UsageError("--config is only for startup verify")
    if options.action == "verify" and (options.esi is not None or options.out is not None):
        raise UsageError("--esi and -o go with startup capture")
    if options.out is not None and options.out.is_file():
        raise StateError(
            f"{options.out} exists, and would be overwritten: write the tables to a new file, and "
            "copy them from there into your configuration, below the [[slave]] table of this slave"
        )
    if options.config is not None:
        use_bus_of(options, load_config(options.config))
    with connect(options) as remote:
        return _RUN[options.action](remote, options)


# --- verify --------------------------------------------------------------------------------------


_LONGEST_VALUE = 40
"""Characters of a value in the table; `--json` has them all."""
_LONG = 8
"""Bytes from which on a difference is told by its place."""


def _verify(remote: Remote, options: argparse.Namespace) -> int:
    bus = remote.describe()
    used = load_config(options.config) if options.config else remote.configuration()[0]
    places = compare(used, bus.slaves).places
    chosen = None if options.slave is None else bus.find(options.slave)
    found = list(_compared(remote, bus, used.moved(places), chosen))
    rows = [item.row for item in found]
    if options.json:
        print_json({"bus": bus.name, "parameters": rows})
    elif rows:
        print_table(
            ("SLAVE", "OBJECT", "CONFIGURED", "SLAVE HAS", "RESULT"),
            (
                (
                    bus.slaves[row["slave"]].display_name,
                    row["object"],
                    shortened(row["configured"], _LONGEST_VALUE),
                    shortened(row["has"] or "", _LONGEST_VALUE),
                    row["result"],
                )
                for row in rows
            ),
            "",
        )
    elif chosen is not None:
        print(f"the configuration has no start-up parameters for {chosen.label}")
    else:
        print("the configuration has no start-up parameters for this bus")
    unknown = Counter(
        bus.slaves[row["slave"]].label for outcome, row in found if outcome == _Outcome.UNKNOWN
    )
    if chosen is None:
        gone = [item for item in used.slave if item.startup and item.position not in places]
        for item in gone:
            name = item.name or f"slave {item.position}"
            unknown[f"{name}, which is not on the bus"] += len(item.startup)
    if unknown:
        listed = "; ".join(f"{count} of {label}" for label, count in unknown.items())
        print(f"ecatctl: parameters that could not be verified: {listed}", file=sys.stderr)
    differs = any(item.outcome == _Outcome.DIFFERENT for item in found)
    return StateError.exit_code if differs or unknown else 0


def _compared(remote: Remote, bus: Bus, here: Config, chosen: Slave | None) -> Iterator[_Compared]:
    meanings = _Meanings(here)
    for settings in here.slave:
        if chosen is not None and chosen.position != settings.position:
            continue
        if settings.position >= len(bus.slaves):
            continue
        settings = with_can_objects(here, settings, bus.slaves[settings.position])
        in_op = _in_force(settings)
        for parameter in settings.startup:
            row: dict[str, Any] = {"slave": settings.position, "object": parameter.object}
            known = meanings.of(bus.slaves[settings.position], parameter.entry)
            try:
                raw = parameter.raw(known)
            except UsageError as error:
                configured = f"{parameter.value} {parameter.unit}"
                result = f"{_Outcome.UNKNOWN}: {error}"
                row |= {"configured": configured, "has": None, "result": result}
                yield _Compared(_Outcome.UNKNOWN, row)
                continue
            row["configured"] = _shown(raw, known, raw.data)
            outcome, row["has"], why = _value_of(remote, settings.position, raw, known)
            result = f"{outcome}: {why}" if why else str(outcome)
            if in_op.get(parameter.address) is not parameter and row["has"] is not None:
                outcome = _Outcome.REPLACED
                result = f"of {parameter.transition}: {outcome}"
            elif parameter.optional and outcome != _Outcome.SAME:
                outcome, result = _Outcome.OPTIONAL, f"{_Outcome.OPTIONAL}: {result}"
            yield _Compared(outcome, row | {"result": result})


def _in_force(settings: SlaveConfig) -> dict[tuple[int, int], StartupConfig]:
    """The parameters whose values a slave in OP has, by object: of each the one written last."""
    way_up = [name for name in TRANSITIONS if name not in TRANSITIONS_DOWN]
    return {item.address: item for name in way_up for item in settings.parameters(name)}


class _Meanings:
    """What objects of slaves mean: as the daemon says, or the profiles of this computer.

    Args:
        used: The configuration, with the positions of the bus.
    """

    def __init__(self, used: Config) -> None:
        self._rules = used.signal
        here = [folder for folder in used.profiles if Path(folder).is_dir()]
        self._profiles = load_profiles(replace(used, profiles=here), profile_folders())

    def of(self, slave: Slave, entry: Entry) -> Entry:
        """An object with its meaning."""
        for outputs in (True, False):
            for _, mapped, _ in slave.entries(outputs=outputs):
                same = (mapped.index, mapped.subindex) == (entry.index, entry.subindex)
                if same and mapped.is_physical:
                    return replace(mapped, data_type=entry.data_type, bit_length=entry.bit_length)
        return object_meaning(slave, entry, self._profiles, self._rules)


def _value_of(
    remote: Remote, position: int, parameter: StartupConfig, known: Entry
) -> tuple[_Outcome, str | None, str]:
    """The outcome of the comparison, what the slave has, and why it cannot be read."""
    index, subindex = parameter.address
    try:
        data = remote.sdo_read(position, index, subindex, complete=parameter.complete).data
    except (SdoAbortError, NoAnswerError, StateError) as error:
        secret = isinstance(error, SdoAbortError) and error.code == WRITE_ONLY
        return _Outcome.SECRET if secret else _Outcome.UNKNOWN, None, str(error)
    has, wanted = _shown(parameter, known, data), parameter.data
    if data[: len(wanted)] == wanted:
        return _Outcome.SAME, has, ""
    pairs = enumerate(zip(data, wanted, strict=False))
    at = next((n for n, (one, other) in pairs if one != other), len(data))
    # The table does not show all of a long value.
    return _Outcome.DIFFERENT, has, f"first in byte {at}" if len(wanted) > _LONG else ""


def _shown(parameter: StartupConfig, known: Entry, data: bytes) -> str:
    kind = None if parameter.type is None else parse_type(parameter.type)
    bits = bit_length(kind) if kind is not None else 0
    if kind is None or (bits and (bits + 7) // 8 != len(data)):
        return data.hex(" ")
    physical = physical_text(known, data)
    text = str(decode(kind, data))
    return f"{text} ({physical})" if physical else text


# --- capture -------------------------------------------------------------------------------------


def _capture(remote: Remote, options: argparse.Namespace) -> int:
    bus = remote.describe()
    if options.esi is None:
        found = bus.find_coe(options.slave)
        objects, whose = read_objects(remote, found, None), "that it tells itself"
    else:
        found = bus.find(options.slave)
        device = device_of(found, options.esi)
        objects, whose = objects_of(device), f"in {Path(device.path).name}"
    used = remote.configuration()[0]
    meanings = _Meanings(used.moved(compare(used, bus.slaves).places))
    writable = list(_settings(found, objects))
    settings = [item for item in writable if item.entry.access & Access.READ]
    write_only = [item.address for item in writable if item not in settings]
    unknown = [item.address for item in settings if item.entry.default is None]
    if settings and len(unknown) == len(settings) and options.esi is None:
        raise StateError(
            f"{found.label} tells no default of any object, so there is nothing to compare its "
            "values with: take the defaults from its ESI file with --esi"
        )
    rows = list(_changed(remote, found, settings, meanings))
    if options.json:
        document = {"parameters": rows, "without_default": unknown, "write_only": write_only}
        print_json({"bus": bus.name, "slave": found.position, **document})
        return 0
    lines = [f"# {found.label}: objects that differ from the defaults {whose}"]
    if unknown:
        text = "without a default, so not compared: " + ", ".join(unknown)
        lines += textwrap.wrap(text, initial_indent="# ", subsequent_indent="# ", width=100)
    if write_only:
        one = len(write_only) == 1
        what = "1 object is" if one else f"{len(write_only)} objects are"
        lines += [f"# {what} write only, so not compared: --json names {'it' if one else 'them'}"]
    for row in rows:
        name = f"  # {printable(str(row['name']))}; default {printable(str(row['default']))}"
        physical = f"  # {printable(str(row['physical']))}" if row["physical"] else ""
        lines += ["", "[[slave.startup]]", f'object = "{row["object"]}"{name}']
        if row["type"]:
            lines += [
                f'type = "{row["type"]}"',
                f"value = {value_text('', row['value'])}{physical}",
            ]
        else:
            lines += [f'hex = "{row["value"]}"']
    if options.out is None:
        sys.stdout.write("\n".join(lines) + "\n")
        return 0
    save(options.out, "\n".join(lines) + "\n")
    count = len(rows)
    print(
        f"{options.out}: {count} parameter{'s' * (count != 1)}; copy them into the configuration, "
        f"below the [[slave]] table of {found.label}"
    )
    return 0


@dataclass(frozen=True, slots=True)
class _Setting:
    """An object that can be a start-up parameter."""

    index: int
    subindex: int
    entry: DictionaryEntry

    @property
    def address(self) -> str:
        return f"0x{self.index:04X}:{self.subindex:02X}"


def _settings(found: Slave, objects: Sequence[DictionaryObject]) -> Iterator[_Setting]:
    """The objects that can be written, and are no process data."""
    mapped = {
        (entry.index, entry.subindex)
        for outputs in (True, False)
        for _, entry, _ in found.entries(outputs=outputs)
    }
    for item in objects:
        for subindex, entry in item.entries.items():
            if (
                item.index >= _FIRST_OWN
                and entry.access & Access.WRITE_PREOP
                and (item.index, subindex) not in mapped
            ):
                yield _Setting(item.index, subindex, entry)


def _changed(
    remote: Remote, found: Slave, settings: Sequence[_Setting], meanings: _Meanings
) -> Iterator[dict[str, Any]]:
    """Reads those with a default; yields those that differ from it."""
    for item in counted([item for item in settings if item.entry.default is not None], "objects"):
        try:
            data = remote.sdo_read(found.position, item.index, item.subindex).data
        except SdoAbortError:
            continue  # what describes it knows more than this slave has
        default, kind = item.entry.default or b"", item.entry.data_type
        fill = b"\0" if kind in STRINGS else b""  # of a text that is shorter than its longest
        if data != default and not (fill and data.rstrip(fill) == default.rstrip(fill)):
            known = meanings.of(found, Entry(item.index, item.subindex, "", kind, bit_length(kind)))
            yield {**_row(item, data, default), "physical": physical_text(known, data)}


def _row(item: _Setting, data: bytes, default: bytes) -> dict[str, Any]:
    kind, bits = item.entry.data_type, bit_length(item.entry.data_type)
    fits = bits and len(data) == len(default) == (bits + 7) // 8
    alias = type_alias(kind) if fits and kind not in STRINGS else None
    return {
        "object": item.address,
        "name": item.entry.name,
        "type": alias,
        "value": decode(kind, data) if alias else data.hex(" "),
        "default": decode(kind, default) if alias else default.hex(" "),
    }


_RUN = {"verify": _verify, "capture": _capture}

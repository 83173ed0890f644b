"""Command `config`: writes, checks, compares and shows the configuration of a bus."""

from __future__ import annotations

import argparse
import shutil
import sys
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

from ecatd.base.bus_name import check_bus_name
from ecatd.base.errors import StateError, UsageError
from ecatd.base.version import VERSION
from ecatd.config import Config, load_config
from ecatd.config.differences import Difference, Moved, differences
from ecatd.config.expected_bus import compare
from ecatd.config.origins import COMMAND_LINE, DEFAULT, flatten
from ecatd.config.writer import number_of, value_text, write_config
from ecatd.description.bus import Bus, Slave
from ecatd.operations.bus import ReadStates

from .arguments import connect
from .bus_source import add_options, check_options, get_bus, use_bus_of
from .bus_warnings import warn, warn_outdated
from .config_check import check, described
from .named_objects import refresh_modules
from .output import print_json, print_table, shortened
from .saving import add_out, save

COMMANDS = {"daemon": {"config": "Write, check, compare or show the configuration."}}

_DIFFERENT = 1
_TABLE_WIDTH = 100
_TOLD = 4  # slaves in one message

_ACTIONS = """\
actions:
  init            write a commented configuration that expects the slaves that are on the bus now
  from-eni FILE   write a configuration from an ENI file of TwinCAT, EC-Engineer or others; this
                  needs no daemon
  check FILE      compare the slaves that FILE expects with those on the bus, and list everything
                  for which a start would refuse FILE
  diff FILE       compare FILE with the configuration that the daemon uses
  show            print every key that the daemon uses, and where its value comes from

exit status:
  0 done, or no difference   1 diff: there are differences   7 check: there are differences
  2 check: something in the file does not fit the bus
"""


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments of the command."""
    command.epilog = _ACTIONS
    command.formatter_class = argparse.RawDescriptionHelpFormatter
    command.add_argument("action", choices=_RUN, metavar="ACTION", help="one of the actions below")
    command.add_argument(
        "file", nargs="?", type=Path, metavar="FILE", help="a configuration; from-eni: an ENI file"
    )
    add_out(command, "init, from-eni: write the configuration to this file")
    command.add_argument(
        "--force",
        action="store_true",
        help="init, from-eni: overwrite the file, and keep the old one as FILE.bak",
    )
    command.add_argument(
        "--esi",
        metavar="PATH",
        help="an ESI file or a folder of them; init: take over what it says about the slaves; "
        "check: also compare pdos with it",
    )
    add_options(command)


def config(options: argparse.Namespace) -> int:
    """Carries out one action; returns the exit status."""
    needs_file = options.action in ("check", "diff", "from-eni")
    if needs_file and options.file is None:
        what = "the ENI file" if options.action == "from-eni" else "the configuration to compare"
        raise UsageError(f"config {options.action} needs a FILE: {what}")
    if options.file is not None and not needs_file:
        what = "; write it with -o FILE" if options.action == "init" else ""
        raise UsageError(f"config {options.action} takes no FILE{what}")
    writes = options.action in ("init", "from-eni")
    if not writes and (options.out is not None or options.force):
        raise UsageError("-o and --force are only for config init and config from-eni")
    if options.action == "from-eni" and (
        options.sources or options.devices or options.config or options.connect
    ):
        raise UsageError("config from-eni reads only FILE: leave other sources out")
    if options.esi is not None and options.action not in ("init", "check"):
        raise UsageError("--esi is only for config init and config check")
    if options.action in ("diff", "show") and (
        options.sources or options.devices or options.config
    ):
        raise UsageError(
            f"config {options.action} asks the daemon: leave --from, --devices and --config out"
        )
    return _RUN[options.action](options)


def _remote(options: argparse.Namespace) -> tuple[Bus, Config, dict[str, str]]:
    """The bus of a daemon, its configuration, and where that comes from."""
    with connect(options) as remote:
        return remote.describe(), *remote.configuration()


# --- init ----------------------------------------------------------------------------------------


def _init(options: argparse.Namespace) -> int:
    if options.sources:
        bus, more = get_bus(options)
        known = load_config(options.config) if options.config else Config(bus=bus.name)
        known.cycle_time_us = bus.cycle_time_us
    else:
        check_options(options)
        with connect(options) as remote:
            bus, (known, _), rows = (
                remote.describe(),
                remote.configuration(),
                remote.request(ReadStates())["slaves"],
            )
            refresh_modules(remote, bus, rows)
        more = {"outdated": warn_outdated(bus, rows)}
    known = known.moved(compare(known, bus.slaves).places)
    notes = None
    if options.esi is not None:
        from ecatd.vendor.esi import Findings
        from ecatd.vendor.esi.configure import add_esi

        findings = Findings(strict=options.strict)
        devices = described(bus, options.esi, findings)
        warn(findings.texts)
        notes = add_esi(known, bus, devices)
        more |= {"described": sorted(devices), "warnings": findings.texts}
    text = write_config(known, bus, VERSION, notes)
    _write(options, bus, known, text, "give them names, then", more)
    return 0


def _write(
    options: argparse.Namespace,
    bus: Bus,
    written: Config,
    text: str,
    then: str,
    more: dict[str, Any],
) -> None:
    """Writes a configuration to its file, and says so; without a file, to the standard output.

    Args:
        options: Those of the command.
        bus: The bus.
        written: The configuration.
        text: The same as the text of a file.
        then: What the user should do before ecatd uses it.
        more: Further keys for `--json`.
    """
    if options.out is None:
        if options.json:
            print_json({"bus": bus.name, "slaves": len(bus.slaves), "text": text, **more})
        else:
            sys.stdout.write(text)
        return
    if options.out.is_dir():
        raise UsageError(f"{options.out} is a folder: name the file, too, as in -o ecat0.toml")
    if options.out.exists() and not options.force:
        raise StateError(
            f"{options.out} exists: --force overwrites it, and keeps the old file as "
            f"{options.out.name}.bak; `ecatctl config diff {options.out}` compares it with what "
            "the daemon uses"
        )
    kept = _keep(options.out, text)
    save(options.out, text)
    slaves = len(bus.slaves)
    if options.json:
        print_json(
            {"bus": bus.name, "file": str(options.out), "slaves": slaves, "kept": kept, **more}
        )
        return
    if kept:
        print(f"{kept}: the file that was there, with its comments", file=sys.stderr)
    which = "" if written.interface else " --interface IF"
    print(
        f"{options.out}: bus {bus.name}, {slaves} slave{'s' * (slaves != 1)}; {then} "
        f"`ecatd --config {options.out}{which}`"
    )


def _keep(file: Path, text: str) -> str:
    """Keeps a file that is about to be replaced, with its comments; returns its new name.

    Raises:
        StateError: It cannot be kept.
    """
    if not file.is_file():
        return ""
    names = (f"{file}.bak{'' if number == 1 else number}" for number in count(1))
    free = next(name for name in names if not Path(name).exists())
    try:
        if file.read_bytes() == text.encode():
            return ""
        shutil.copy2(file, free)
    except OSError as error:
        raise StateError(f"{file} cannot be kept as {free}: {error.strerror}") from error
    return free


# --- from-eni ------------------------------------------------------------------------------------


def _from_eni(options: argparse.Namespace) -> int:
    from ecatd.vendor.eni import convert, read_network
    from ecatd.vendor.esi import Findings

    network = read_network(options.file, Findings(strict=options.strict))
    found = convert(network, check_bus_name(options.bus))
    text = write_config(found.config, found.bus, VERSION, found.notes)
    if not options.json:
        labels = {slave.position: slave.label for slave in found.bus.slaves}
        print("\n".join(found.report.lines(str(options.file), labels)), file=sys.stderr)
    more = found.report.to_dict()
    _write(options, found.bus, found.config, text, "check it, then", more)
    return 0


# --- diff and show -------------------------------------------------------------------------------


def _diff(options: argparse.Namespace) -> int:
    wanted = load_config(options.file)
    use_bus_of(options, wanted)
    bus, used, origins = _remote(options)
    given = [
        key for key in ("bus", "interface", "cycle_time_us") if origins.get(key) == COMMAND_LINE
    ]
    log = [key for key in flatten({"log": used.log}) if origins.get(key) == COMMAND_LINE]
    fixed = [*given, "log"] if log else given
    wanted = replace(wanted, **{key: getattr(used, key) for key in fixed})
    result = differences(used, wanted)
    if options.json:
        rows = [{"key": item.key, "used": item.before, "file": item.after} for item in result.found]
        moved = [
            {"slave": item.slave, "used": item.before, "file": item.after} for item in result.moved
        ]
        document = {"bus": bus.name, "file": str(options.file), "differences": rows}
        document["command_line"] = given + log
        print_json({**document, "moved": moved})
    elif result.found:
        print_table(
            ("KEY", "IN USE", "FILE"),
            ((item.key, *_sides(item)) for item in result.found),
            "",
        )
        if result.moved:
            print(_moved(result.moved))
        print(f"restart ecatd with {options.file} to use it")
    else:
        print(f"bus {bus.name} uses what is in {options.file}")
    if (given or log) and not options.json:
        keys = ", ".join(given + log)
        print(f"given on the command line of ecatd, so not compared: {keys}", file=sys.stderr)
    return _DIFFERENT if result.found else 0


def _sides(item: Difference) -> tuple[str, str]:
    """A difference in two cells: what is in use, and what is in the file."""
    if not item.table:
        before, after = (_shown(item.key, value) for value in (item.before, item.after))
        return before, after
    before, after = (
        "(no table)" if row is None else shortened(_table(row), _TABLE_WIDTH)
        for row in (item.before, item.after)
    )
    return before, after


def _table(row: dict[str, Any]) -> str:
    """A table on one line."""
    parts = []
    for key, value in row.items():
        rows = isinstance(value, list) and isinstance(value[0], dict)
        parts.append(f"{len(value)} [[{key}]]" if rows else f"{key} = {_value_text(key, value)}")
    return ", ".join(parts)


def _moved(moved: list[Moved]) -> str:
    shown = ", ".join(f"{item.slave}: {item.before} to {item.after}" for item in moved[:_TOLD])
    more = f" and {len(moved) - _TOLD} more" if len(moved) > _TOLD else ""
    return f"so later slaves have other positions ({shown}{more})"


def _show(options: argparse.Namespace) -> int:
    bus, used, origins = _remote(options)
    values = flatten(used.to_dict())
    signals = list(_signals(bus, used))
    if options.json:
        keys = [
            {"key": key, "value": value, "origin": origins.get(key, DEFAULT)}
            for key, value in values.items()
        ]
        print_json({"bus": bus.name, "keys": keys, "signals": signals})
        return 0
    print_table(
        ("KEY", "VALUE", "ORIGIN"),
        ((key, _shown(key, value), origins.get(key, DEFAULT)) for key, value in values.items()),
        "",
    )
    if signals:
        print()
        print_table(
            ("SIGNAL", "NAME", "UNIT", "SCALE", "OFFSET", "ORIGIN"),
            (
                (
                    f"{row['slave']}/{row['entry']}",
                    row["name"],
                    row["unit"],
                    f"{row['scale']:g}",
                    f"{row['offset']:g}",
                    row["origin"],
                )
                for row in signals
            ),
            "   >>",
        )
    return 0


def _signals(bus: Bus, used: Config) -> list[dict[str, Any]]:
    """Entries that have a meaning, and where it comes from."""
    places = compare(used, bus.slaves).places
    named = {(places.get(rule.slave), rule.address) for rule in used.signal}
    rows = []
    for slave in bus.slaves:
        for outputs in (True, False):
            for _, entry, _ in slave.entries(outputs=outputs):
                configured = (slave.position, (entry.index, entry.subindex)) in named
                if not (entry.is_physical or configured):
                    continue
                rows.append(
                    {
                        "slave": slave.position,
                        "entry": entry.address,
                        "name": entry.name,
                        "unit": entry.unit,
                        "scale": entry.scale,
                        "offset": entry.offset,
                        "origin": "[[signal]]" if configured else _profiles(slave),
                    }
                )
    return rows


def _profiles(slave: Slave) -> str:
    """The profiles that give the entries of a slave their meanings."""
    return ", ".join(f"profile '{profile.description}'" for profile in slave.profiles)


def _shown(key: str, value: Any) -> str:
    return "(not set)" if value is None else _value_text(key.rpartition(".")[2], value)


def _value_text(key: str, value: Any) -> str:
    """As `value_text`, but without quotes for numbers that the configuration has as texts."""
    return value_text(key, number_of(value) if key == "value" and type(value) is str else value)


_RUN = {"init": _init, "from-eni": _from_eni, "check": check, "diff": _diff, "show": _show}

"""`ecatctl config check`: does a configuration fit a bus?"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ecatd.model.applied import alike_slaves, load_description, misfits, missing_folder
from ecatd.model.applied.objects import Objects, object_indices, object_problems
from ecatd.model.bus import Bus, Slave
from ecatd.model.config import Config, SlaveConfig, load_config
from ecatd.model.config.pdos import INPUT_PDOS
from ecatd.model.doubts import REMEDIES, SILENT
from ecatd.model.errors import ConfigError, StateError
from ecatd.model.expected_bus import Difference, compare
from ecatd.model.health import silent_slaves
from ecatd.model.problems import Collected
from ecatd.model.profiles import load_profiles
from ecatd.model.wire import found_slaves
from ecatd.paths import profile_folders

from .bus_source import check_options, get_bus, warn_of_silent
from .named_objects import esi_objects, live_objects
from .output import print_json

if TYPE_CHECKING:
    from ecatd.esi import EsiDevice


def check(options: argparse.Namespace) -> int:
    """Lists the differences between slaves, and what of the file does not fit the bus."""
    wanted = load_config(options.file)
    bus, wire, idle, states, objects = _bus(options, wanted)
    # The slaves of the bus have process data with which tables are compared. What is about slaves
    # that are others, or will have other PDOs, is not known.
    gone = {row["position"] for row in states if not row["al_state"]}
    found = compare(wanted, bus.slaves, gone)
    missing = [found.places.get(n) for item in found.differences for n in item.expected]
    silent = silent_slaves(states)
    warn_of_silent(bus, [n for n in silent if n not in missing])
    moved = wanted.moved(found.places)
    doubtful = {
        row["position"]: row
        for row in states
        if row["recovery"] in REMEDIES and row["position"] not in gone
    }
    pdos = _other_pdos(moved, bus, gone | doubtful.keys())
    others = {position for item in found.differences + pdos for position in item.found}
    others |= doubtful.keys() | idle | {n for n in gone if not _exchanges(bus.slaves[n])}
    differences = compare(wanted, wire).differences + pdos
    unexpected = found.unexpected
    places = {n: at for n, at in found.places.items() if at not in unexpected}
    wrong = _wrong(wanted, places, bus, others)
    warnings = alike_slaves(wanted) + missing_folder(wanted)
    warnings += [
        f"{bus.slaves[n].label} takes no part now, so the file is not checked against its process "
        "data: the next start does that"
        for n in sorted(idle & {*places.values()})
    ]
    warnings += [
        f"{bus.slaves[n].label}: {_doubt(row, moved.settings_of(n), bus.slaves[n])}"
        for n, row in doubtful.items()
        if n not in unexpected
    ]
    if options.esi is not None:
        devices = described(bus, options.esi)
        differences += _forbidden(moved, bus, devices)
        objects |= esi_objects(moved, devices)
    differences += [
        Difference("other objects", (n,), (n,), f"{where}: {bus.slaves[n].label} {text}", False)
        for n, known in objects.items()
        if n in places.values()
        for where, text in (
            (item.table.where(), text)
            for item, text in object_problems(moved.settings_of(n), known)
        )
    ]
    warnings += [
        f"{bus.slaves[n].label} does not tell which objects it has, so its start-up parameters and "
        "[[slave.pdo]] are not checked; --esi takes its objects from an ESI file"
        for n, known in objects.items()
        if not {*object_indices(moved.settings_of(n))} <= known.keys()
    ]
    if options.json:
        rows = [
            {
                "kind": item.kind,
                "expected": list(item.expected),
                "found": list(item.found),
                "text": item.text,
                "strict": item.strict,
            }
            for item in differences
        ]
        document = {"bus": bus.name, "file": str(options.file), "differences": rows}
        print_json({**document, "wrong": wrong, "warnings": warnings, "silent": silent})
    elif differences or wrong or warnings:
        for item in differences:
            print(f"{item.kind}: {item.text}")
        for text in (*wrong, *(f"warning: {text}" for text in warnings)):
            print(text)
    else:
        count = len(wire)
        with_identity = sum(slave.product is not None for slave in moved.slave)
        print(
            f"bus {bus.name} with {count} slave{'s' * (count != 1)} is as {options.file} expects; "
            f"it expects {with_identity or 'none'} by identity"
        )
    if wrong:
        return ConfigError.exit_code
    return StateError.exit_code if differences else 0


def _bus(
    options: argparse.Namespace, wanted: Config
) -> tuple[Bus, list[Slave], set[int], list[dict[str, Any]], dict[int, Objects]]:
    """The bus, and what a start would find on its wire.

    Also slaves of which the daemon does not know the process data, how slaves are, and the objects
    that the configuration names, by position; all of these are empty for a bus that does not run.
    """
    if options.sources:
        bus = get_bus(options)
        return bus, bus.slaves, set(), [], {}
    check_options(options)
    from ecatd.client.remote import Remote  # loading Zenoh is slow

    with Remote(options.bus, options.connect, options.timeout) as remote:
        bus, rows = remote.describe(), remote.states()
        wire = found_slaves(bus, remote.rescan()["devices"])
        unexpected = compare(remote.configuration()[0], bus.slaves).unexpected
        objects = live_objects(remote, wanted, bus, rows)
    return bus, wire, {n for n in unexpected if not _exchanges(bus.slaves[n])}, rows, objects


def _exchanges(slave: Slave) -> bool:
    return bool(slave.outputs or slave.inputs)


def _doubt(row: dict[str, Any], settings: SlaveConfig, slave: Slave) -> str:
    """Why the process data of a slave are in doubt, what the next start does, and what to do."""
    text = row["recovery_text"]
    if row["recovery"] == SILENT and settings.is_told and _exchanges(slave):
        text += (
            "; a start with this file tells it its configuration, so it takes no part if it does "
            "not answer then either"
        )
    return f"{text}; {REMEDIES[row['recovery']]}"


def _wrong(wanted: Config, places: dict[int, int], bus: Bus, others: set[int]) -> list[str]:
    """All for which a start would refuse the configuration."""
    problems = Collected()
    with problems:
        load_description(wanted)
    with problems:  # without its profiles, nobody knows what the values of the file mean
        profiles = load_profiles(wanted, profile_folders())
        problems.texts += misfits(wanted.moved(places), bus, profiles, others)
    return problems.texts


def described(bus: Bus, source: str) -> dict[int, EsiDevice]:
    """The ESI descriptions of the slaves; warns about those without one."""
    from .esi_devices import describe

    devices = describe(bus.slaves, source)
    missing = [slave.label for slave in bus.slaves if slave.position not in devices]
    if missing:
        print(f"ecatctl: {source} does not describe {', '.join(missing)}", file=sys.stderr)
    return devices


def _other_pdos(wanted: Config, bus: Bus, unknown: Collection[int]) -> list[Difference]:
    """Slaves that exchange other PDOs, or other entries, than the configuration says."""
    differences = []
    for settings in wanted.slave:
        if settings.position >= len(bus.slaves) or settings.position in unknown:
            continue
        slave = bus.slaves[settings.position]
        text = _pdo_difference(settings, slave)
        if text:
            text = f"{slave.label} exchanges {text}: {_advice(settings, slave)}"
            place = (settings.position,)
            differences.append(Difference("other PDOs", place, place, text, strict=False))
    return differences


def _advice(settings: SlaveConfig, slave: Slave) -> str:
    """What to do about other PDOs, with what a start with them would come to."""
    now = {pdo.index for pdo in (*slave.outputs, *slave.inputs)}
    new = [index for index in settings.pdos or () if index not in now]
    if not new:
        return "restart ecatd with this file, or correct it"
    which = f"PDO{'s' * (len(new) > 1)} {_indices(new)}"
    if not slave.coe:
        return (
            f"it has no CoE, so it has only the PDOs of its EEPROM, and ecatd does not start with "
            f"others: correct the file, or restart ecatd with it if its manual has {which}"
        )
    return (
        f"correct the file, or restart ecatd with it; that start fails if the slave does not have "
        f"{which}, which --esi with its ESI file finds out"
    )


def _pdo_difference(settings: SlaveConfig, slave: Slave) -> str:
    now = {pdo.index: pdo for pdo in (*slave.outputs, *slave.inputs)}
    if settings.pdos is not None and _in_order(list(now)) != _in_order(settings.pdos):
        return f"the PDOs {_indices(list(now))}, not {_indices(settings.pdos)}"
    for pdo in settings.pdo:
        if pdo.index not in now:
            continue
        there = [((e.index, e.subindex), e.bit_length) for e in now[pdo.index].entries]
        if there != [(entry.address, entry.bits) for entry in pdo.entries]:
            return f"PDO 0x{pdo.index:04X} with other entries than its [[slave.pdo]] has"
    return ""


def _forbidden(wanted: Config, bus: Bus, devices: dict[int, EsiDevice]) -> list[Difference]:
    """PDOs and modules of the configuration that the ESI files do not allow."""
    from ecatd.esi.check import pdo_problems
    from ecatd.esi.modules import module_problems

    found = []
    for settings in wanted.slave:
        device = devices.get(settings.position)
        if device is None:
            continue
        problems = [("forbidden PDOs", text) for text in pdo_problems(settings, device)]
        idents = [module.ident for module in settings.modules]
        problems += [("forbidden modules", text) for text in module_problems(device, idents)]
        place = (settings.position,)
        label, file = bus.slaves[settings.position].label, Path(device.path).name
        found += [
            Difference(kind, place, place, f"{label} {text} ({file})", strict=False)
            for kind, text in problems
        ]
    return found


def _in_order(indices: list[int]) -> list[int]:
    """Those of outputs before those of inputs; within these the order counts."""
    return sorted(indices, key=lambda index: index in INPUT_PDOS)


def _indices(indices: list[int]) -> str:
    return ", ".join(f"0x{index:04X}" for index in indices) or "none"

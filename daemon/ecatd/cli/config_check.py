"""`ecatctl config check`: does a configuration fit a bus?"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ecatd.base.errors import ConfigError, StateError
from ecatd.base.paths import profile_folders
from ecatd.config import Config, SlaveConfig, StartupConfig, load_config
from ecatd.config.expected_bus import Difference, compare
from ecatd.config.expected_slave import DifferenceKind
from ecatd.config.placed import Placed
from ecatd.config.problems import Collected
from ecatd.config.profiles import load_profiles
from ecatd.config.resolve import (
    alike_slaves,
    can_change,
    can_channel,
    load_description,
    misfits,
    missing_folders,
    unused_conditions,
)
from ecatd.config.resolve.objects import object_indices, object_problems
from ecatd.config.resolve.pdos import (
    chosen_from_eeprom,
    indices_text,
    new_pdos,
    pdo_change,
    pdo_obstacles,
)
from ecatd.description.bus import Bus, Slave
from ecatd.description.conditions import REMEDIES, Condition
from ecatd.etg.sii import Sii
from ecatd.operations.bus import Device, ReadStates, Rescan, SlaveAlState
from ecatd.operations.wire import found_slaves, known_slaves

from .arguments import connect
from .bus_source import check_options, get_bus, use_bus_of
from .bus_warnings import warn_outdated
from .named_objects import Answers, ask_slaves, esi_objects, refresh_modules
from .output import print_json
from .witness_check import contradictions

if TYPE_CHECKING:
    from ecatd.vendor.esi import EsiDevice, Findings


def check(options: argparse.Namespace) -> int:
    """Lists the differences between slaves, and what of the file does not fit the bus."""
    wanted = load_config(options.file)
    use_bus_of(options, wanted)
    bus, devices, idle, states, answers = _bus(options, wanted)
    wire = bus.slaves if devices is None else found_slaves(bus, devices)
    # The slaves of the bus have process data with which tables are compared. What is about slaves
    # that are others, or will have other PDOs, is not known.
    gone = {row["position"] for row in states if not row["al_state"]}
    found = compare(wanted, bus.slaves, gone)
    missing = [found.places.get(n) for item in found.differences for n in item.expected]
    old = warn_outdated(bus, states, [n for n in missing if n is not None])
    moved = wanted.moved(found.places)
    uncertain = {
        row["position"]: row
        for row in states
        if row["recovery"] in REMEDIES and row["position"] not in gone
    }
    unexpected = found.unexpected
    changed = _changed_pdos(moved, bus, gone | uncertain.keys() | unexpected.keys())
    others = {position for item in found.differences for position in item.found} | changed.keys()
    others |= uncertain.keys() | idle | {n for n in gone if not _exchanges(bus.slaves[n])}
    known = known_slaves(found.places, devices or [])
    differences = compare(wanted, wire, known=known).differences
    differences += _refused_pdos(moved, bus, changed, answers)
    notes = [
        f"a restart with this file would change the PDOs of {bus.slaves[n].label}: it exchanges "
        f"{text}"
        for n, text in changed.items()
    ]
    places = {n: at for n, at in found.places.items() if at not in unexpected}
    wrong = _wrong(wanted, places, bus, others, answers.eeproms)
    warnings = alike_slaves(wanted) + missing_folders(wanted)
    warnings += [
        f"{bus.slaves[n].label} takes no part now, so the file is not checked against its process "
        "data: the next start does that"
        for n in sorted(idle & {*places.values()})
    ]
    warnings += [
        f"{bus.slaves[n].label}: {_uncertain(row, moved.settings_of(n), bus.slaves[n])}"
        for n, row in uncertain.items()
        if n not in unexpected and row["recovery"] != Condition.CONTRADICTED
    ]
    from ecatd.vendor.esi import Findings

    findings = Findings(strict=options.strict)
    in_esi = {} if options.esi is None else described(bus, options.esi, findings)
    warnings += findings.texts
    differences += _forbidden(moved, bus, in_esi)
    warnings += _can_remarks(moved, bus)
    contradicting, decided = contradictions(moved, bus, in_esi, gone | unexpected.keys())
    differences += contradicting
    notes += decided
    warnings += _unknown_pdos(moved, bus, changed.keys() - in_esi.keys(), answers)
    objects = dict(answers.objects)
    for n, named in esi_objects(moved, in_esi).items():
        objects[n] = {**objects.get(n, {}), **named}
    refused = [
        (n, item, f"{item.table.where()}: {bus.slaves[n].label} {text}")
        for n, known in objects.items()
        if n in places.values()
        for item, text in object_problems(moved.settings_of(n), known, answers.eeproms.get(n))
    ]
    differences += [
        Difference(DifferenceKind.OTHER_OBJECTS, (n,), (n,), text, strict=False)
        for n, item, text in refused
        if not _is_optional(item)
    ]
    notes += [
        f"{text}. The parameter is optional, so a start goes on without it"
        for _, item, text in refused
        if _is_optional(item)
    ]
    warnings += [
        f"{bus.slaves[n].label} does not tell which objects it has, so its start-up parameters and "
        "[[slave.pdo]] are not checked; --esi takes its objects from an ESI file"
        for n, known in objects.items()
        if not {*object_indices(moved.settings_of(n), optional=False)} <= known.keys()
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
        more = {"wrong": wrong, "warnings": warnings, "notes": notes, "outdated": old}
        print_json({**document, **more})
    elif differences or wrong or warnings or notes:
        for item in differences:
            print(f"{item.kind}: {item.text}")
        warned = [f"warning: {text}" for text in warnings]
        for text in (*wrong, *warned, *(f"note: {text}" for text in notes)):
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


def _is_optional(item: Placed) -> bool:
    return isinstance(item, StartupConfig) and item.optional


def _bus(
    options: argparse.Namespace, wanted: Config
) -> tuple[Bus, list[Device] | None, set[int], list[SlaveAlState], Answers]:
    """The bus, and the devices that a start would find on its wire; None: the slaves of the bus.

    Also slaves of which the daemon does not know the process data, how slaves are, and what they
    have answered; all of these are empty for a bus that does not run.
    """
    if options.sources:
        bus, _ = get_bus(options)
        return bus, None, set(), [], Answers()
    check_options(options)
    with connect(options) as remote:
        bus, rows = remote.describe(), remote.request(ReadStates())["slaves"]
        devices = remote.request(Rescan())["devices"]
        refresh_modules(remote, bus, rows)
        unexpected = compare(remote.configuration()[0], bus.slaves).unexpected
        answers = ask_slaves(remote, wanted, bus, rows)
    return bus, devices, {n for n in unexpected if not _exchanges(bus.slaves[n])}, rows, answers


def _exchanges(slave: Slave) -> bool:
    return bool(slave.outputs or slave.inputs)


def _uncertain(row: SlaveAlState, settings: SlaveConfig, slave: Slave) -> str:
    """Why the process data of a slave are uncertain, what the next start does, and what to do."""
    text = row["recovery_text"]
    if row["recovery"] == Condition.SILENT and settings.writes_objects and _exchanges(slave):
        text += (
            "; a start with this file tells it its configuration, so it takes no part if it does "
            "not answer then either"
        )
    return f"{text}; {REMEDIES[Condition(row['recovery'])]}"


def _wrong(
    wanted: Config,
    places: dict[int, int],
    bus: Bus,
    others: set[int],
    eeproms: Mapping[int, Sii],
) -> list[str]:
    """All that a start would refuse, and conditions that it would not use."""
    problems = Collected()
    with problems:
        load_description(wanted)
    with problems:  # without its profiles, nobody knows what the values of the file mean
        profiles = load_profiles(wanted, profile_folders())
        problems.texts += misfits(wanted.moved(places), bus, profiles, others)
        problems.texts += unused_conditions(wanted.flight_recorder, bus, others)
    for n, sii in eeproms.items():
        if not bus.slaves[n].coe:
            with problems:
                chosen_from_eeprom(bus.slaves[n], sii, wanted.moved(places).settings_of(n))
    return problems.texts


def described(bus: Bus, source: str, findings: Findings) -> dict[int, EsiDevice]:
    """The ESI descriptions of the slaves; warns about those without one.

    Args:
        bus: The bus.
        source: An ESI file, or a folder of them.
        findings: Takes what is wrong in the files.
    """
    from .esi_devices import describe

    devices = describe(bus.slaves, source, findings)
    missing = [slave.label for slave in bus.slaves if slave.position not in devices]
    if missing:
        print(f"ecatctl: {source} does not describe {', '.join(missing)}", file=sys.stderr)
    return devices


def _changed_pdos(wanted: Config, bus: Bus, unknown: Collection[int]) -> dict[int, str]:
    """By position, which other PDOs, or other entries, a start would write to slaves."""
    slaves = {n: bus.slaves[n] for n in range(len(bus.slaves)) if n not in unknown}
    changes = {n: pdo_change(wanted.settings_of(n), slave) for n, slave in slaves.items()}
    for n, slave in slaves.items():
        with Collected():  # what is wrong with the table itself is found elsewhere
            changes[n] = changes[n] or can_change(wanted, wanted.settings_of(n), slave)
    return {n: text for n, text in changes.items() if text}


def _can_remarks(wanted: Config, bus: Bus) -> Iterator[str]:
    """What a start would warn of about the CAN buses behind terminals."""
    for settings in wanted.slave:
        if settings.can is not None and settings.position < len(bus.slaves):
            with Collected():  # what is wrong with the table itself is found elsewhere
                yield from can_channel(wanted, settings.can, bus.slaves[settings.position]).remarks


def _refused_pdos(
    wanted: Config, bus: Bus, changed: Collection[int], answers: Answers
) -> Iterator[Difference]:
    """Why slaves would refuse their new PDOs, as far as they have answered."""
    for n in changed:
        settings, slave, objects = wanted.settings_of(n), bus.slaves[n], answers.objects.get(n, {})
        for key, text in pdo_obstacles(settings, slave, answers.eeproms.get(n), objects):
            text = f"{settings.table.where(key)}: {slave.label} {text}"
            yield Difference(DifferenceKind.OTHER_PDOS, (n,), (n,), text, strict=False)


def _unknown_pdos(
    wanted: Config, bus: Bus, changed: Collection[int], answers: Answers
) -> Iterator[str]:
    """Warnings about PDOs of which nobody has said whether the slaves have them."""
    for n in changed:
        slave = bus.slaves[n]
        known = answers.objects.get(n, {}) if slave.coe or n not in answers.eeproms else None
        new = new_pdos(wanted.settings_of(n), slave)
        if known is not None and (unknown := [index for index in new if index not in known]):
            yield (
                f"{slave.label} has not told whether it has PDO {indices_text(unknown)}; if not, "
                "a start fails: --esi with its ESI file finds out"
            )


def _forbidden(wanted: Config, bus: Bus, devices: dict[int, EsiDevice]) -> list[Difference]:
    """PDOs and modules of the configuration that the ESI files do not allow."""
    from ecatd.vendor.esi.check import pdo_problems
    from ecatd.vendor.esi.modules import module_problems

    found = []
    for settings in wanted.slave:
        device = devices.get(settings.position)
        if device is None:
            continue
        problems = [
            (DifferenceKind.FORBIDDEN_PDOS, text) for text in pdo_problems(settings, device)
        ]
        idents = [module.ident for module in settings.modules]
        problems += [
            (DifferenceKind.FORBIDDEN_MODULES, text) for text in module_problems(device, idents)
        ]
        place = (settings.position,)
        label, file = bus.slaves[settings.position].label, Path(device.path).name
        found += [
            Difference(kind, place, place, f"{label} {text} ({file})", strict=False)
            for kind, text in problems
        ]
    return found

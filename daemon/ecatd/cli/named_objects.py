"""Gets what slaves have of that which a configuration names: from them, or from ESI files."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ecatd.base.errors import NoAnswerError, SdoAbortError, StateError
from ecatd.config import Config, SlaveConfig
from ecatd.config.expected_bus import compare
from ecatd.config.resolve.objects import Objects, object_indices
from ecatd.config.resolve.pdos import pdo_change, pdo_objects
from ecatd.description.bus import Bus, Module
from ecatd.description.modules import CONFIGURED, DETECTED, module_differences
from ecatd.etg.dictionary import DictionaryObject
from ecatd.etg.error_codes import NO_OBJECT
from ecatd.etg.sii import Sii
from ecatd.etg.sii_check import check_sii
from ecatd.operations.bus import SlaveAlState

if TYPE_CHECKING:
    from ecatd.client.remote import Remote
    from ecatd.vendor.esi import EsiDevice


@dataclass(slots=True)
class Answers:
    """What slaves have answered, by position."""

    #: The objects that the configuration names, and those that a start would write for its PDOs and
    #: modules.
    objects: dict[int, Objects] = field(default_factory=dict)
    #: What is in their EEPROMs, where the configuration depends on that.
    eeproms: dict[int, Sii] = field(default_factory=dict)


def refresh_modules(remote: Remote, bus: Bus, states: Iterable[SlaveAlState]) -> None:
    """Asks modular devices which modules they have now; the description has those of the start.

    Nobody knows the PDOs of other modules before a start has read them, so the slave has none then.
    """
    there = {row["position"] for row in states if row["al_state"]}
    for slave in bus.slaves:
        if not slave.modules or slave.position not in there:
            continue
        with suppress(SdoAbortError, NoAnswerError, StateError):  # it cannot be asked now
            count = int.from_bytes(remote.sdo_read(slave.position, DETECTED).data[:1], "little")
            slots = [remote.sdo_read(slave.position, DETECTED, n + 1).data for n in range(count)]
            now = [Module(int.from_bytes(slot, "little")) for slot in slots]
            if module_differences(slave.modules, now):
                names = {module.ident: module.name for module in slave.modules}
                slave.modules = [Module(item.ident, names.get(item.ident, "")) for item in now]
                slave.outputs, slave.inputs = [], []


def ask_slaves(remote: Remote, wanted: Config, bus: Bus, states: list[SlaveAlState]) -> Answers:
    """Asks the slaves for what the configuration names."""
    silent = {row["position"] for row in states if not row["al_state"]}
    found = compare(wanted, bus.slaves, silent)
    answers = Answers()
    for settings in wanted.moved(found.places).slave:
        n = settings.position
        if n >= len(bus.slaves) or n in silent | {*found.unexpected}:
            continue
        slave = bus.slaves[n]
        changed = bool(pdo_change(settings, slave))
        if changed or any(item.complete for item in settings.startup):
            with suppress(StateError):  # it cannot be read now
                answers.eeproms[n] = check_sii(remote.sii(n))
        if slave.coe:
            needed = [CONFIGURED] if settings.module else []
            needed += pdo_objects(settings, slave, answers.eeproms.get(n)) if changed else []
            answers.objects[n] = _ask_needed(remote, n, needed) | _ask_objects(remote, settings)
    return answers


def _ask_needed(
    remote: Remote, position: int, indices: Iterable[int]
) -> dict[int, DictionaryObject | None]:
    """Asks for objects that a slave may have without describing them, as a start does."""
    objects: dict[int, DictionaryObject | None] = {}
    for index in indices:
        try:
            remote.sdo_read(position, index)
            objects[index] = DictionaryObject(index, "", 0, 0)
            objects[index] = remote.describe_object(position, index)
        except SdoAbortError as error:
            if index not in objects and error.code == NO_OBJECT:
                objects[index] = None
        except (NoAnswerError, StateError):
            continue
    return objects


def _ask_objects(remote: Remote, settings: SlaveConfig) -> dict[int, DictionaryObject | None]:
    objects: dict[int, DictionaryObject | None] = {}
    for index in object_indices(settings):
        try:
            objects[index] = remote.describe_object(settings.position, index)
        except SdoAbortError as error:
            if error.code == NO_OBJECT:
                objects[index] = None
        except (NoAnswerError, StateError):  # it does not describe its objects
            break
    return objects


def esi_objects(wanted: Config, devices: dict[int, EsiDevice]) -> dict[int, Objects]:
    """The objects that the configuration names, by position, of devices with a dictionary."""
    from ecatd.vendor.esi.modules import plug

    from .dictionary import objects_of

    found: dict[int, Objects] = {}
    for n, device in devices.items():
        settings = wanted.settings_of(n)
        plugged = (
            plug(device, [item.ident for item in settings.modules]) if device.slots else device
        )
        known = {item.index: item for item in objects_of(plugged)}
        complete = known and (settings.module or not device.slots)
        found[n] = {
            index: known.get(index)
            for index in object_indices(settings)
            if complete or index in known
        }
    return found

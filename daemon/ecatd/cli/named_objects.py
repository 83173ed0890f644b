"""Gets the objects that a configuration names: from the slaves, or from ESI files."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ecatd.model.abort_codes import NO_OBJECT
from ecatd.model.applied.objects import Objects, object_indices
from ecatd.model.bus import Bus
from ecatd.model.config import Config, SlaveConfig
from ecatd.model.errors import NoAnswerError, SdoAbortError, StateError
from ecatd.model.expected_bus import compare

if TYPE_CHECKING:
    from ecatd.client.remote import Remote
    from ecatd.esi import EsiDevice
    from ecatd.model.dictionary import DictionaryObject


def live_objects(
    remote: Remote, wanted: Config, bus: Bus, states: list[dict[str, Any]]
) -> dict[int, Objects]:
    """Asks the slaves for the objects that the configuration names, by position."""
    silent = {row["position"] for row in states if not row["al_state"]}
    found = compare(wanted, bus.slaves, silent)
    asked = {}
    for settings in wanted.moved(found.places).slave:
        n = settings.position
        if n < len(bus.slaves) and bus.slaves[n].coe and n not in silent | {*found.unexpected}:
            asked[n] = _ask_objects(remote, settings)
    return asked


def _ask_objects(remote: Remote, settings: SlaveConfig) -> Objects:
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
    from ecatd.esi.modules import plug

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

"""What a library or an FMU is made from, and carries in itself: the bus and device profiles."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

from ecatd.model import bus_file
from ecatd.model.bus import Bus, Slave
from ecatd.model.errors import ConfigError, UsageError

from .profiles import Profiles, profiles_file, read_profiles

_BUS, _PROFILES = "bus.json", "profiles.toml"


@dataclass(frozen=True, slots=True)
class Origin:
    """All that the generated files depend on, besides name, templates and version.

    Attributes:
        bus: The bus, without what another bus of the same slaves would have otherwise.
        profiles: Device profiles.
    """

    bus: Bus
    profiles: Profiles

    def files(self) -> dict[str, bytes]:
        """The files that say it; of the profiles, those that fit a slave."""
        used = [
            device
            for device in self.profiles.devices
            if any(device.fits(slave) for slave in self.bus.slaves)
        ]
        return {_BUS: bus_file.dump(self.bus).encode(), _PROFILES: profiles_file(used).encode()}


def origin(bus: Bus, profiles: Profiles) -> Origin:
    """The origin of what is generated now.

    A library must not change when a slave is replaced by another one of its type, or when the
    clocks are measured again: serial numbers, addresses, delays and places in the process image
    are left out.
    """
    return Origin(replace(bus, slaves=[_essence(slave) for slave in bus.slaves]), profiles)


def read_origin(read: Callable[[str], bytes | None]) -> Origin | None:
    """The origin of what was generated before; None where that is not known any more.

    Args:
        read: Gives the content of a file of `Origin.files`.
    """
    bus, profiles = read(_BUS), read(_PROFILES)
    if bus is None or profiles is None:
        return None
    with suppress(UsageError, ConfigError, UnicodeDecodeError):
        return origin(
            bus_file.parse(bus.decode(), _BUS), read_profiles(profiles.decode(), _PROFILES)
        )
    return None


def _essence(slave: Slave) -> Slave:
    return Slave(
        slave.position,
        slave.name,
        slave.vendor,
        slave.product,
        slave.revision,
        coe=slave.coe,
        outputs=slave.outputs,
        inputs=slave.inputs,
        domain=slave.domain,
    )

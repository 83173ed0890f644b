"""Lists everything in a configuration that does not fit the description of a bus."""

from __future__ import annotations

from collections.abc import Collection
from copy import deepcopy

from ecatd.description.bus import Bus

from .. import Config
from ..meanings import raw_parameters, without_meanings
from ..problems import Collected
from ..profiles import Profiles
from .resolved import resolve_config
from .slaves import check_slaves
from .watchdogs import check_watchdog


def misfits(
    config: Config, described: Bus, profiles: Profiles, uncertain: Collection[int] = ()
) -> list[str]:
    """Takes the steps of a start that need only the description of the bus.

    Args:
        config: The configuration, about the slaves where they were found.
        described: The bus. Meanings from another configuration do not count.
        profiles: Device profiles.
        uncertain: Positions of slaves whose process data will change.

    Returns:
        All reasons for which the daemon would refuse the configuration.
    """
    problems = Collected()
    bus = without_meanings(deepcopy(described))
    bus.cycle_time_us = config.cycle_time_us
    check_slaves(config, bus, problems)
    config = config.moved({slave.position: slave.position for slave in bus.slaves})
    for slave in bus.slaves:
        settings = config.settings_of(slave.position)
        slave.given_name, slave.group = settings.name, settings.group_at(slave.position)
        if slave.position not in uncertain:
            raw_parameters(settings, slave, profiles, config.signal, problems)
    wire = [slave.position for slave in bus.slaves]
    resolve_config(config, bus, profiles, wire, uncertain, uncertain, problems)
    for slave in bus.slaves:
        wanted = config.settings_of(slave.position).watchdog_ms
        if wanted is not None and any(pdo.bit_length for pdo in slave.outputs):
            slave.watchdog_ms = wanted
        if slave.position not in uncertain:
            with problems:
                check_watchdog(config, bus, slave)
    return problems.texts

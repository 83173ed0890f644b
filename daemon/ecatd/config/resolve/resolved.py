"""Resolves the configuration on a bus: the steps that need only its description.

The daemon does this at its start, with the bus that it has scanned. `ecatctl config check` does the
same with the description of a bus.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Protocol, TypeVar

from ecatd.description.bus import Bus, Domain, Slave

from .. import Config, DomainConfig
from ..meanings import give_meanings, raw_parameters, without_meanings
from ..problems import AT_ONCE, Collected, Problems
from ..profiles import Profiles
from .can import CanChannel, can_channels, with_can_objects
from .clocks import ClockPlan, plan_clocks
from .copies import Copy, find_copies
from .safe import SafeOutputs, safe_outputs
from .slaves import check_slaves
from .watchdogs import check_watchdog

_R = TypeVar("_R", bound="_Rule")


@dataclass(slots=True)
class ResolvedConfig:
    """What the configuration says about a bus, in addition to its description.

    Attributes:
        safe: Safe values of the outputs.
        copies: Outputs that get the value of an input.
        clocks: The distributed clocks, if they are used.
        can: The CAN buses behind terminals.
    """

    safe: SafeOutputs
    copies: list[Copy]
    clocks: ClockPlan | None
    can: list[CanChannel]


def resolve_config(
    config: Config,
    bus: Bus,
    profiles: Profiles,
    wire: Sequence[int],
    uncertain: Collection[int] = (),
    idle: Collection[int] = (),
    problems: Problems = AT_ONCE,
) -> ResolvedConfig:
    """Gives values their meanings, outputs their safe values, and slaves their domains and clocks.

    Args:
        config: The configuration, about slaves that are there (`check_slaves`).
        bus: The bus; its description is completed.
        profiles: Device profiles.
        wire: Positions of the slaves that are there, in the order of the wire.
        uncertain: Positions of slaves with uncertain process data. Rules about entries that they
            do not have are ignored.
        idle: Positions of slaves whose process data are unknown.
        problems: Takes the problems.

    Raises:
        ConfigError: The configuration does not fit this bus.
    """
    startup = {(item.position, one.address) for item in config.slave for one in item.startup}
    signals = _fitting(config.signal, bus, uncertain)
    give_meanings(bus, profiles, signals, startup, problems)
    rules = _fitting(config.outputs.safe, bus, uncertain)
    safe = safe_outputs(bus, rules, signals, problems)
    copies = find_copies(bus, config.copy, safe.stops, uncertain, problems)
    assign_domains(bus, config.domain, idle, problems)
    can = can_channels(config, bus, {*uncertain, *idle}, problems)
    return ResolvedConfig(safe, copies, plan_clocks(bus, config, wire, problems), can)


class _Rule(Protocol):
    slave: int

    @property
    def address(self) -> tuple[int, int] | None: ...


def _fitting(rules: Sequence[_R], bus: Bus, uncertain: Collection[int]) -> list[_R]:
    """Returns the rules of the configuration, without those about unknown process data.

    Args:
        rules: Rules about a slave, or about one of its entries.
        bus: The bus.
        uncertain: Positions of slaves whose process data are uncertain.
    """
    return [
        rule for rule in rules if rule.slave not in uncertain or _has(bus.slaves[rule.slave], rule)
    ]


def _has(slave: Slave, rule: _Rule) -> bool:
    entries = {
        (entry.index, entry.subindex)
        for outputs in (True, False)
        for _, entry, _ in slave.entries(outputs=outputs)
    }
    return bool(slave.output_bytes) if rule.address is None else rule.address in entries


def assign_domains(
    bus: Bus,
    configured: Sequence[DomainConfig],
    idle: Collection[int] = (),
    problems: Problems = AT_ONCE,
) -> None:
    """Puts every slave into its configured domain, or into domain 0 if none is configured.

    Args:
        bus: Scanned slaves with their PDOs; `domains` and the `domain` of each slave are set.
        configured: Domains of the configuration.
        idle: Positions of slaves whose process data are unknown. A domain of such slaves is
            accepted, although its process data are not known.
        problems: Takes each domain without process data.

    Raises:
        ConfigError: There are several domains, and one has no process data.
    """
    bus.domains = [Domain(item.name, item.divider, item.phase) for item in configured] or [Domain()]
    for slave in bus.slaves:
        slave.domain = 0
    for number, item in enumerate(configured):
        for position in item.slaves:
            bus.slaves[position].domain = number
    if len(configured) < 2:
        return
    used = {slave.domain for slave in bus.slaves if slave.output_bytes or slave.input_bytes}
    used |= {bus.slaves[position].domain for position in idle}
    for number, item in enumerate(configured):
        if number not in used:
            with problems:
                item.table.fail(
                    "slaves",
                    f"{bus.domain_label(number)} has nothing to exchange, since none of its slaves "
                    "has process data: give it others, or remove this [[domain]]",
                )


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
        with_can_objects(config, settings, slave, problems)
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

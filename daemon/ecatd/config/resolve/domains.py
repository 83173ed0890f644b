"""Puts slaves into the domains of the configuration."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from ecatd.description.bus import Bus, Domain

from .. import DomainConfig
from ..problems import AT_ONCE, Problems


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

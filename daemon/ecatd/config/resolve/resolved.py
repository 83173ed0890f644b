"""Applies the configuration to a bus: the steps that need only its description.

The daemon does this at its start, with the bus that it has scanned. `ecatctl config check` does the
same with the description of a bus.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

from ecatd.description.bus import Bus, Slave

from .. import Config
from ..meanings import give_meanings
from ..problems import AT_ONCE, Problems
from ..profiles import Profiles
from .clocks import ClockPlan, plan_clocks
from .copies import Copy, find_copies
from .domains import assign_domains
from .safe import SafeOutputs, safe_outputs

_R = TypeVar("_R", bound="_Rule")


@dataclass(slots=True)
class ResolvedConfig:
    """What the configuration says about a bus, in addition to its description.

    Attributes:
        safe: Safe values of the outputs.
        copies: Outputs that get the value of an input.
        clocks: The distributed clocks, if they are used.
    """

    safe: SafeOutputs
    copies: list[Copy]
    clocks: ClockPlan | None


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
    return ResolvedConfig(safe, copies, plan_clocks(bus, config, wire, problems))


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

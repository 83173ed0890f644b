"""Chooses the reference clock of a bus, and the times of SYNC signals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ecatd.base.toml_file import Table
from ecatd.description.bus import Bus, Slave

from .. import Config, DcSlaveConfig
from ..problems import AT_ONCE, Problems

NEAR_NS, LEAD_NS = 2_000_000_000, 100_000_000
"""A clock of 32 bits takes a start that is further ahead than `NEAR_NS` for one in the past.
`LEAD_NS` is the time from the set-up of SYNC0 to its first pulse."""


@dataclass(slots=True)
class ClockPlan:
    """The clocks of a bus.

    Attributes:
        reference: The slave with the reference clock.
        followers: Slaves that its time reaches, as far as that is known.
    """

    reference: Slave
    followers: list[Slave]


def plan_clocks(
    bus: Bus, config: Config, wire: Sequence[int], problems: Problems = AT_ONCE
) -> ClockPlan | None:
    """Chooses the reference clock, and notes the times of SYNC signals in the description.

    Args:
        bus: The bus; `dc_bits` of its slaves are known.
        config: The configuration.
        wire: Positions of the slaves that are there, in the order of the wire.
        problems: Takes the problems.

    Returns:
        The clocks; None if the configuration does not use them, or `problems` has taken the reason
        why there are none.

    Raises:
        ConfigError: The configuration asks for something that this bus does not have.
    """
    if not config.dc.enabled:
        return None
    places = {position: place for place, position in enumerate(wire)}
    plan = None
    with problems:
        plan = _plan(bus, config, places)
        for item in config.dc.slave:
            with problems:
                _check_follower(bus, plan, item)
                _note(config, item, bus.slaves[item.slave])
    return plan


def _plan(bus: Bus, config: Config, places: dict[int, int]) -> ClockPlan:
    clocks = [slave for slave in bus.slaves if slave.dc_bits]
    if not clocks:
        config.dc.table.fail(
            None, f"no slave of bus '{bus.name}' has a distributed clock: leave [dc] out"
        )
    reference = _reference(bus, config, clocks, places)

    def is_behind(slave: Slave) -> bool:
        if slave.position not in places:
            return slave.position > reference.position
        return places[slave.position] > places[reference.position]

    return ClockPlan(reference, [slave for slave in clocks if is_behind(slave)])


def _reference(bus: Bus, config: Config, clocks: list[Slave], places: dict[int, int]) -> Slave:
    wanted, table = config.dc.reference, config.dc.table
    if wanted >= 0:
        slave = _with_clock(bus, wanted, table, "reference")
        if slave.group:
            table.fail(
                "reference",
                f"{slave.label} is optional, but the cycle needs a clock that is always there: "
                "choose another one",
            )
        return slave
    always = [slave for slave in clocks if not slave.group]
    if not always:
        table.fail(
            None,
            f"all slaves of bus '{bus.name}' with a distributed clock are optional, but the cycle "
            "needs a clock that is always there: leave [dc] out",
        )
    return min(always, key=lambda slave: places[slave.position])


def _with_clock(bus: Bus, position: int, table: Table, key: str) -> Slave:
    slave = bus.slaves[position]
    if not slave.dc_bits:
        others = ", ".join(str(slave.position) for slave in bus.slaves if slave.dc_bits)
        table.fail(key, f"{slave.label} has no distributed clock; those with one are: {others}")
    return slave


def _check_follower(bus: Bus, plan: ClockPlan, item: DcSlaveConfig) -> None:
    """Refuses SYNC signals of a slave that cannot have any."""
    slave = _with_clock(bus, item.slave, item.table, "slave")
    if slave is not plan.reference and slave not in plan.followers:
        item.table.fail(
            "slave",
            f"{slave.label} cannot follow the reference clock, {plan.reference.label}: the frame "
            "that brings its time passes only the slaves behind it; choose a reference at or "
            f"before slave {slave.position}",
        )


def _note(config: Config, item: DcSlaveConfig, slave: Slave) -> None:
    """Notes the times of the SYNC pulses of a slave in its description."""
    slave.sync0_ns = round(config.sync0_us(item) * 1000)
    slave.sync1_ns = round(item.sync1_us * 1000)
    slave.sync_shift_ns = round(config.shift_us(item) * 1000)
    if slave.dc_bits == 32 and whole_period(slave) > NEAR_NS - LEAD_NS:
        item.table.fail(
            "sync0_us",
            f"{slave.label} has a clock of 32 bits, which cannot hold a time that is more than "
            f"{NEAR_NS * 1e-9:g} s away: shorten the period of its SYNC signals",
        )


def whole_period(slave: Slave) -> int:
    """Returns the time in ns after which the pattern of SYNC0 and SYNC1 repeats.

    SYNC1 comes `sync1_ns` after a SYNC0. If that is longer than the period of SYNC0, the next SYNC1
    counts from the first SYNC0 after it.
    """
    return (slave.sync1_ns // slave.sync0_ns + 1) * slave.sync0_ns

"""Checks what several tables of the configuration say together."""

from __future__ import annotations

from functools import partial

from ..toml_file import Table
from .clocks import SYNC_MAX_US
from .config import Config


def check_clocks(top: Table, config: Config) -> None:
    """Checks that clocks fit the cycles of their slaves.

    Raises:
        ConfigError: They do not, or a slave has two tables.
    """
    table = top.table("dc", None)
    if table is None:
        return
    cycle, dc = config.cycle_time_us, config.dc
    if dc.phase_us >= cycle:
        table.fail(
            "phase_us",
            f"is {dc.phase_us:g}, but frames leave within the base cycle, {cycle} µs",
        )
    if dc.lock_us > cycle / 2:
        table.fail(
            "lock_us",
            f"is {dc.lock_us:g}, but no phase is more than half the base cycle, "
            f"{cycle / 2:g} µs, from where it should be",
        )
    seen: set[int] = set()
    for row, slave in zip(table.tables("slave"), dc.slave, strict=True):
        if slave.slave in seen:
            row.fail("slave", f"slave {slave.slave} has two tables: remove one")
        seen.add(slave.slave)
        domain = config.domain_cycle_us(slave.slave)
        # SYNC0 must not drift against the frames, so compare whole nanoseconds as in the register.
        sync0, frames = round(config.sync0_us(slave) * 1000), domain * 1000
        if not 0 < sync0 <= SYNC_MAX_US * 1000:
            row.fail(
                "sync0_us",
                f"is the cycle of the domain, {domain} µs, but SYNC0 comes at least every "
                f"{SYNC_MAX_US} µs: choose a fraction of the cycle",
            )
        if sync0 % frames and frames % sync0:
            row.fail(
                "sync0_us",
                f"is {slave.sync0_us:g}, but slave {slave.slave} is exchanged every {domain} "
                f"µs: it must be a multiple or a whole fraction of that",
            )


def check_physical(top: Table, config: Config) -> None:
    """Checks the physical values of parameters whose unit and scale a `[[signal]]` gives.

    Those that a device profile knows are checked when the bus starts.

    Raises:
        ConfigError: A value does not fit.
    """
    rules = {(rule.slave, rule.address): rule for rule in config.signal if rule.is_scaled}
    for row, slave in zip(top.tables("slave"), config.slave, strict=True):
        for table, parameter in zip(row.tables("startup"), slave.startup, strict=True):
            rule = rules.get((slave.position, parameter.address))
            if rule is not None and parameter.unit is not None:
                known = rule.scaled(parameter.entry)
                table.explain("value", partial(parameter.raw, known))

"""Distributed clocks: the keys of `[dc]`, and how they are read."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from ecatd.base.timeouts import Timeout
from ecatd.base.toml_file import Key, Table, accepts, number, zero_or
from ecatd.description.limits import POSITION_MAX

from .placed import Placed, each, read, rules_of
from .references import slave_reference

SYNC_MIN_US, SYNC_MAX_US = 0.001, 4_000_000
"""Bounds of the times of SYNC signals: registers 0x09A0 and 0x09A4 have nanoseconds in 32 bits."""


@accepts(f"-1 to {POSITION_MAX} or a name")
def _reference(table: Table, key: Key) -> int:
    value = table.data.get(key)
    known = isinstance(value, str) or value in table.document.names.values()
    return slave_reference(table, key) if known else table.integer(key, -1, POSITION_MAX)


@dataclass(slots=True)
class DcSlaveConfig(Placed):
    """`[[dc.slave]]`: one table for each slave that makes SYNC signals.

    Attributes:
        slave: Position of the slave, or its name.
        sync0_us: Period of SYNC0: a multiple or a whole fraction of the cycle of its domain; 0: the
            cycle of its domain.
        shift_us: Time from the start of the reference clock's cycle to SYNC0. Default: half the
            base cycle.
        sync1_us: Time from SYNC0 to SYNC1; 0: no SYNC1.
    """

    slave: Annotated[int, slave_reference]
    sync0_us: Annotated[float, zero_or(SYNC_MIN_US, SYNC_MAX_US)] = 0.0
    shift_us: Annotated[float | None, number(-SYNC_MAX_US, SYNC_MAX_US)] = None
    sync1_us: Annotated[float, zero_or(SYNC_MIN_US, SYNC_MAX_US)] = 0.0


@dataclass(slots=True)
class DcConfig(Placed):
    """`[dc]`: the [distributed clocks](distributed-clocks.md).

    Attributes:
        enabled: Synchronise the clocks. Without `enabled = true` and without a `[[dc.slave]]`,
            ecatd refuses the other keys of this table. Default: `true` if there is a
            `[[dc.slave]]`, else `false`.
        reference: Position or name of the slave with the reference clock; -1: the first slave with
            a clock.
        phase_us: Time from the start of the reference clock's cycle until the frames leave; less
            than the base cycle.
        lock_us: The cycle counts as locked while its phase differs from `phase_us` by no more than
            this; at most half the base cycle.
        timeout_s: How long a start waits for the lock.
        slave: Slaves with SYNC signals.
    """

    enabled: Annotated[bool, Table.boolean] = False
    reference: Annotated[int, _reference] = -1
    phase_us: Annotated[float, number(0, 1_000_000)] = 0.0
    lock_us: Annotated[float, number(0.1, 500_000)] = 20.0
    timeout_s: Annotated[float, number(0.1, 300)] = 5.0
    slave: Annotated[list[DcSlaveConfig], each(DcSlaveConfig)] = field(default_factory=list)

    @property
    def timeout(self) -> Timeout:
        """How long a start waits for the lock."""
        return Timeout(self.timeout_s, "timeout_s in [dc]")


def read_clocks(top: Table, key: Key) -> DcConfig:
    """Reads `[dc]` with its `[[dc.slave]]`."""
    table = top.table(key)
    dc = read(DcConfig, table)
    if "enabled" in table:
        return dc
    dc.enabled = bool(dc.slave)
    for name in () if dc.slave else rules_of(DcConfig):
        if getattr(dc, name) != getattr(DcConfig(), name):
            table.fail(
                name,
                "does nothing, since no clock is synchronised: add enabled = true, or a "
                "[[dc.slave]]",
            )
    return dc

"""Distributed clocks: the keys of `[dc]`, and how they are read."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..toml_file import Key, Rules, Table, number
from .placed import Placed
from .slave_reference import POSITION_MAX, slave_reference

SYNC_MAX_US = 4_000_000
"""Longest cycle of SYNC signals: registers 0x09A0 and 0x09A4 have nanoseconds in 32 bits."""


@dataclass(slots=True)
class DcSlaveConfig(Placed):
    """`[[dc.slave]]`: the SYNC signals of one slave.

    Attributes:
        slave: Position.
        sync0_us: Period of SYNC0 in microseconds; 0: the cycle of the slave's domain.
        shift_us: Time from the start of the reference clock's cycle to SYNC0, in microseconds;
            None: half the base cycle.
        sync1_us: Time from SYNC0 to SYNC1, in microseconds; 0: no SYNC1.
    """

    slave: int
    sync0_us: float = 0.0
    shift_us: float | None = None
    sync1_us: float = 0.0


@dataclass(slots=True)
class DcConfig(Placed):
    """`[dc]`: distributed clocks.

    Attributes:
        enabled: Whether clocks are synchronised; in a file the default is true if it has any
            `[[dc.slave]]`.
        reference: Position of the reference clock; -1: the first slave with a clock.
        phase_us: Time from the start of the reference clock's cycle until the frames leave, in
            microseconds.
        lock_us: The cycle counts as locked while its phase differs from `phase_us` by no more than
            this, in microseconds.
        timeout_s: Longest time that a start waits for the lock, in seconds.
        slave: Slaves with SYNC signals.
    """

    enabled: bool = False
    reference: int = -1
    phase_us: float = 0.0
    lock_us: float = 20.0
    timeout_s: float = 5.0
    slave: list[DcSlaveConfig] = field(default_factory=list)


def _reference(table: Table, key: Key) -> int:
    value = table.data.get(key)
    known = isinstance(value, str) or value in table.document.names.values()
    return slave_reference(table, key) if known else table.integer(key, -1, POSITION_MAX)


_SLAVE: Rules = {
    "slave": slave_reference,
    "sync0_us": number(0, SYNC_MAX_US),
    "shift_us": number(-SYNC_MAX_US, SYNC_MAX_US),
    "sync1_us": number(0, SYNC_MAX_US),
}
_DC: Rules = {
    "enabled": Table.boolean,
    "reference": _reference,
    "phase_us": number(0, 1_000_000),
    "lock_us": number(0.1, 500_000),
    "timeout_s": number(0.1, 300),
    "slave": lambda table, key: [
        DcSlaveConfig(**row.read(_SLAVE, required=["slave"]), table=row)
        for row in table.tables(key)
    ],
}


def read_clocks(top: Table, key: Key) -> DcConfig:
    """Reads `[dc]` with its `[[dc.slave]]`."""
    table = top.table(key)
    values = table.read(_DC)
    values.setdefault("enabled", bool(values.get("slave")))
    dc = DcConfig(**values, table=table)
    for name in values if "enabled" not in table and not dc.slave else ():
        if values[name] != getattr(DcConfig(), name):
            table.fail(
                name,
                "does nothing, since no clock is synchronised: add enabled = true, or a "
                "[[dc.slave]]",
            )
    return dc

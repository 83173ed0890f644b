"""Reads `[[domain]]` and `[dc]`, and checks that clocks fit the cycles of domains."""

from __future__ import annotations

import re

from ..toml_file import Key, Rules, Table, integer, number, printable, show
from .tables import POSITION_MAX, Config, DcConfig, DcSlaveConfig, DomainConfig

DOMAINS_MAX = 16
SYNC_MAX_US = 4_000_000
"""Longest cycle of SYNC signals: registers 0x09A0 and 0x09A4 have nanoseconds in 32 bits."""


def slave_reference(table: Table, key: Key) -> int:
    """Reads which slave is meant: its position, or the name that a `[[slave]]` gives it."""
    value = table.data.get(key)
    names = table.document.names
    if isinstance(value, str):
        if value not in names:
            table.fail(
                key,
                f"no [[slave]] has the name {show(value)}{_known(table)}: correct it, or write the "
                "position",
            )
        return names[value]
    if type(value) is int and value in names.values():  # also of a slave without a position
        return value
    return table.integer(key, 0, POSITION_MAX)


def _known(table: Table) -> str:
    """The first names that there are, for messages."""
    names = sorted(table.document.names)
    return f" (there are {', '.join(names[:8])}{', …' * (len(names) > 8)})" if names else ""


_POSITIONS = re.compile(r"([0-9]{1,5})(?:\s*-\s*([0-9]{1,5}))?")
_DOMAIN: Rules = {
    "name": printable(31),
    "divider": integer(1, 65535),
    "phase": integer(0, 65534),
    "slaves": Table.elements,
}


def read_domains(top: Table, key: Key) -> list[DomainConfig]:
    """Reads all `[[domain]]` tables, domain 0 first."""
    rows = top.tables(key)
    if len(rows) > DOMAINS_MAX:
        top.fail(key, f"{len(rows)} tables, but there can be {DOMAINS_MAX} domains")
    domains: list[DomainConfig] = []
    for row in rows:
        values = row.read(_DOMAIN, required=["slaves"])
        values["slaves"] = _positions(values["slaves"], domains)
        domain = DomainConfig(**values, table=row)
        if domain.name and domain.name in (other.name for other in domains):
            row.fail("name", f"'{domain.name}' is the name of another domain, too: choose one")
        if domain.phase >= domain.divider:
            row.fail(
                "phase",
                f"is {domain.phase}, but must be less than the divider, {domain.divider}: the "
                f"domain is exchanged in cycles whose number leaves this remainder",
            )
        if domains and not domain.slaves:
            row.fail(
                "slaves",
                f'domain {len(domains)} has none: write its positions, as in slaves = [0, 3, "5-7"]'
                ", or leave the table out",
            )
        domains.append(domain)
    return domains


def _positions(items: Table, domains: list[DomainConfig]) -> list[int]:
    """Reads a list of positions; refuses those that an earlier one of `domains` has."""
    taken = {position: n for n, domain in enumerate(domains) for position in domain.slaves}
    positions = []
    for item in items.data:
        for position in _position_row(items, item):
            if position in taken:
                items.fail(
                    item,
                    f"slave {position} is already in domain {taken[position]}; a slave is in "
                    "one domain, and named once: remove it from one list",
                )
            taken[position] = len(domains)
            positions.append(position)
    return positions


def _position_row(items: Table, key: Key) -> range:
    """Reads an element of a list of slaves: 5, "5", "5-7", or a name."""
    item = items.data[key]
    named = items.document.names.items()
    match = _POSITIONS.fullmatch(item.strip()) if isinstance(item, str) else None
    if any(item in pair for pair in named):
        first = last = slave_reference(items, key)
    elif match:
        first, last = int(match[1]), int(match[2] or match[1])
    else:
        first = last = item if type(item) is int else -1
    if not 0 <= first <= last <= POSITION_MAX and first not in dict(named).values():
        items.fail(
            key,
            f"{items.show(key)} is no slave: write a position, 0 to {POSITION_MAX}, a row such as "
            f'"5-7", or the name of a [[slave]]{_known(items)}',
        )
    return range(first, last + 1)


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

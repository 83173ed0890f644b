"""Tables about the time of slaves: domains, and how clocks fit them."""

from __future__ import annotations

import re
from typing import Any

from .reader import Reader, Rules, shown
from .tables import Config, DomainConfig

DOMAINS_MAX = 16
POSITION_MAX = 65535
SYNC_MAX_US = 4_000_000
"""Registers 0x09A0 and 0x09A4 count nanoseconds in 32 bits."""

_POSITIONS = re.compile(r"([0-9]{1,5})(?:\s*-\s*([0-9]{1,5}))?")
_NAME_BYTES = 31
_DOMAIN: Rules = {
    "name": (str, 0, 0),
    "divider": (int, 1, 65535),
    "phase": (int, 0, 65534),
    "slaves": (list, 0, 0),
}


def read_domains(reader: Reader, rows: list[Any]) -> list[DomainConfig]:
    """The domains, 0 first."""
    if len(rows) > DOMAINS_MAX:
        reader.fail("", "domain", f"{len(rows)} tables, but there can be {DOMAINS_MAX} domains")
    domains: list[DomainConfig] = []
    for row, values in reader.rows(rows, _DOMAIN, "domain"):
        name = reader.text(values, "name", _NAME_BYTES, "domain", row)
        if name and name in (other.name for other in domains):
            reader.fail("domain", "name", f"'{name}' is the name of another domain, too", row)
        divider, phase = values.get("divider", 1), values.get("phase", 0)
        if phase >= divider:
            reader.fail(
                "domain",
                "phase",
                f"is {phase}, but must be less than the divider, {divider}: the domain is "
                f"exchanged in cycles whose number leaves this remainder",
                row,
            )
        values["slaves"] = _positions(reader, values.get("slaves", []), domains, row)
        if row > 0 and not values["slaves"]:
            reader.fail(
                "domain",
                "slaves",
                f'domain {row} has none: write its positions, as in slaves = [0, 3, "5-7"], '
                f"or leave the table out",
                row,
            )
        domains.append(DomainConfig(**values))
    return domains


def _positions(
    reader: Reader, items: list[Any], domains: list[DomainConfig], row: int
) -> list[int]:
    """Positions written out; `domains` are those in front, which must not have them."""
    taken = {position: n for n, domain in enumerate(domains) for position in domain.slaves}
    positions = []
    for item in items:
        for position in _position_row(reader, item, row):
            if position in taken:
                reader.fail(
                    "domain",
                    "slaves",
                    f"slave {position} is already in domain {taken[position]}; a slave is in "
                    f"one domain, and named once",
                    row,
                )
            taken[position] = row
            positions.append(position)
    return positions


def _position_row(reader: Reader, item: Any, row: int) -> range:
    """The positions of one element of a list: 5, "5" or "5-7"."""
    match = _POSITIONS.fullmatch(item.strip()) if isinstance(item, str) else None
    if match:
        first, last = int(match[1]), int(match[2] or match[1])
    elif type(item) is int:
        first = last = item
    else:
        first, last = -1, -1
    if not 0 <= first <= last <= POSITION_MAX:
        reader.fail(
            "domain",
            "slaves",
            f'{shown(item)} is neither a position, 0 to {POSITION_MAX}, nor a row such as "5-7"',
            row,
        )
    return range(first, last + 1)


def check_clocks(reader: Reader, config: Config) -> None:
    """Raises `ConfigError` where clocks do not fit the cycles of their slaves."""
    cycle, dc = config.cycle_time_us, config.dc
    if dc.phase_us >= cycle:
        reader.fail(
            "dc",
            "phase_us",
            f"is {dc.phase_us:g}, but frames leave within the base cycle, {cycle} µs",
        )
    if dc.lock_us > cycle / 2:
        reader.fail(
            "dc",
            "lock_us",
            f"is {dc.lock_us:g}, but no phase is more than half the base cycle, "
            f"{cycle / 2:g} µs, from where it should be",
        )
    seen: set[int] = set()
    for row, slave in enumerate(dc.slave):
        if slave.slave in seen:
            reader.fail("dc.slave", "slave", f"slave {slave.slave} has two tables", row)
        seen.add(slave.slave)
        domain = config.domain_cycle_us(slave.slave)
        # In nanoseconds, as the register has it: SYNC0 must not drift against the frames.
        sync0, frames = round(config.sync0_us(slave) * 1000), domain * 1000
        if not 0 < sync0 <= SYNC_MAX_US * 1000:
            reader.fail(
                "dc.slave",
                "sync0_us",
                f"is the cycle of the domain, {domain} µs, but SYNC0 comes at least every "
                f"{SYNC_MAX_US} µs: choose a fraction of the cycle",
                row,
            )
        if sync0 % frames and frames % sync0:
            reader.fail(
                "dc.slave",
                "sync0_us",
                f"is {slave.sync0_us:g}, but slave {slave.slave} is exchanged every {domain} "
                f"µs: it must be a multiple or a whole fraction of that",
                row,
            )

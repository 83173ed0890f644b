"""Domains: the keys of `[[domain]]`, and how they are read."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Annotated

from ecatd.base.toml_file import Key, Table, accepts, integer, printable
from ecatd.description.limits import DOMAIN_NAME_BYTES, DOMAINS_MAX, POSITION_MAX

from .placed import Placed, rules_of
from .references import known_names, slave_reference

"""Most bytes of the name of a domain in UTF-8."""

_POSITIONS = re.compile(r"([0-9]{1,5})(?:\s*-\s*([0-9]{1,5}))?")


@accepts(f"0 to {POSITION_MAX}, rows of these, or names")
def _slaves(row: Table, key: Key) -> Table:
    """Returns the elements; `_positions` reads them, which must know the domains before."""
    return row.elements(key)


@dataclass(slots=True)
class DomainConfig(Placed):
    """`[[domain]]`: one table for each [domain](configuration.md#domains), domain 0 first.

    There can be `DOMAINS_MAX`. Without such tables, domain 0 has all slaves.

    Attributes:
        name: Name for people, or empty; two domains cannot have the same name.
        divider: The domain is exchanged once in this number of base cycles.
        phase: Selects the base cycles: the domain is exchanged when the cycle number modulo
            `divider` equals the phase. Less than `divider`.
        slaves: Its slaves by position or name, such as `[0, 3, "5-7", "infeed"]`. Slaves that are
            in no list belong to domain 0.
    """

    name: Annotated[str, printable(DOMAIN_NAME_BYTES)] = ""
    divider: Annotated[int, integer(1, 65535)] = 1
    phase: Annotated[int, integer(0, 65534)] = 0
    slaves: Annotated[list[int], _slaves] = field(default_factory=list)


def read_domains(top: Table, key: Key) -> list[DomainConfig]:
    """Reads all `[[domain]]` tables, domain 0 first."""
    rows = top.tables(key)
    if len(rows) > DOMAINS_MAX:
        rows[DOMAINS_MAX].fail(None, f"is one too many: there can be {DOMAINS_MAX} domains")
    domains: list[DomainConfig] = []
    for row in rows:
        values = row.read(rules_of(DomainConfig), required=["slaves"])
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
            f"{items.show(key)} is not a slave: write a position, 0 to {POSITION_MAX}, a row such "
            f'as "5-7", or the name of a [[slave]]{known_names(items)}',
        )
    return range(first, last + 1)

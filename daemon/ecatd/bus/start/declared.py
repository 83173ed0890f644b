"""What the configuration says about entries of the process data, put into the bus description."""

from __future__ import annotations

import math
from dataclasses import replace

from ecatd.model.bus import Bus, Entry, Pdo, Slave
from ecatd.model.config import SignalConfig
from ecatd.model.datatypes import is_real, type_name, value_range
from ecatd.model.errors import ConfigError

_BITS_MAX = 64


def find_slave(bus: Bus, position: int, table: str) -> Slave:
    """The slave that a table of the configuration names.

    Raises:
        ConfigError: There is no such slave.
    """
    if position >= len(bus.slaves):
        raise ConfigError(
            f"{table}: there is no slave {position}: bus '{bus.name}' has {len(bus.slaves)} "
            f"slaves, 0 to {len(bus.slaves) - 1}"
        )
    return bus.slaves[position]


def declare_signals(bus: Bus, rules: list[SignalConfig]) -> None:
    """Gives entries the names, units, scales and ranges of the configuration.

    Raises:
        ConfigError: A rule does not fit this bus.
    """
    for rule in rules:
        slave = find_slave(bus, rule.slave, "signal")
        outputs, found = _declared(slave, slave.outputs, rule, output=True)
        inputs, also = _declared(slave, slave.inputs, rule, output=False)
        if not found and (also and (rule.minimum, rule.maximum) != (None, None)):
            raise ConfigError(
                f"signal: {rule.entry} of {slave.label} is an input: minimum and maximum are for "
                f"outputs, what is measured cannot be refused"
            )
        if not found and not also:
            raise ConfigError(
                f"signal: {slave.label} has no {rule.entry} in its process data; "
                f"`ecatctl pdos -p {slave.position}` lists what it has"
            )
        slave.outputs, slave.inputs = outputs, inputs


def _declared(
    slave: Slave, pdos: list[Pdo], rule: SignalConfig, *, output: bool
) -> tuple[list[Pdo], bool]:
    """The PDOs with what the rule says, as new ones: slaves may share theirs."""
    found = False
    result = []
    for pdo in pdos:
        entries = list(pdo.entries)
        for at, entry in enumerate(entries):
            if not entry.is_gap and (entry.index, entry.subindex) == rule.address:
                entries[at] = _apply(slave, entry, rule, output=output)
                found = True
        result.append(replace(pdo, entries=entries))
    return result, found


def _apply(slave: Slave, entry: Entry, rule: SignalConfig, *, output: bool) -> Entry:
    where = f"signal: {entry.address} of {slave.label}"
    if entry.bit_length > _BITS_MAX:
        raise ConfigError(
            f"{where} has {entry.bit_length} bits: only entries of up to {_BITS_MAX} are signals"
        )
    declared = replace(
        entry,
        name=rule.name or entry.name,
        unit=rule.unit,
        scale=rule.scale,
        offset=rule.offset,
        minimum=rule.minimum if output else None,
        maximum=rule.maximum if output else None,
    )
    low, high = declared.raw_range()
    least, most = _type_range(entry)
    if max(low, least) > min(high, most):
        raise ConfigError(
            f"{where} can have no value from {_limit(rule.minimum)} to {_limit(rule.maximum)}: "
            f"it is {type_name(entry.data_type)} with scale "
            f"{rule.scale:g} and offset {rule.offset:g}"
        )
    return declared


def _type_range(entry: Entry) -> tuple[float, float]:
    if is_real(entry.data_type):
        return -math.inf, math.inf
    return value_range(entry.data_type, entry.bit_length)


def _limit(value: float | None) -> str:
    return "any" if value is None else f"{value:g}"

"""Puts the meanings of values (names, units, scales, limits) into the description of a bus.

The configuration (`[[signal]]`) takes precedence over device profiles, and these over the names
that the slave has. No other module decides what a value means: shared memory, clients, Zenoh,
generated blocks and FMUs take the meaning from the description, or compare their own with it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

from ecatd.base.errors import ConfigError, UsageError
from ecatd.description.bus import Bus, Slave
from ecatd.etg.datatypes import STRINGS, bit_length, is_real, parse_type, type_name, value_range
from ecatd.etg.pdo import Entry, Pdo, Value

from . import SignalConfig, SlaveConfig
from .problems import AT_ONCE, Problems
from .profiles import DeviceProfile, Profiles

_NAMED = 4  # entries in one message
_BITS_MAX = 64  # longest entry that can be a signal in the shared memory


def give_meanings(
    bus: Bus,
    profiles: Profiles,
    rules: Sequence[SignalConfig] = (),
    startup: Collection[tuple[int, tuple[int, int]]] = (),
    problems: Problems = AT_ONCE,
) -> Bus:
    """Gives the entries their names, units, scales, limits and named values, as far as known.

    Args:
        bus: The scanned bus; its slaves are changed in place.
        profiles: Device profiles.
        rules: `[[signal]]` tables of the configuration, which take precedence.
        startup: Slave and address of the start-up parameters. A rule may be about one of them, even
            if it is not in the process data.
        problems: Takes the problems of rules.

    Returns:
        The same bus.

    Raises:
        ConfigError: A rule does not fit this bus, or an entry has no value within its limits.
    """
    for slave in bus.slaves:
        _apply_profiles(slave, profiles.of(slave))
    for rule in rules:
        with problems:
            written = (rule.slave, rule.address) in startup
            _apply_rule(bus.slaves[rule.slave], rule, written=written)
    return bus


def without_meanings(bus: Bus) -> Bus:
    """Removes what `give_meanings` adds to a bus, except names; returns the same bus."""
    for slave in bus.slaves:
        slave.profiles = []
        slave.outputs = _changed(slave.outputs, _raw)
        slave.inputs = _changed(slave.inputs, _raw)
    return bus


def _raw(entry: Entry) -> Entry:
    return Entry(entry.index, entry.subindex, entry.name, entry.data_type, entry.bit_length)


def object_meaning(
    slave: Slave, entry: Entry, profiles: Profiles, rules: Sequence[SignalConfig]
) -> Entry:
    """The meaning of an object that is written, even if it is not in the process data.

    Args:
        slave: The slave; its PDOs decide which profiles fit.
        entry: The object.
        profiles: Device profiles.
        rules: `[[signal]]` tables of the configuration, which take precedence.

    Raises:
        ConfigError: The object can have no value within its limits.
    """
    _, known = _profiled(slave, entry, profiles.of(slave), output=True)
    for rule in rules:
        if (rule.slave, rule.address) == (slave.position, (entry.index, entry.subindex)):
            known = _declared(slave, known, rule, output=True)
    return known


def raw_parameters(
    settings: SlaveConfig,
    slave: Slave,
    profiles: Profiles,
    rules: Sequence[SignalConfig],
    problems: Problems = AT_ONCE,
) -> SlaveConfig:
    """Makes the physical values of the start-up parameters of a slave raw.

    Args:
        settings: The table of the slave in the configuration.
        slave: As in `object_meaning`.
        profiles: Device profiles.
        rules: `[[signal]]` tables of the configuration.
        problems: Takes the problems of parameters.

    Raises:
        ConfigError: The unit of a parameter is unknown, or its value does not fit.
    """
    startup = []
    for item in settings.startup:
        with problems:
            known = object_meaning(slave, item.entry, profiles, rules) if item.unit else item.entry
            try:
                startup.append(item.raw(known))
            except UsageError as error:
                item.table.fail("value", f"{slave.label}: {error}")
    return replace(settings, startup=startup)


def unused_profiles(bus: Bus, profiles: Profiles) -> list[str]:
    """Warnings about profiles that fit no slave, if the configuration names their folder."""
    return [
        f"{device.source}: '{device.name.description}' fits no slave of bus '{bus.name}': it is "
        f"about {device.wanted}"
        for device in profiles.devices[: profiles.named]
        if not any(device.fits(slave) for slave in bus.slaves)
    ]


def _apply_profiles(slave: Slave, devices: list[DeviceProfile]) -> None:
    used: list[DeviceProfile] = []

    def meant(entry: Entry, *, output: bool) -> Entry:
        device, known = _profiled(slave, entry, devices, output=output)
        if device is not None and device not in used:
            used.append(device)
        return known

    slave.outputs = _changed(slave.outputs, lambda entry: meant(entry, output=True))
    slave.inputs = _changed(slave.inputs, lambda entry: meant(entry, output=False))
    slave.profiles = [device.name for device in used]


def _profiled(
    slave: Slave, entry: Entry, devices: list[DeviceProfile], *, output: bool
) -> tuple[DeviceProfile | None, Entry]:
    """The profile that knows an entry, and the entry as it describes it."""
    for device in devices:
        meaning = device.meaning(entry)
        if meaning is None or entry.bit_length > _BITS_MAX:
            continue
        known = replace(_raw(entry), **meaning)
        known.name = known.name or entry.name
        known.values = list(known.values)
        if not output:
            known.minimum = known.maximum = None
        _check_limits(known, f"{device.source}: {entry.address} of {slave.label}")
        return device, known
    return None, entry


def _changed(pdos: list[Pdo], change: Callable[[Entry], Entry]) -> list[Pdo]:
    """Returns copies of PDOs with changed entries; the originals may belong to several slaves."""
    return [
        replace(pdo, entries=[entry if entry.is_gap else change(entry) for entry in pdo.entries])
        for pdo in pdos
    ]


def _apply_rule(slave: Slave, rule: SignalConfig, *, written: bool) -> None:
    found = {True: False, False: False}

    def meant(entry: Entry, *, output: bool) -> Entry:
        if (entry.index, entry.subindex) != rule.address:
            return entry
        found[output] = True
        return _declared(slave, entry, rule, output=output)

    outputs = _changed(slave.outputs, lambda entry: meant(entry, output=True))
    inputs = _changed(slave.inputs, lambda entry: meant(entry, output=False))
    if found[False] and not found[True] and (rule.minimum, rule.maximum) != (None, None):
        rule.table.fail(
            "minimum" if rule.maximum is None else "maximum",
            f"{rule.entry} of {slave.label} is an input: minimum and maximum are for outputs, "
            "since a measured value cannot be refused; leave them out",
        )
    if not any(found.values()) and not written:
        rule.table.fail(
            "entry",
            f"{slave.label} has no {rule.entry} in its process data; "
            f"`ecatctl pdos {slave.position}` lists what it has",
        )
    slave.outputs, slave.inputs = outputs, inputs


def _declared(slave: Slave, entry: Entry, rule: SignalConfig, *, output: bool) -> Entry:
    if entry.bit_length > _BITS_MAX:
        rule.table.fail(
            "entry",
            f"{entry.address} of {slave.label} has {entry.bit_length} bits, but only entries of up "
            f"to {_BITS_MAX} are signals: remove the table",
        )
    known = replace(entry, name=rule.name or entry.name)
    if rule.type:
        known.data_type = _typed(slave, entry, rule)
    if rule.is_scaled:  # the profile gives its limits in its own unit
        known = replace(rule.scaled(known), minimum=None, maximum=None)
    if rule.values:
        known.values = [Value(int(number), name) for number, name in rule.values.items()]
    if output and rule.minimum is not None:
        known.minimum = rule.minimum
    if output and rule.maximum is not None:
        known.maximum = rule.maximum
    limit = "minimum" if rule.maximum is None else "maximum"
    _check_limits(known, f"{rule.table.where(limit)}: {entry.address} of {slave.label}")
    return known


def _typed(slave: Slave, entry: Entry, rule: SignalConfig) -> int:
    kind = parse_type(rule.type or "")
    size, bits = bit_length(kind), entry.bit_length
    if size != bits if is_real(kind) else size < bits:
        rule.table.fail(
            "type",
            f"{entry.address} of {slave.label} has {bits} bits, but {type_name(kind)} has {size}: "
            f"choose a type of {bits} bits",
        )
    return kind


def unknown_types(
    slave: Slave,
    guessed: Collection[tuple[int, int]],
    configured: Collection[tuple[int, int]] = (),
) -> list[str]:
    """Says which entries have a type that nobody tells, or one that their bits cannot have.

    Args:
        slave: The slave, before `give_meanings`.
        guessed: Index and subindex of entries whose type nobody tells.
        configured: Those of entries whose type the configuration tells.
    """
    entries = [
        entry
        for pdo in (*slave.outputs, *slave.inputs)
        for entry in pdo.entries
        if not entry.is_gap
        and 1 < entry.bit_length <= _BITS_MAX
        and (entry.index, entry.subindex) not in configured
    ]
    unknown = [e.address for e in entries if (e.index, e.subindex) in guessed]
    odd = [
        f"{e.address} is {type_name(e.data_type)}, but has {e.bit_length} bits"
        for e in entries
        if (e.index, e.subindex) not in guessed
        and (
            e.data_type in STRINGS
            or (is_real(e.data_type) and bit_length(e.data_type) != e.bit_length)
        )
    ]
    remedy = (
        'write type, such as "int16", into a [[signal]] table, or have `ecatctl config init --esi '
        "FILE` write it"
    )
    texts = []
    if unknown:
        texts.append(
            f"{slave.label} does not tell the type of {_some(unknown)}, so unsigned numbers are "
            f"read: if they are others, {remedy}"
        )
    if odd:
        texts.append(f"{slave.label}: {_some(odd)}, so unsigned numbers are read: {remedy}")
    return texts


def _some(texts: list[str]) -> str:
    more = len(texts) - _NAMED
    return ", ".join(texts[:_NAMED]) + (f" and {more} more" if more > 0 else "")


def _check_limits(entry: Entry, where: str) -> None:
    """Checks that the entry can have a value within its limits.

    Raises:
        ConfigError: It cannot have such a value.
    """
    if entry.minimum is None and entry.maximum is None:
        return
    if entry.minimum is not None and entry.maximum is not None and entry.minimum > entry.maximum:
        raise ConfigError(
            f"{where} has the minimum {entry.minimum:g}, which is more than the maximum, "
            f"{entry.maximum:g}: correct one of them"
        )
    low, high = entry.raw_range()
    least, most = _type_range(entry)
    if max(low, least) > min(high, most):
        raise ConfigError(
            f"{where} can have no value from {_limit(entry.minimum)} to {_limit(entry.maximum)}: "
            f"it is {type_name(entry.data_type)} with scale {entry.scale:g} and offset "
            f"{entry.offset:g}; correct the limits, or the scale"
        )


def _type_range(entry: Entry) -> tuple[float, float]:
    if is_real(entry.data_type):
        return -math.inf, math.inf
    return value_range(entry.data_type, entry.bit_length)


def _limit(value: float | None) -> str:
    return "any" if value is None else f"{value:g}"

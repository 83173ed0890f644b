"""Says what of a new configuration can be used without a restart."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from .config import Config
from .differences import differences
from .origins import Origin, Origins, flatten
from .signals import SignalConfig

_SIGNAL_KEY = re.compile(r"signal\[(\d+)\](.*)")


@dataclass(frozen=True, slots=True)
class Reload:
    """What becomes of a new configuration.

    Attributes:
        config: The configuration that is in force from now on.
        wanted: The new configuration.
        used: Keys that have changed in it.
        later: Keys that have changed in the new one, and need a restart.
        signals: For each `[[signal]]` table in force, whether the new configuration has one like
            it, and its number there; else the number in the configuration before.
    """

    config: Config
    wanted: Config
    used: list[str]
    later: list[str]
    signals: list[tuple[bool, int]]

    def origins(self, before: Origins, wanted: Origins) -> dict[str, Origin]:
        """Where the keys in force are written.

        Args:
            before: Where those of the configuration before are written, see `find_origins`.
            wanted: Where those of the new one are written.
        """
        values, new = flatten(self.config.to_dict()), flatten(self.wanted.to_dict())
        kept = {key for key, value in values.items() if new.get(key) != value}
        found = {key: place for key, place in wanted.items() if key not in kept}
        found |= {key: before[key].of_earlier_file() for key in kept & before.keys()}
        found = {key: place for key, place in found.items() if not _SIGNAL_KEY.fullmatch(key)}
        tables = {True: _by_number(wanted), False: _by_number(before)}
        for number, (is_new, place) in enumerate(self.signals):
            keys = tables[is_new].get(place, {})
            found |= {
                f"signal[{number}]{key}": where if is_new else where.of_earlier_file()
                for key, where in keys.items()
            }
        return found


def reload(before: Config, wanted: Config) -> Reload:
    """Compares a new configuration with the one in force.

    Args:
        before: The configuration in force.
        wanted: The new one.
    """
    rules = _with_limits(before, wanted)
    config = replace(
        before,
        audit_file=wanted.audit_file,
        log=wanted.log,
        flight_recorder=replace(
            wanted.flight_recorder,
            memory_mb=before.flight_recorder.memory_mb,
            folder=before.flight_recorder.folder,
        ),
        gateway=wanted.gateway,
        mailbox=wanted.mailbox,
        recovery=wanted.recovery,
        health=wanted.health,
        outputs=replace(
            before.outputs,
            lease_cycles=wanted.outputs.lease_cycles,
            lease_max_ms=wanted.outputs.lease_max_ms,
            wkc_limit=wanted.outputs.wkc_limit,
        ),
        signal=[rule for rule, _ in rules],
    )
    used = [item.key for item in differences(before, config).found]
    later = [item.key for item in differences(config, wanted).found]
    return Reload(config, wanted, used, later, [place for _, place in rules])


def _with_limits(before: Config, wanted: Config) -> list[tuple[SignalConfig, tuple[bool, int]]]:
    """The `[[signal]]` tables in force with the limits of the new ones, each as in `signals`.

    The limits of a table whose unit, scale or offset changes wait for the restart with these, since
    they are in that unit. So do all limits if other slaves are expected than before: the tables may
    be about others then.
    """
    there = {(rule.slave, rule.address): n for n, rule in enumerate(wanted.signal)}
    same_bus = _expected(before) == _expected(wanted)
    rules: list[tuple[SignalConfig, tuple[bool, int]]] = []
    for at, rule in enumerate(before.signal):
        nothing = SignalConfig(rule.slave, rule.entry)
        number = there.pop((rule.slave, rule.address), None)
        new = nothing if number is None else wanted.signal[number]
        if same_bus and _meaning(rule) == _meaning(new):
            rule = replace(rule, minimum=new.minimum, maximum=new.maximum)
        if number is not None:
            rules.append((rule, (True, number)))
        elif rule != nothing:
            rules.append((rule, (False, at)))
    for number in there.values():
        new = wanted.signal[number]
        limits = SignalConfig(new.slave, new.entry, minimum=new.minimum, maximum=new.maximum)
        if (
            same_bus
            and not new.type
            and not new.is_scaled
            and (new.minimum, new.maximum) != (None, None)
        ):
            rules.append((limits, (True, number)))
    return rules


def _expected(config: Config) -> list[tuple[object, ...]]:
    """What says which slave a table of the configuration is about."""
    return [
        (item.position, item.mark, item.group, item.optional, item.vendor, item.product)
        for item in config.slave
    ]


def _meaning(rule: SignalConfig) -> tuple[object, ...]:
    return rule.type, rule.unit, rule.scale, rule.offset


def _by_number(origins: Origins) -> dict[int, dict[str, Origin]]:
    """Where keys of `[[signal]]` tables are written, by the number of the table."""
    found: dict[int, dict[str, Origin]] = {}
    for key, where in origins.items():
        if match := _SIGNAL_KEY.fullmatch(key):
            found.setdefault(int(match[1]), {})[match[2]] = where
    return found

"""Checks that a bus has the slaves of the configuration, before any of them gets settings."""

from __future__ import annotations

from collections.abc import Iterator

from ..bus import Bus, Slave, positions_text
from ..config import Config, SlaveConfig
from ..errors import StateError
from ..problems import AT_ONCE, Problems
from ..toml_file import Table
from ..witnesses import COE


def check_slaves(config: Config, bus: Bus, problems: Problems = AT_ONCE) -> None:
    """Checks that the bus has all slaves of the configuration, and that they can take settings.

    Args:
        config: The configuration, about the slaves where they were found.
        bus: The bus.
        problems: Takes each slave that is not there, or cannot take its settings.

    Raises:
        ConfigError: A slave has no CoE or no EoE for its settings.
        StateError: A slave is not there. It may come later.
    """
    count = len(bus.slaves)
    here = f"{count} slave{'s' * (count != 1)}" + (f", 0 to {count - 1}" if count > 1 else "")
    for table, key, positions in _named(config):
        if missing := [position for position in positions if position >= count]:
            what = f"slave{'s' * (len(missing) > 1)} {positions_text(missing)}"
            with problems:
                raise StateError(
                    f"{table.where(key)}: there is no {what}: bus '{bus.name}' has {here}; correct "
                    f"the table, or check the cable and the power of the slaves"
                )
    for settings in config.slave:
        if settings.position >= count:
            continue
        slave = bus.slaves[settings.position]
        if not slave.coe:
            with problems:
                _check_without_coe(settings, slave)
        if slave.eoe and config.eoe.interface and not settings.poll_s:
            with problems:
                settings.table.fail(
                    "mailbox_poll_ms",
                    f"nobody would find the Ethernet frames of {slave.label}: leave this out, or "
                    "remove [eoe]",
                )
        if settings.eoe is not None and not slave.eoe:
            with problems:
                settings.eoe.table.fail(
                    None,
                    f"{slave.label} has no EoE, so it has no IP parameters: remove the table",
                )


def _check_without_coe(settings: SlaveConfig, slave: Slave) -> None:
    if settings.pdo_source == COE:
        settings.table.fail(
            "pdo_source",
            f'{slave.label} has no CoE: write "sii" or "configuration", or remove this',
        )
    tables = (("startup", settings.startup), ("pdo", settings.mapped), ("module", settings.module))
    for key, told in tables:
        if told:
            told[0].table.fail(
                None,
                f"{slave.label} has no CoE, so it cannot take its [[slave.{key}]]: remove "
                f"{'the table' if len(told) == 1 else f'the {len(told)} tables'}",
            )


def _named(config: Config) -> Iterator[tuple[Table, str, list[int]]]:
    """Each table and key that names slaves, and their positions."""
    for slave in config.slave:
        yield slave.table, "position", [slave.position]
    for domain in config.domain:
        yield domain.table, "slaves", sorted(domain.slaves)
    if config.dc.enabled:
        yield config.dc.table, "reference", [config.dc.reference]
        yield from ((rule.table, "slave", [rule.slave]) for rule in config.dc.slave)
    yield from ((rule.table, "slave", [rule.slave]) for rule in config.outputs.safe)
    yield from ((rule.table, "slave", [rule.slave]) for rule in config.signal)
    for copy in config.copy:
        yield copy.table, "slave", [copy.slave]
        yield copy.table, "from_slave", [copy.from_slave]

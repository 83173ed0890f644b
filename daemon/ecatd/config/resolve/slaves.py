"""Checks that a bus has the slaves of the configuration, before any of them gets settings."""

from __future__ import annotations

from collections.abc import Iterator

from ecatd.base.errors import StateError
from ecatd.base.toml_file import Table
from ecatd.description.bus import Bus, Slave, positions_text
from ecatd.description.witnesses import COE, SII, SOE, witness_name

from .. import Config, SlaveConfig
from ..problems import AT_ONCE, Problems
from .believed import usual_witness


def check_slaves(config: Config, bus: Bus, problems: Problems = AT_ONCE) -> None:
    """Checks that the bus has all slaves of the configuration, and that they can take settings.

    Args:
        config: The configuration, about the slaves where they were found.
        bus: The bus.
        problems: Takes each slave that is not there, or cannot take its settings.

    Raises:
        ConfigError: A slave has no CoE, EoE or SoE for its settings.
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
        with problems:
            _check_witness(settings, slave)
        if not slave.coe:
            with problems:
                _check_without_coe(settings, slave)
        if settings.idn and not slave.soe:
            with problems:
                settings.idn[0].table.fail(
                    None, f"{slave.label} has no SoE, so it has no IDNs: remove its [[slave.idn]]"
                )
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


def _check_witness(settings: SlaveConfig, slave: Slave) -> None:
    usual = usual_witness(slave)
    if settings.pdo_source in (COE, SOE) and settings.pdo_source != usual:
        others = f'"{usual}" or "sii"' if usual != SII else '"sii" or "configuration"'
        settings.table.fail(
            "pdo_source",
            f"{slave.label} does not describe its process data over "
            f"{witness_name(settings.pdo_source)}: write {others}, or remove this",
        )


def _check_without_coe(settings: SlaveConfig, slave: Slave) -> None:
    if slave.soe and settings.pdos is not None:
        settings.table.fail(
            "pdos",
            f"{slave.label} has no PDOs to choose, but telegrams (SoE): write their IDNs with "
            "[[slave.idn]] to S-0-0016 and S-0-0024",
        )
    pdos = settings.pdo if slave.soe else settings.mapped  # telegrams have other indices
    tables = (("startup", settings.startup), ("pdo", pdos), ("module", settings.module))
    for key, rows in tables:
        if rows:
            rows[0].table.fail(
                None,
                f"{slave.label} has no CoE, so it cannot take its [[slave.{key}]]: remove "
                f"{'the table' if len(rows) == 1 else f'the {len(rows)} tables'}",
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

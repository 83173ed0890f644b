"""Compares the watchdog of a slave with the configuration and the cycle of its domain."""

from __future__ import annotations

from ecatd.description.bus import Bus, Slave

from .. import Config, SlaveConfig


def check_watchdog(config: Config, bus: Bus, slave: Slave) -> str:
    """Checks the process data watchdog of a slave.

    Args:
        config: The configuration, about the slaves where they were found.
        bus: The bus, with its domains.
        slave: The slave. There is no check if its `watchdog_ms` is not known.

    Returns:
        A warning if one lost exchange is too many, or if the watchdog is off. Else an empty text.

    Raises:
        ConfigError: The watchdog expires between two exchanges, or is off in a slave whose identity
            the configuration knows, without being switched off there.
    """
    if slave.watchdog_ms is None:
        return ""
    if not slave.watchdog_ms:
        return _check_off(slave, config.settings_of(slave.position))
    cycle_ms = config.cycle_time_us * bus.domains[slave.domain].divider / 1000
    if slave.watchdog_ms > 2 * cycle_ms:
        return ""
    facts = (
        f"{bus.domain_label(slave.domain)} is exchanged every {cycle_ms:g} ms, but the "
        f"watchdog of {slave.label} waits {slave.watchdog_ms:g} ms for outputs"
    )
    remedy = (
        "choose a smaller divider or cycle_time_us, another domain for this slave, or a longer "
        "watchdog_ms in its [[slave]] table"
    )
    if slave.watchdog_ms <= cycle_ms:
        slow = bus.domains[slave.domain].divider > 1
        settings = config.settings_of(slave.position)
        table, key = (
            (settings.table, "watchdog_ms")
            if settings.watchdog_ms is not None
            else (config.domain[slave.domain].table, "divider")
            if slow
            else (config.table, "cycle_time_us")
        )
        table.fail(key, f"{facts}, so it would not stay in OP: {remedy}")
    return f"{facts}: one lost exchange takes it out of OP; {remedy}"


def _check_off(slave: Slave, settings: SlaveConfig) -> str:
    if settings.watchdog_ms == 0:
        return ""
    text = (
        f"{slave.label}: its watchdog is off, so its outputs keep their values if ecatd dies or a "
        "cable breaks: write watchdog_ms = 100 into its [[slave]] table, or watchdog_ms = 0 if "
        "it is off on purpose"
    )
    if settings.product is not None:
        settings.table.fail("watchdog_ms", text)
    return text

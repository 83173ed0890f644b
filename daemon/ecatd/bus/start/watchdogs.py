"""Sets the watchdogs of the slaves, and checks them (ETG.1000.4, registers 0x0400 to 0x0420).

A slave leaves OP if it gets no outputs for longer than its process data watchdog allows: sync
manager control bit 6 switches it on for a sync manager, and register 0x0420 holds the time. In a
domain slower than its watchdog, a slave would leave OP every time. Without a watchdog, outputs keep
their values if the master dies.
"""

from __future__ import annotations

from collections.abc import Sequence

from ecatd.model.bus import Bus, Slave
from ecatd.model.config import Config, SlaveConfig
from ecatd.model.errors import StateError

from ..master.master import Master
from .mapping import Scanned
from .watchdog_registers import DIVIDER, PDI_TIME, TIME, WATCHED, ticks

_TICK_NS = 40  # of the divider, which counts from 2


def check_watchdogs(
    master: Master, bus: Bus, scanned: Sequence[Scanned], config: Config
) -> list[str]:
    """Checks the watchdogs of configured slaves against the configuration and the cycles.

    Returns:
        Warnings: one lost exchange is too many for a slave, or its watchdog is off.

    Raises:
        ConfigError: A watchdog expires between two exchanges, or is off in a slave whose identity
            the configuration knows, without being switched off there.
        StateError: A slave does not take the configured time.
    """
    registers = [
        (item.slave.position, at, 2) for item in scanned for at in (DIVIDER, PDI_TIME, TIME)
    ]
    values = [int.from_bytes(data, "little") for data in master.read_registers(registers)]
    warnings = []
    for number, item in enumerate(scanned):
        divider, pdi, time = values[3 * number : 3 * number + 3]
        _check_taken(item, pdi, time)
        if not any(pdo.bit_length for pdo in item.slave.outputs):
            continue
        patience_ns = (divider + 2) * _TICK_NS * time if _is_watched(item) else 0
        item.slave.watchdog_ms = patience_ns / 1e6
        if patience_ns:
            text = _check_cycle(bus, item.slave, patience_ns, config)
        else:
            text = _check_off(item.slave, item.settings)
        warnings += [text] if text else []
    return warnings


def _check_taken(item: Scanned, pdi: int, time: int) -> None:
    """Compares the times in a slave with the configured ones."""
    for key, register, now in (("watchdog_ms", TIME, time), ("pdi_watchdog_ms", PDI_TIME, pdi)):
        wanted = getattr(item.settings, key)
        if wanted is not None and ticks(wanted) != now:
            where = item.settings.table.where(key)
            raise StateError(
                f"{where}: {item.slave.label} does not take {wanted:g} ms: its register "
                f"0x{register:04X} is {now} after {ticks(wanted)} was written; remove the key"
            )


def _check_off(slave: Slave, settings: SlaveConfig) -> str:
    if settings.watchdog_ms == 0:
        return ""
    text = (
        f"{slave.label}: its watchdog is off, so its outputs keep their values if ecatd dies or a "
        f"cable breaks: write watchdog_ms = 100 into its [[slave]] table, or watchdog_ms = 0 if "
        "that is meant"
    )
    if settings.product is not None:
        settings.table.fail("watchdog_ms", text)
    return text


def _check_cycle(bus: Bus, slave: Slave, patience_ns: int, config: Config) -> str:
    """Compares the cycle of a slave's domain with its watchdog; returns a warning or nothing."""
    cycle_ns = bus.cycle_time_us * 1000 * bus.domains[slave.domain].divider
    if patience_ns > 2 * cycle_ns:
        return ""
    facts = (
        f"{bus.domain_label(slave.domain)} is exchanged every {cycle_ns / 1e6:g} ms, but the "
        f"watchdog of {slave.label} waits {patience_ns / 1e6:g} ms for outputs"
    )
    remedy = (
        "choose a smaller divider or cycle_time_us, another domain for this slave, or a longer "
        "watchdog_ms in its [[slave]] table"
    )
    if patience_ns <= cycle_ns:
        slow = bus.domains[slave.domain].divider > 1
        table, key = (
            (config.domain[slave.domain].table, "divider")
            if slow
            else (config.table, "cycle_time_us")
        )
        table.fail(key, f"{facts}, so it would not stay in OP: {remedy}")
    return f"{facts}: one lost exchange takes it out of OP; {remedy}"


def _is_watched(item: Scanned) -> bool:
    managers = item.sii.sync_managers
    return bool(item.settings.watchdog_ms) or any(
        pdo.bit_length
        and pdo.sync_manager < len(managers)
        and managers[pdo.sync_manager].control & WATCHED
        for pdo in item.slave.outputs
    )

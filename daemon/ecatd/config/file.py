"""Reads the whole configuration, and checks what several tables say together."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from ipaddress import IPv4Address, IPv4Interface
from pathlib import Path
from typing import Any

from ecatd.base.toml_file import Document, Table, read_toml
from ecatd.etg.eoe import parse_mac

from .clocks import SYNC_MAX_US
from .config import Config
from .placed import read
from .ros import check_router


def read_config(
    data: dict[str, Any],
    source: str = "configuration",
    origins: Mapping[str, str] | None = None,
) -> Config:
    """Reads the configuration from maps, as `Config.to_dict` makes them.

    Args:
        data: The maps.
        source: Their origin, for messages.
        origins: The origin of each key, as far as it is known, see `find_origins`.

    Raises:
        ConfigError: A key or a value is wrong.
    """
    return _read(Table(Document(source, origins=origins), data))


def load_config(file: Path) -> Config:
    """Reads and checks a file; paths in it are relative to its folder.

    Raises:
        ConfigError: The file cannot be read, is no valid TOML, or has a wrong key or value.
    """
    config = _read(read_toml(file))
    config.profiles = [str(file.parent / folder) for folder in config.profiles]
    if config.expected.description:
        config.expected.description = str(file.parent / config.expected.description)
    return config


def _read(top: Table) -> Config:
    config = read(Config, top)
    if config.second_interface and config.second_interface == config.interface:
        top.fail(
            "second_interface",
            f"is '{config.interface}' like interface: the cable from the last slave back to "
            f"this computer needs an interface of its own",
        )
    check_clocks(top, config)
    check_eoe(top, config)
    check_physical(top, config)
    check_router(config.ros, config.gateway)
    return config


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
        if sync0 > SYNC_MAX_US * 1000:
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


def check_eoe(top: Table, config: Config) -> None:
    """Checks that the interface for EoE and the IP parameters of the slaves fit each other.

    Raises:
        ConfigError: They do not.
    """
    own = config.eoe
    if own.interface and own.interface in ("lo", config.interface, config.second_interface):
        own.table.fail("interface", f"'{own.interface}' is another interface: choose a new name")
    network = IPv4Interface(own.address).network if own.address else None
    places = {own.address.partition("/")[0]: "this computer"} if own.address else {}
    for slave in config.slave:
        if slave.eoe is None:
            continue
        table, label = slave.eoe.table, slave.name or f"slave {slave.position}"
        if slave.eoe.address:
            address = IPv4Interface(slave.eoe.address)
            if network is not None and address.network != network:
                table.fail(
                    "address",
                    f"is not in the network of the interface, {network}: choose another one",
                )
            if other := places.get(str(address.ip)):
                table.fail(
                    "address", f"{address.ip} is the address of {other}, too: choose another one"
                )
            places[str(address.ip)] = label
            gateway = slave.eoe.gateway and IPv4Address(slave.eoe.gateway)
            if gateway and (gateway not in address.network or gateway == address.ip):
                table.fail("gateway", f"must be another device of {address.network}")
        if mac := slave.eoe.mac and parse_mac(slave.eoe.mac):
            if other := places.get(mac):
                table.fail("mac", f"{mac} is the MAC address of {other}, too: choose another one")
            places[mac] = label


def check_physical(top: Table, config: Config) -> None:
    """Checks the physical values of parameters whose unit and scale a `[[signal]]` gives.

    Those that a device profile knows are checked when the bus starts.

    Raises:
        ConfigError: A value does not fit.
    """
    rules = {(rule.slave, rule.address): rule for rule in config.signal if rule.is_scaled}
    for row, slave in zip(top.tables("slave"), config.slave, strict=True):
        for table, parameter in zip(row.tables("startup"), slave.startup, strict=True):
            rule = rules.get((slave.position, parameter.address))
            if rule is not None and parameter.unit is not None:
                known = rule.scaled(parameter.entry)
                table.explain("value", partial(parameter.raw, known))

"""Reads the whole configuration: keys at the top and small tables here, others in other modules."""

from __future__ import annotations

import ipaddress
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..bus_name import check_bus_name
from ..toml_file import Document, Key, Rules, Table, array, choice, integer, number, read_toml, show
from .copies import read_copies
from .outputs import read_outputs
from .signals import read_signals
from .slave_settings import check_physical, read_expected, read_slaves
from .slaves import check_clocks, read_clocks, read_domains
from .tables import (
    LOG_LEVELS,
    RECOVERY_MODES,
    Config,
    GatewayConfig,
    MailboxConfig,
    RealTimeConfig,
    RecoveryConfig,
)

_INTERFACE_BYTES = 15


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


def _bus(table: Table, key: Key) -> str:
    return table.explain(key, lambda: check_bus_name(table.text(key)))


def _interface(table: Table, key: Key) -> str:
    name = table.text(key)
    if len(name.encode("utf-8", "replace")) > _INTERFACE_BYTES:
        table.fail(key, f"an interface name has at most {_INTERFACE_BYTES} characters")
    return name


def _folder(table: Table, key: Key) -> str:
    folder = table.text(key)
    if not folder or not folder.isprintable():
        table.fail(key, f"{show(folder)} is no folder: write its path in quotes")
    return folder


_SOCKET_PATH_MAX = len("unix:") + 107  # of a Unix socket in Linux


def _endpoint(table: Table, key: Key) -> str:
    endpoint = table.text(key)
    if "/" not in endpoint:
        table.fail(key, f'{show(endpoint)} is no Zenoh endpoint: write one as "tcp/127.0.0.1:7447"')
    return endpoint


def _is_loopback(host: str) -> bool:
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _metrics_address(table: Table, key: Key) -> str:
    text = table.text(key)
    if not text or (text.startswith("unix:/") and len(text) <= _SOCKET_PATH_MAX):
        return text
    host, _, port = text.rpartition(":")
    if not port.isascii() or not port.isdecimal() or not 0 < int(port) < 1 << 16:
        table.fail(
            key,
            f'{show(text)} is no address: write "127.0.0.1:9754", or '
            f'"unix:/run/ecatd/ecat0/gateway/metrics"',
        )
    if not _is_loopback(host.strip("[]")):
        table.fail(
            key,
            f"{show(text)} can be reached from other machines, and everybody may read metrics: use "
            f"127.0.0.1, and a proxy that knows users where others are to read them",
        )
    return text


_REALTIME: Rules = {
    "priority": integer(0, 98),
    "cpu": integer(-1, 1023),
    "lock_memory": Table.boolean,
    "busy_receive": Table.boolean,
    "poll_us": integer(0, 1000),
    "dma_latency_us": integer(-1, 1_000_000),
}
_MAILBOX: Rules = {"share": number(0.01, 1)}
_RECOVERY: Rules = {
    "slaves": choice({mode: mode for mode in RECOVERY_MODES}),
    "retry_s": number(0.1, 3600),
}
_GATEWAY: Rules = {
    "listen": array(_endpoint),
    "publish_hz": number(0, 1000),
    "metrics": _metrics_address,
}
_TOP: Rules = {
    "bus": _bus,
    "interface": _interface,
    "second_interface": _interface,
    "cycle_time_us": integer(100, 1_000_000),
    "state_timeout_s": number(0.1, 300),
    "log_level": choice({level: level for level in LOG_LEVELS}),
    "profiles": array(_folder),
    "expected": read_expected,
    "slave": read_slaves,  # before all that name slaves
    "domain": read_domains,
    "dc": read_clocks,
    "mailbox": lambda top, key: MailboxConfig(**top.table(key).read(_MAILBOX)),
    "recovery": lambda top, key: RecoveryConfig(**top.table(key).read(_RECOVERY)),
    "realtime": lambda top, key: RealTimeConfig(**top.table(key).read(_REALTIME)),
    "outputs": read_outputs,
    "signal": read_signals,
    "copy": read_copies,
    "gateway": lambda top, key: GatewayConfig(**top.table(key).read(_GATEWAY)),
}


def _read(top: Table) -> Config:
    config = Config(**top.read(_TOP), table=top)
    if config.second_interface and config.second_interface == config.interface:
        top.fail(
            "second_interface",
            f"is '{config.interface}' like interface: the cable from the last slave back to "
            f"this computer needs an interface of its own",
        )
    check_clocks(top, config)
    check_physical(top, config)
    return config

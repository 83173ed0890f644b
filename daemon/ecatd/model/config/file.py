"""Reads the whole configuration: keys at the top and small tables here, others in other modules."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..bus_name import check_bus_name
from ..log_levels import DEFAULTS, LEVELS, OTHERS, PARTS
from ..toml_file import Document, Key, Rules, Table, array, choice, integer, number, read_toml, show
from .checks import check_clocks, check_eoe, check_physical
from .clocks import read_clocks
from .config import (
    RECOVERY_MODES,
    CaptureConfig,
    Config,
    MailboxConfig,
    RealTimeConfig,
    RecoveryConfig,
)
from .copies import read_copies
from .domains import read_domains
from .eoe import read_eoe
from .gateway import read_gateway
from .interface import read_interface
from .outputs import read_outputs
from .signals import read_signals
from .slave_settings import read_expected, read_slaves


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


def _folder(table: Table, key: Key) -> str:
    folder = table.text(key)
    if not folder or not folder.isprintable():
        table.fail(key, f"{show(folder)} is no folder: write its path in quotes")
    return folder


def _capture_folder(table: Table, key: Key) -> str:
    folder = table.text(key)
    if folder and not (folder.startswith("/") and folder.isprintable()):
        table.fail(key, f'{show(folder)} is no folder: write its whole path, "/var/lib/ecatd"')
    return folder


def _audit_file(table: Table, key: Key) -> str:
    path = table.text(key)
    if path and not (path.startswith("/") and path.isprintable()):
        table.fail(key, f'{show(path)} is no file: write its whole path, "/var/log/ecatd/audit"')
    return path


def _capture(top: Table, key: Key) -> CaptureConfig:
    table = top.table(key)
    return CaptureConfig(**table.read(_CAPTURE), table=table)


_REALTIME: Rules = {
    "priority": integer(0, 98),
    "cpu": integer(-1, 1023),
    "lock_memory": Table.boolean,
    "busy_receive": Table.boolean,
    "poll_us": integer(0, 1000),
    "dma_latency_us": integer(-1, 1_000_000),
}
_LOG: Rules = {key: choice({level: level for level in LEVELS}) for key in (OTHERS, *PARTS)}
_MAILBOX: Rules = {"share": number(0.01, 1)}
_RECOVERY: Rules = {
    "slaves": choice({mode: mode for mode in RECOVERY_MODES}),
    "retry_s": number(0.1, 3600),
}
_CAPTURE: Rules = {
    "memory_mb": integer(0, 1024),
    "folder": _capture_folder,
    "keep": integer(1, 1000),
}
_TOP: Rules = {
    "bus": _bus,
    "interface": read_interface,
    "second_interface": read_interface,
    "cycle_time_us": integer(100, 1_000_000),
    "state_timeout_s": number(0.1, 300),
    "audit_file": _audit_file,
    "log": lambda top, key: {**DEFAULTS, **top.table(key).read(_LOG)},
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
    "capture": _capture,
    "eoe": read_eoe,
    "gateway": read_gateway,
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
    check_eoe(top, config)
    check_physical(top, config)
    return config

"""Reads a whole file: its top, small tables here, larger ones in modules of their own."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from ..errors import UsageError
from .outputs import read_outputs
from .reader import Reader, Rules, file_text, parse_toml
from .signals import read_signals
from .slaves import POSITION_MAX, SYNC_MAX_US, check_clocks, read_domains
from .tables import (
    RECOVERY_MODES,
    Config,
    DcConfig,
    DcSlaveConfig,
    GatewayConfig,
    MailboxConfig,
    RealTimeConfig,
    RecoveryConfig,
)

BUS_NAME = re.compile(r"[A-Za-z0-9_-]{1,31}")

_TOP: Rules = {
    "bus": (str, 0, 0),
    "interface": (str, 0, 0),
    "second_interface": (str, 0, 0),
    "cycle_time_us": (int, 100, 1_000_000),
    "state_timeout_s": (float, 0.1, 300),
    "profiles": (list, 0, 0),
    "domain": (list, 0, 0),
    "dc": (dict, 0, 0),
    "mailbox": (dict, 0, 0),
    "recovery": (dict, 0, 0),
    "realtime": (dict, 0, 0),
    "outputs": (dict, 0, 0),
    "signal": (list, 0, 0),
    "gateway": (dict, 0, 0),
}
_REALTIME: Rules = {
    "priority": (int, 0, 98),
    "cpu": (int, -1, 1023),
    "lock_memory": (bool, 0, 0),
    "busy_receive": (bool, 0, 0),
    "poll_us": (int, 0, 1000),
    "dma_latency_us": (int, -1, 1_000_000),
}
_DC: Rules = {
    "enabled": (bool, 0, 0),
    "reference": (int, -1, POSITION_MAX),
    "phase_us": (float, 0, 1_000_000),
    "lock_us": (float, 0.1, 500_000),
    "timeout_s": (float, 0.1, 300),
    "slave": (list, 0, 0),
}
_DC_SLAVE: Rules = {
    "slave": (int, 0, POSITION_MAX),
    "sync0_us": (float, 0, SYNC_MAX_US),
    "shift_us": (float, -SYNC_MAX_US, SYNC_MAX_US),
    "sync1_us": (float, 0, SYNC_MAX_US),
}
_MAILBOX: Rules = {"share": (float, 0.01, 1)}
_RECOVERY: Rules = {"slaves": (str, 0, 0), "retry_s": (float, 0.1, 3600)}
_GATEWAY: Rules = {"listen": (list, 0, 0), "publish_hz": (float, 0, 1000)}


def read_config(data: dict[str, Any], source: str = "configuration") -> Config:
    """The configuration in maps, as `Config.to_dict` makes them.

    Args:
        data: The maps.
        source: How messages name where they come from.

    Raises:
        ConfigError: A key or a value is wrong.
    """
    return _read(Reader(source, "", _TOP), data)


def load_config(file: Path) -> Config:
    """Reads and checks a file; paths in it are relative to its folder.

    Raises:
        ConfigError: The file cannot be read, is no TOML, or has a wrong key or value.
    """
    text = file_text(file)
    reader = Reader(str(file), text, _TOP)
    config = parse_toml(text, str(file), lambda data: _read(reader, data))
    config.profiles = [str(file.parent / folder) for folder in config.profiles]
    return config


def check_bus_name(name: str) -> str:
    """The name, if a bus can have it.

    Raises:
        UsageError: It cannot.
    """
    if not BUS_NAME.fullmatch(name):
        raise UsageError(f"'{name}' is no bus name: use 1 to 31 letters, digits, '_' or '-'")
    return name


def _read(reader: Reader, data: dict[str, Any]) -> Config:
    top = reader.check(data, _TOP, "")
    if not BUS_NAME.fullmatch(top.get("bus", "ecat0")):
        reader.fail(
            "", "bus", f"{top['bus']!r} is no bus name: use 1 to 31 letters, digits, _ or -"
        )
    for folder in top.get("profiles", []):
        if not isinstance(folder, str) or not folder.isprintable() or not folder:
            reader.fail("", "profiles", f"{folder!r} is no folder: write its path in quotes")
    tables: dict[str, Any] = {
        "outputs": read_outputs(reader, top.pop("outputs", {})),
        "signal": read_signals(reader, top.pop("signal", [])),
        "gateway": _gateway(reader, top.pop("gateway", {})),
        "realtime": RealTimeConfig(**_table(reader, top, _REALTIME, "realtime")),
        "mailbox": MailboxConfig(**_table(reader, top, _MAILBOX, "mailbox")),
        "recovery": _recovery(reader, top),
        "dc": _clocks(reader, top.pop("dc", {})),
        "domain": read_domains(reader, top.pop("domain", [])),
    }
    config = Config(**top, **tables)
    _check_interfaces(reader, config)
    check_clocks(reader, config)
    return config


def _recovery(reader: Reader, top: dict[str, Any]) -> RecoveryConfig:
    recovery = RecoveryConfig(**_table(reader, top, _RECOVERY, "recovery"))
    if recovery.slaves not in RECOVERY_MODES:
        modes = ", ".join(f'"{mode}"' for mode in RECOVERY_MODES)
        reader.fail("recovery", "slaves", f"{recovery.slaves!r} is none of {modes}")
    return recovery


def _table(reader: Reader, top: dict[str, Any], rules: Rules, name: str) -> dict[str, Any]:
    return reader.check(top.pop(name, {}), rules, name)


def _gateway(reader: Reader, data: dict[str, Any]) -> GatewayConfig:
    values = reader.check(data, _GATEWAY, "gateway")
    for endpoint in values.get("listen", []):
        if not isinstance(endpoint, str) or "/" not in endpoint:
            reader.fail(
                "gateway",
                "listen",
                f'{endpoint!r} is no Zenoh endpoint such as "tcp/127.0.0.1:7447"',
            )
    return GatewayConfig(**values)


def _clocks(reader: Reader, data: dict[str, Any]) -> DcConfig:
    values = reader.check(data, _DC, "dc")
    slaves = list(reader.rows(values.pop("slave", []), _DC_SLAVE, "dc.slave"))
    for row, slave in slaves:
        reader.need(slave, "slave", "dc.slave", row)
    if not slaves and "enabled" not in values:
        for key, value in values.items():
            if value != getattr(DcConfig(), key):
                reader.fail(
                    "dc",
                    key,
                    "does nothing, since no clock is synchronised: add enabled = true, or a "
                    "[[dc.slave]]",
                )
    values.setdefault("enabled", bool(slaves))
    return DcConfig(**values, slave=[DcSlaveConfig(**slave) for _, slave in slaves])


def _check_interfaces(reader: Reader, config: Config) -> None:
    for key in ("interface", "second_interface"):
        name = getattr(config, key)
        if len(name.encode("utf-8", "replace")) > 15:
            reader.fail("", key, "an interface name has at most 15 characters")
    if config.second_interface and config.second_interface == config.interface:
        reader.fail(
            "",
            "second_interface",
            f"is '{config.interface}' like interface: the cable from the last slave back to "
            f"this computer needs an interface of its own",
        )

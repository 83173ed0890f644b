"""Reads the whole configuration, from a file or from maps."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ecatd.base.toml_file import Document, Table, read_toml

from .checks import check_clocks, check_eoe, check_physical
from .config import Config
from .placed import read


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
    return config

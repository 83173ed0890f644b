"""Reads the description of the complete bus that the configuration names."""

from __future__ import annotations

from pathlib import Path

from ecatd.base.errors import UsageError
from ecatd.description.bus import Bus
from ecatd.description.bus_file import load

from .. import Config


def load_description(config: Config) -> Bus | None:
    """Reads the file `description` of `[expected]`; None if there is none.

    Raises:
        ConfigError: It cannot be read.
    """
    if not config.expected.description:
        return None
    try:
        return load(Path(config.expected.description))
    except UsageError as error:
        config.expected.table.fail(
            "description",
            f"{error}: write it with `ecatctl scan -o` while all slaves are there and ecatd runs "
            "without this key",
        )

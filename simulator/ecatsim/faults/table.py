"""All faults by name, and how to read them from a rig file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ecatd.base.errors import ConfigError, UsageError

from .can import CanBabble, CanBitRate, CanBusOff, CanNodePower, CanNoise, CanShort
from .fault import Fault
from .frames import Corrupt, Delay, Drop, Duplicate, Noise, Wkc
from .slaves import (
    AlError,
    BreakLink,
    Clock,
    Drift,
    Eeprom,
    Emergency,
    HealLink,
    Identification,
    Mailbox,
    Module,
    PowerOff,
    PowerOn,
    Swap,
)

FAULTS: dict[str, type[Fault]] = {
    cls.kind: cls
    for cls in (
        *(Drop, Delay, Duplicate, Corrupt, Noise, Wkc),
        *(BreakLink, HealLink, PowerOff, PowerOn, Swap, Module),
        *(AlError, Emergency, Mailbox, Eeprom, Clock, Identification, Drift),
        *(CanNoise, CanShort, CanBusOff, CanBabble, CanBitRate, CanNodePower),
    )
}
"""The class of each fault, by the fault's name."""


def parse(
    table: Mapping[str, object],
    where: str,
    folder: Path | None = None,
    slaves: int | None = None,
) -> Fault:
    """Reads a fault from a table `[[fault]]` of a rig file.

    Args:
        table: The table; `kind` is the name of the fault, its other keys are parameters.
        where: File and table, with which errors begin.
        folder: Folder to which file paths are relative; None leaves them unchanged.
        slaves: Number of slaves of the rig, or None if it is not known yet.

    Raises:
        ConfigError: The table does not describe a valid fault.
    """
    values = dict(table)
    kind = values.pop("kind", None)
    if not isinstance(kind, str) or kind not in FAULTS:
        what = f"there is no fault '{kind}'" if kind is not None else "kind is missing"
        raise ConfigError(f"{where}: {what}; there are {', '.join(FAULTS)}")
    try:
        fault = FAULTS[kind].from_values(values)
        if slaves is not None:
            fault.check_slave(slaves)
    except UsageError as error:
        raise ConfigError(f"{where}: {error}") from None
    return fault if folder is None else fault.relative_to(folder)

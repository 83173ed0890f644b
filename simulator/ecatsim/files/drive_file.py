"""Drive files: CiA 402 drives of a manufacturer in TOML (`docs/drive-profiles.md`).

A drive file is a device file with a table `[drive]`, which says how the drive differs from the
standard, and with the sources of all that it says.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from ecatd.base.toml_file import Key, Rules, Table, array, choice, integer, read_toml

from ..devices.drive_options import DriveOptions
from ..devices.generic_drive import ServoDrive
from ..devices.homing import HardStop, HomingOptions
from ..devices.modes import Mode
from . import device_file, device_objects

_U16, _U32 = 0xFFFF, 0xFFFFFFFF
_METHOD = integer(-128, 127)
_HARD_STOP: Rules = {
    "method": _METHOD,
    "direction": choice({"negative": -1, "positive": 1}),
    "index": Table.boolean,
    "distance": Table.address,
}
_HOMING: Rules = {
    "methods": array(_METHOD),
    "threshold": Table.address,
    "in_milliampere": Table.boolean,
    "position": Table.address,
    "move": Table.address,
    "listed": Table.boolean,
    "hard_stop": lambda table, key: _hard_stops(table, key),
}
_DRIVE: Rules = {
    "description": Table.text,
    "modes": array(lambda table, key: _mode(table, key)),
    "supported_modes": integer(0, _U32),
    "quick_stop": array(integer(0, _U16)),
    "homing": lambda table, key: _homing(table, key),
    "speeds_in_rpm": Table.boolean,
    "home_bit": integer(0, 15),
    "limit_faults": lambda table, key: _limit_faults(table, key),
    "torque_when_switched_on": Table.boolean,
    "probes": integer(0, 2),
    "probe_index": Table.boolean,
    "without": array(integer(0x2000, _U16)),
    "encoder": integer(100, 1 << 24),
}
_UNIT: Rules = {"what": Table.text, "unit": Table.text, "source": Table.text}
_DEVIATION: Rules = {
    "about": Table.text,
    "what": Table.text,
    "source": Table.text,
    "simulated": Table.boolean,
}


@dataclass(frozen=True, slots=True)
class Deviation:
    """How a drive differs from the standard.

    Attributes:
        about: What it is about, such as an object.
        what: What the drive does.
        source: Document, version and page, or address.
        simulated: Whether the simulated drive does it, too.
    """

    about: str
    what: str
    source: str
    simulated: bool = True


@dataclass(frozen=True, slots=True)
class Unit:
    """The unit of values of a drive.

    Attributes:
        what: What has this unit.
        unit: The unit, with factory settings.
        source: As for deviations.
    """

    what: str
    unit: str
    source: str


class ProfileDrive(ServoDrive):
    """A drive that a file describes.

    Attributes:
        sources: Documents with identity, PDOs and modes.
        units: Units of its values.
        deviations: How it differs from the standard.
        unknown: What has not been found about it.
    """

    sources: tuple[str, ...] = ()
    units: tuple[Unit, ...] = ()
    deviations: tuple[Deviation, ...] = ()
    unknown: tuple[str, ...] = ()
    _objects: tuple[Table, ...] = ()

    def describe(self) -> None:
        """Adds the objects of the drive profile, and the values of the file."""
        super().describe()
        for row in self._objects:
            device_objects.apply_object(self.dictionary, row)


def load(path: Path) -> type[ProfileDrive]:
    """Reads a drive file.

    Raises:
        ConfigError: The file cannot be used; the message names file, line and key.
    """
    table = read_toml(path)
    table.only(device_file.keys())
    return read(table, path.stem)


def read(table: Table, name: str) -> type[ProfileDrive]:
    """Makes a class of a table with `drive`, whose keys have been checked.

    Args:
        table: The table.
        name: Name of the class; order code and name of the device if the table has none.

    Raises:
        ConfigError: As for `load`.
    """
    attributes = device_file.read_attributes(table, name)
    values = table.table("drive").read(_DRIVE, ("description",))
    attributes["__doc__"] = f"{values.pop('description')}."
    if "encoder" in values:
        encoder = values.pop("encoder")
        attributes["parameters"] = tuple(
            replace(item, default=encoder) if item.name == "encoder" else item
            for item in ServoDrive.parameters
        )
        attributes["usual_encoder"] = encoder
    for key, value in values.items():
        values[key] = tuple(value) if isinstance(value, list) else value
    attributes["options"] = DriveOptions(**values)
    attributes["_objects"] = tuple(table.tables("object"))
    attributes["sources"] = tuple(table.array("source", Table.text))
    attributes["unknown"] = tuple(table.array("unknown", Table.text))
    attributes["units"] = tuple(Unit(**row.read(_UNIT, _UNIT)) for row in table.tables("unit"))
    attributes["deviations"] = tuple(
        Deviation(**row.read(_DEVIATION, ("about", "what", "source")))
        for row in table.tables("deviation")
    )
    return type(name, (ProfileDrive,), attributes)


def _mode(table: Table, key: Key) -> Mode:
    number = table.integer(key, 0, max(Mode))
    if number not in tuple(Mode):
        known = ", ".join(str(int(mode)) for mode in Mode)
        table.fail(key, f"is {number}, but a simulated drive has the modes {known}")
    return Mode(number)


def _limit_faults(table: Table, key: Key) -> tuple[int, int]:
    codes = table.array(key, integer(1, _U16))
    if len(codes) != 2:
        table.fail(key, "must be two error codes, of the negative and of the positive limit switch")
    return codes[0], codes[1]


def _homing(table: Table, key: Key) -> HomingOptions:
    values = table.table(key).read(_HOMING, ("methods",))
    values["methods"] = tuple(values["methods"])
    values["hard_stops"] = values.pop("hard_stop", {})
    return HomingOptions(**values)


def _hard_stops(table: Table, key: Key) -> dict[int, HardStop]:
    rows = [row.read(_HARD_STOP, ("method", "direction")) for row in table.tables(key)]
    return {row.pop("method"): HardStop(**row) for row in rows}

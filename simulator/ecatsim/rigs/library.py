"""Finds the rig that a user names: one that comes with ecatsim, or one in a file."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ecatd.base.close_names import did_you_mean
from ecatd.base.errors import ConfigError, UsageError

from ..rig import Rig


def _troll(argument: str) -> Rig:
    del argument
    from .troll import rig

    return rig()


def _troll_can(argument: str) -> Rig:
    del argument
    from .troll_can import rig

    return rig()


def _two_axes(argument: str) -> Rig:
    del argument
    from .two_axes import rig

    return rig()


def _branches(argument: str) -> Rig:
    del argument
    from .branches import rig

    return rig()


def _line(argument: str) -> Rig:
    from .line import rig

    return rig(int(argument))


def _terminals(argument: str) -> Rig:
    from .terminals import rig

    return rig(int(argument))


@dataclass(frozen=True, slots=True)
class _Named:
    """A rig of the library: pattern of its name, name and text for lists, and its function."""

    pattern: re.Pattern[str]
    usage: str
    text: str
    make: Callable[[str], Rig]


_LIBRARY = (
    _Named(
        re.compile(r"troll()"),
        "troll",
        "wheel drive with motor, coupler, digital and analog terminals, CANopen terminals",
        _troll,
    ),
    _Named(
        re.compile(r"troll-can()"),
        "troll-can",
        "troll with CAN buses behind its terminals: CANopen drive, torque sensor, CANopen I/O",
        _troll_can,
    ),
    _Named(
        re.compile(r"two-axes()"),
        "two-axes",
        "two CiA 402 drives with motors, home switches, limit switches and mechanical stops",
        _two_axes,
    ),
    _Named(
        re.compile(r"line:(\d{1,4})"),
        "line:N",
        "N slaves of 32 bytes in and 32 bytes out; each returns its outputs as inputs",
        _line,
    ),
    _Named(
        re.compile(r"terminals:(\d{1,4})"),
        "terminals:N",
        "N couplers and digital terminals of one byte; inputs return the outputs before them",
        _terminals,
    ),
    _Named(
        re.compile(r"branches()"),
        "branches",
        "couplers and terminals in two branches at a junction",
        _branches,
    ),
    _Named(
        re.compile(r"empty()"),
        "empty",
        "no slaves: nothing answers",
        lambda argument: Rig("empty"),
    ),
)


def library() -> list[tuple[str, str]]:
    """Returns the names and descriptions of the rigs that come with ecatsim."""
    return [(item.usage, item.text) for item in _LIBRARY]


def make(name: str) -> Rig:
    """Makes the rig with a name in the library, or from a TOML file or a Python file with `rig()`.

    Raises:
        UsageError: There is no such rig.
        ConfigError: The file cannot be used.
    """
    for item in _LIBRARY:
        match = item.pattern.fullmatch(name)
        if match:
            return item.make(match[1])
    if name.endswith(".py"):
        return _from_python(Path(name))
    if name.endswith(".toml"):
        from ..files import rig_file

        return rig_file.load(Path(name))
    if name.startswith("line:"):
        raise UsageError(f"{name}: a line has 1 to 1024 slaves, as in line:8")
    if name.startswith("terminals:"):
        raise UsageError(f"{name}: there can be 1 to 1024 slaves, as in terminals:64")
    if Path(name).suffix.lower() in (".bin", ".hex", ".xml") and Path(name).is_file():
        key = "esi" if name.lower().endswith(".xml") else "sii"
        raise UsageError(
            f"'{name}' is not a rig: write one in a TOML file, with [[slave]] and {key} = "
            f'"{Path(name).name}"'
        )
    if hint := did_you_mean(name, (usage for usage, _ in library())):
        raise UsageError(f"there is no rig '{name}': {hint}")
    raise UsageError(
        f"there is no rig '{name}'. `ecatsim rigs` lists all rigs. To use your own, give a .toml "
        "file, or a .py file that defines rig()"
    )


def _from_python(path: Path) -> Rig:
    from ..files import python_file

    if not path.is_file():
        raise ConfigError(f"there is no rig file '{path}'")
    function = getattr(python_file.load(path), "rig", None)
    if not callable(function):
        raise ConfigError(f"{path}: the file must define a function rig()")
    result = python_file.explained(path, function)
    if not isinstance(result, Rig):
        raise ConfigError(f"{path}: rig() must return an ecatsim.rig.Rig")
    return result

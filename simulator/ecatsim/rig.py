"""A rig: the devices of a segment and what connects them outside the bus."""

from __future__ import annotations

import importlib.util
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType

from ecatd.model.errors import ConfigError, UsageError

from .slave.device import Device
from .slave.objects import Variable

Plant = Callable[[float], None]
"""Called before each step of the devices, with CLOCK_MONOTONIC in seconds."""

Terminal = tuple[Device, int, int]
"""A device and the index and subindex of one of its PDO entries."""


@dataclass(slots=True)
class Trace:
    """Values that `ecatsim run --trace` records at each step.

    Attributes:
        columns: Names of the values, with units.
        values: Returns the values of this moment.
    """

    columns: Sequence[str]
    values: Callable[[], Sequence[float]]


@dataclass(slots=True)
class Rig:
    """A segment to simulate.

    Attributes:
        name: Name.
        devices: Devices in wire order.
        plants: What connects the devices outside the bus: wires, signal sources, mechanics.
        trace: What to record, or None.
    """

    name: str
    devices: list[Device] = field(default_factory=list)
    plants: list[Plant] = field(default_factory=list)
    trace: Trace | None = None

    def wire(self, source: Terminal, target: Terminal) -> None:
        """Connects an output with an input."""
        output, entry = _entry(source), _entry(target)

        def carry(now: float) -> None:
            del now
            entry.value = output.value

        self.plants.append(carry)

    def drive(self, target: Terminal, signal: Callable[[float], int]) -> None:
        """Connects a signal source with an input."""
        entry = _entry(target)

        def carry(now: float) -> None:
            entry.value = signal(now)

        self.plants.append(carry)


def _entry(terminal: Terminal) -> Variable:
    device, index, subindex = terminal
    return device.dictionary[index, subindex]


def _troll(argument: str) -> Rig:
    del argument
    from .rigs.troll import rig

    return rig()


def _line(argument: str) -> Rig:
    from .rigs.line import rig

    return rig(int(argument))


@dataclass(frozen=True, slots=True)
class _Named:
    """A rig of the library: the pattern of its name, how it is listed, and what makes it."""

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
        re.compile(r"line:(\d{1,4})"),
        "line:N",
        "N slaves of 32 bytes in and 32 bytes out; each returns its outputs as inputs",
        _line,
    ),
    _Named(
        re.compile(r"empty()"),
        "empty",
        "no slaves: nothing answers",
        lambda argument: Rig("empty"),
    ),
)


def library() -> list[tuple[str, str]]:
    """Name and description of the rigs that come with ecatsim."""
    return [(item.usage, item.text) for item in _LIBRARY]


def make(name: str) -> Rig:
    """The rig that a user means: a name of the library, or a Python file with a function `rig`.

    Raises:
        UsageError: There is no such rig.
        ConfigError: The file cannot be used.
    """
    for item in _LIBRARY:
        match = item.pattern.fullmatch(name)
        if match:
            return item.make(match[1])
    if name.endswith(".py"):
        return _from_file(Path(name))
    if name.startswith("line:"):
        raise UsageError(f"{name}: a line has 1 to 1024 slaves, as in line:8")
    names = ", ".join(usage for usage, _ in library())
    raise UsageError(
        f"there is no rig '{name}': use one of {names}, or a Python file that defines rig()"
    )


def _from_file(path: Path) -> Rig:
    if not path.is_file():
        raise ConfigError(f"there is no rig file '{path}'")
    spec = importlib.util.spec_from_file_location(f"ecatsim_rig_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.path.insert(0, str(path.parent.resolve()))  # it may import files beside it
    try:
        spec.loader.exec_module(module)
        result = _call(module)
    except UsageError:
        raise
    except Exception as error:
        line = _last_line(error, path)
        where = f"{path}:{line}" if line else str(path)
        raise ConfigError(f"{where}: {type(error).__name__}: {error}") from error
    if not isinstance(result, Rig):
        raise ConfigError(f"{path}: rig() must return an ecatsim.rig.Rig")
    return result


def _call(module: ModuleType) -> object:
    function = getattr(module, "rig", None)
    if not callable(function):
        raise ConfigError(f"{module.__file__}: the file must define a function rig()")
    return function()


def _last_line(error: BaseException, path: Path) -> int:
    """The line of the file in which an error came up, 0 if in none."""
    line = error.lineno or 0 if isinstance(error, SyntaxError) else 0
    trace = error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == str(path):
            line = trace.tb_lineno
        trace = trace.tb_next
    return line

"""A rig: the devices of a segment and what connects them outside the bus."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ecatd.model.errors import ConfigError, UsageError

from .faults import Fault
from .plants.paced import Paced
from .plants.point import Point, Terminal
from .slave.device import Device
from .topology import Topology, Wiring

Plant = Callable[[float], None]
"""Called before each step of the devices, with CLOCK_MONOTONIC in seconds."""


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
        devices: Devices in wire order, which is that of auto-increment addresses: a line, each at
            the first port of the one before that fits (E-bus or Ethernet, else port 1), but for
            those that `connect` plugs in elsewhere.
        plants: What connects the devices outside the bus: wires, signal sources, mechanics.
        trace: What to record, or None.
        faults: Faults on demand that it begins with.
        ring: Whether a second interface closes a ring (cable redundancy): at the first free port of
            the last device, or where `close_ring` puts it.
    """

    name: str
    devices: list[Device] = field(default_factory=list)
    plants: list[Plant] = field(default_factory=list)
    trace: Trace | None = None
    faults: list[Fault] = field(default_factory=list)
    ring: bool = False
    _topology: Topology = field(default_factory=Topology, repr=False)

    def connect(self, device: Device, parent: Device, port: int) -> None:
        """Plugs port 0 of a device into a port of another one: a branch at a coupler or junction.

        `devices` is put into wire order: behind each device come those at its port 3, then 1,
        then 2. The other devices keep their links, and what is behind `device` comes with it.

            coupler, inputs, drive = EK1100(), EL1008(), Drive()
            rig = Rig("branch", [coupler, inputs, drive])
            rig.connect(drive, coupler, port=2)

        Args:
            device: A device of the rig, but not the first one.
            parent: The device nearer to the master.
            port: Port of the parent: 1, 2 or 3.

        Raises:
            UsageError: One of them is not in the rig, the parent does not have that port
                (`Chip.ports`), something else is plugged in there, or it would be a loop.
        """
        self.devices[:] = self._topology.connect(self.devices, device, parent, port)

    def close_ring(self, device: Device, port: int) -> None:
        """Plugs the second interface of a ring into a port of a device.

        Raises:
            UsageError: It has no such port, or something else is plugged in there.
        """
        self._topology.close_ring(self.devices, device, port)
        self.ring = True

    @property
    def size(self) -> str:
        """The number of slaves, in words."""
        return "1 slave" if len(self.devices) == 1 else f"{len(self.devices)} slaves"

    def wiring(self) -> Wiring:
        """The links of the devices.

        Raises:
            UsageError: A port that is needed is taken or does not exist, or `devices` holds
                something else or a device twice.
        """
        first: dict[int, int] = {}
        for position, device in enumerate(self.devices):
            if not isinstance(device, Device):
                raise UsageError(f"slave {position} must be a device, not {device!r:.80}")
            if first.setdefault(id(device), position) != position:
                raise UsageError(
                    f"slaves {first[id(device)]} and {position} are the same object: each slave "
                    "needs a device of its own"
                )
        return self._topology.wiring(self.devices, self.ring)

    def wire(
        self, source: Terminal, target: Terminal, scale: float = 1.0, offset: float = 0.0
    ) -> None:
        """Connects an output with an input: input = output * scale + offset.

        Both are in the units of their entries, which is volts at analog terminals.

        Raises:
            UsageError: A device has no such entry.
        """
        output, entry = Point(source), Point(target)
        if (scale, offset) == (1.0, 0.0) and output.same_scale(entry):
            raw, into = output.variable, entry.variable

            def copy(now: float) -> None:
                del now
                into.value = raw.value

            self.plants.append(copy)
            return

        def carry(now: float) -> None:
            del now
            entry.set(output.get() * scale + offset)

        self.plants.append(carry)

    def drive(self, target: Terminal, signal: Callable[[float], float]) -> None:
        """Connects a signal source with an input, in the unit of its entry.

        Raises:
            UsageError: The device has no such entry.
        """
        entry = Point(target)
        self.plants.append(lambda now: entry.set(signal(now)))

    def add_plant(self, plant: Plant, period: float = 0.001, catch_up: float = 0.1) -> None:
        """Adds a callable that is to be called at a fixed rate.

        It gets the time of each step, `period` apart, also where the simulation is late; after a
        longer pause than `catch_up` the steps before that are left out.

        Args:
            plant: The callable.
            period: Seconds between two calls.
            catch_up: Seconds that are made up for at most.

        Raises:
            UsageError: `period` is not positive.
        """
        self.plants.append(Paced(plant, period, catch_up))


def _troll(argument: str) -> Rig:
    del argument
    from .rigs.troll import rig

    return rig()


def _branches(argument: str) -> Rig:
    del argument
    from .rigs.branches import rig

    return rig()


def _line(argument: str) -> Rig:
    from .rigs.line import rig

    return rig(int(argument))


def _terminals(argument: str) -> Rig:
    from .rigs.terminals import rig

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
    """Name and description of the rigs that come with ecatsim."""
    return [(item.usage, item.text) for item in _LIBRARY]


def make(name: str) -> Rig:
    """The rig that a user means: a name of the library, a TOML file, or a Python file with `rig()`.

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
        from .files import rig_file

        return rig_file.load(Path(name))
    if name.startswith("line:"):
        raise UsageError(f"{name}: a line has 1 to 1024 slaves, as in line:8")
    if name.startswith("terminals:"):
        raise UsageError(f"{name}: there can be 1 to 1024 slaves, as in terminals:64")
    if Path(name).suffix.lower() in (".bin", ".xml") and Path(name).is_file():
        key = "esi" if name.lower().endswith(".xml") else "sii"
        raise UsageError(
            f"'{name}' is no rig: write one in a TOML file, with [[slave]] and {key} = "
            f'"{Path(name).name}"'
        )
    names = ", ".join(usage for usage, _ in library())
    raise UsageError(
        f"there is no rig '{name}': use one of {names}, or a file: TOML, or Python that defines "
        "rig()"
    )


def _from_python(path: Path) -> Rig:
    from .files import python_file

    if not path.is_file():
        raise ConfigError(f"there is no rig file '{path}'")
    function = getattr(python_file.load(path), "rig", None)
    if not callable(function):
        raise ConfigError(f"{path}: the file must define a function rig()")
    result = python_file.explained(path, function)
    if not isinstance(result, Rig):
        raise ConfigError(f"{path}: rig() must return an ecatsim.rig.Rig")
    return result

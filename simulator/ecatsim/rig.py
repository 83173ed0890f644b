"""A rig: the devices of a segment and their connections outside the bus."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from ecatd.base.errors import UsageError
from ecatd.etg.scaling import to_physical

from .can.bus import CanBus
from .faults import Fault
from .plants.fixed_step import FixedStep
from .plants.point import Point, Terminal
from .slave.device import Device
from .topology import Topology, Wiring

Plant = Callable[[float], None]
"""A function that is called before each step of the devices, with CLOCK_MONOTONIC in seconds."""


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
        name: Name of the rig.
        devices: Devices in wire order, which is the order of auto-increment addresses. They form a
            line: each is plugged into the first port of the same kind (E-bus or Ethernet) of the
            device before it, else into port 1. `connect` plugs a device in elsewhere.
        plants: Functions that connect the devices outside the bus: wires, waveforms, mechanics.
        trace: Values to record, or None.
        faults: Faults that the simulation begins with.
        ring: Whether a second interface closes a ring (cable redundancy): at the first free port of
            the last device, or where `close_ring` plugs it in.
        exchanged: Devices whose cables at the ports 0 and 1 are exchanged by mistake. A frame
            passes them on its way back, so the master finds them behind those that follow them.
        can: CAN buses behind devices, whose nodes make a step with each step of the devices.
    """

    name: str
    devices: list[Device] = field(default_factory=list)
    plants: list[Plant] = field(default_factory=list)
    trace: Trace | None = None
    faults: list[Fault] = field(default_factory=list)
    ring: bool = False
    exchanged: list[Device] = field(default_factory=list)
    can: list[CanBus] = field(default_factory=list)
    _topology: Topology = field(default_factory=Topology, repr=False)

    def connect(self, device: Device, parent: Device, port: int) -> None:
        """Plugs port 0 of a device into a port of another one: a branch at a coupler or junction.

        `devices` is sorted into wire order: behind each device come those at its port 3, then port
        1, then port 2. The other devices keep their links, and the devices behind `device` move
        with it.

            coupler, inputs, drive = EK1100(), EL1008(), Drive()
            rig = Rig("branch", [coupler, inputs, drive])
            rig.connect(drive, coupler, port=2)

        Args:
            device: A device of the rig, but not the first.
            parent: The device nearer to the master.
            port: Port of the parent: 1, 2 or 3.

        Raises:
            UsageError: A device is not in the rig, the parent does not have that port
                (`Chip.ports`), the port is taken, or the links would be a loop.
        """
        self.devices[:] = self._topology.connect(self.devices, device, parent, port)

    def close_ring(self, device: Device, port: int) -> None:
        """Plugs the second interface of a ring into a port of a device.

        Raises:
            UsageError: The device does not have that port, or the port is taken.
        """
        self._topology.close_ring(self.devices, device, port)
        self.ring = True

    @property
    def size(self) -> str:
        """The number of slaves, in words."""
        return "1 slave" if len(self.devices) == 1 else f"{len(self.devices)} slaves"

    @property
    def remarks(self) -> list[str]:
        """What is wrong in the files of vendors that describe devices, and how it is simulated."""
        return [
            f"slave {position} ({device.order or device.name}): {text}"
            for position, device in enumerate(self.devices)
            if isinstance(device, Device)
            for text in device.remarks
        ]

    def wiring(self) -> Wiring:
        """Returns the links of the devices.

        Raises:
            UsageError: A needed port is taken or does not exist, or `devices` has a device twice or
                an item that is not a device.
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

    def connect_entries(
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
            entry.set(to_physical(output.get(), scale, offset))

        self.plants.append(carry)

    def drive(self, target: Terminal, waveform: Callable[[float], float]) -> None:
        """Drives an input with a waveform, in the unit of the entry.

        Raises:
            UsageError: The device has no such entry.
        """
        entry = Point(target)
        self.plants.append(lambda now: entry.set(waveform(now)))

    def add_plant(self, plant: Plant, period: float = 0.001, catch_up: float = 0.1) -> None:
        """Adds a callable that is called at a fixed rate.

        It gets the time of each step, `period` apart, even if the simulation is late. After a
        pause, it catches up at most the last `catch_up` seconds, and leaves earlier steps out.

        Args:
            plant: The callable.
            period: Seconds between two calls.
            catch_up: Largest time in seconds that is caught up.

        Raises:
            UsageError: `period` is not positive.
        """
        self.plants.append(FixedStep(plant, period, catch_up))

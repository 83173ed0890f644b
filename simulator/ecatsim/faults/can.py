"""Faults of the CAN bus behind a terminal. The simulation loop carries them out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from ecatd.base.close_names import did_you_mean
from ecatd.base.errors import UsageError

from ..can.bus import CanBus, Stuck
from ..devices.can_terminals import CanTerminal
from ..parameters import Is
from .fault import SlaveFault
from .target import Target

Node = Annotated[str, Is("name of a node, as `ecatsim ctl can` shows it, or its number")]

_LEVELS = {"recessive": Stuck.RECESSIVE, "dominant": Stuck.DOMINANT, "none": Stuck.NO}


@dataclass(frozen=True)
class CanFault(SlaveFault):
    """A fault of the bus behind a terminal."""

    def check(self, target: Target) -> None:
        """Checks that the slave is a terminal with a bus."""
        self._bus(target)

    def _bus(self, target: Target) -> CanBus:
        return self._terminal(target).can.bus

    def _terminal(self, target: Target) -> CanTerminal:
        device = target.devices[self.slave]
        if not isinstance(device, CanTerminal):
            name = device.order or device.name
            raise UsageError(f"{self.kind}: slave {self.slave} ({name}) has no CAN bus behind it")
        return device


@dataclass(frozen=True)
class CanNoise(CanFault):
    """The CAN bus of a terminal lacks its termination: frames are damaged, and sent again."""

    kind: ClassVar[str] = "can-noise"
    chance: Annotated[
        float, Is("chance that a frame is damaged; 0 = none", minimum=0.0, maximum=1.0)
    ]

    def strike(self, target: Target) -> None:
        """Sets the noise."""
        self._bus(target).set_noise(self.chance, self.seed or 1)


@dataclass(frozen=True)
class CanShort(CanFault):
    """A short circuit makes the CAN bus of a terminal show one level all the time."""

    kind: ClassVar[str] = "can-short"
    level: Annotated[
        Literal["recessive", "dominant", "none"],
        Is(
            "recessive: between the two wires, so that who sends goes bus-off; dominant: to the "
            "supply, so that nobody can begin; none: repaired"
        ),
    ]

    def strike(self, target: Target) -> None:
        """Makes or repairs the short circuit."""
        self._bus(target).set_stuck(_LEVELS[self.level])


@dataclass(frozen=True)
class CanBusOff(CanFault):
    """The CAN controller of a terminal goes bus-off."""

    kind: ClassVar[str] = "can-bus-off"

    def strike(self, target: Target) -> None:
        """Brings it into bus-off."""
        terminal = self._terminal(target)
        terminal.can.bus.force_bus_off(terminal.can.place)


@dataclass(frozen=True)
class CanBabble(CanFault):
    """A node on the CAN bus of a terminal sends one frame again and again, as fast as it can."""

    kind: ClassVar[str] = "can-babble"
    id: Annotated[int, Is("its identifier", minimum=0, maximum=0x7FF, hexadecimal=True)] = 0
    end: Annotated[bool, Is("it has become silent")] = False

    def strike(self, target: Target) -> None:
        """Begins or ends it."""
        self._bus(target).babble(None if self.end else self.id)


@dataclass(frozen=True)
class CanNodeFault(CanFault):
    """A fault of one node."""

    node: Node

    def check(self, target: Target) -> None:
        """Checks that the bus has the node."""
        self._place(target)

    def _place(self, target: Target) -> int:
        bus = self._bus(target)
        names = [name.casefold() for name in bus.places]
        named = [n for n, name in enumerate(names) if name == self.node.casefold()]
        if len(named) > 1:
            numbers = " and ".join(map(str, named))
            raise UsageError(
                f"{self.kind}: CAN nodes {numbers} are called '{bus.places[named[0]]}': say which "
                "one by its number"
            )
        if named:
            return named[0]
        if self.node.isdecimal() and int(self.node) < len(names):
            return int(self.node)
        hint = did_you_mean(self.node, bus.places, most=3) or f"there are {', '.join(bus.places)}"
        raise UsageError(f"{self.kind}: there is no CAN node '{self.node[:40]}': {hint}")


@dataclass(frozen=True)
class CanBitRate(CanNodeFault):
    """A node on the CAN bus of a terminal has another bit rate, and understands nobody."""

    kind: ClassVar[str] = "can-bit-rate"
    kbit: Annotated[int, Is("its bit rate", unit="kbit/s", minimum=5, maximum=1000)]

    def strike(self, target: Target) -> None:
        """Sets the bit rate."""
        self._bus(target).configure(self._place(target), 1000 * self.kbit)


@dataclass(frozen=True)
class CanNodePower(CanNodeFault):
    """A node on the CAN bus of a terminal loses its power, or gets it back."""

    kind: ClassVar[str] = "can-node"
    power: Annotated[Literal["off", "on"], Is("what happens to it")]

    def strike(self, target: Target) -> None:
        """Switches the power."""
        bus, place, on = self._bus(target), self._place(target), self.power == "on"
        for node in bus.nodes:
            if node.place == place:
                node.power(on)
                return
        bus.power(place, on)

"""What faults happen to: a running simulation, as far as they need to know it."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Any, Protocol

from ..core import Segment
from ..slave.device import Device


class Target(Protocol):
    """A running simulation; `Simulation` says what its methods do.

    Attributes:
        segment: The slave controllers.
    """

    segment: Segment

    @property
    def lock(self) -> AbstractContextManager[Any]:
        """Held while devices are dealt with."""
        ...

    @property
    def devices(self) -> list[Device]:
        """All devices, by position."""
        ...

    def powered(self, position: int) -> Device:
        """The device of a slave that has power; raises StateError if it has none."""
        ...

    def power(self, position: int, on: bool) -> None:
        """Switches the power of a slave."""
        ...

    def swap(self, position: int, device: Device | None) -> None:
        """Puts another device in the place of a slave."""
        ...

    def original_eeprom(self, position: int) -> bytes:
        """The SII image of a slave before any fault."""
        ...

    def eeprom_at_power_on(self, position: int, image: bytes) -> None:
        """Gives a slave another SII image from its next power-on."""
        ...

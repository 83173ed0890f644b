"""The interface of a running simulation that faults use."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Any, Protocol

from ..esc import Segment
from ..slave.device import Device


class Target(Protocol):
    """A running simulation; its methods are documented at `Simulation`.

    Attributes:
        segment: The slave controllers.
    """

    segment: Segment

    @property
    def lock(self) -> AbstractContextManager[Any]:
        """The lock that is held while devices are used."""
        ...

    @property
    def devices(self) -> list[Device]:
        """All devices, by position."""
        ...

    def powered(self, position: int) -> Device:
        """Returns the device of a slave; raises StateError if the slave has no power."""
        ...

    def power(self, position: int, on: bool) -> None:
        """Switches the power of a slave."""
        ...

    def swap(self, position: int, device: Device | None) -> None:
        """Puts another device in the place of a slave."""
        ...

    def original_eeprom(self, position: int) -> bytes:
        """Returns the SII image of a slave before any fault."""
        ...

    def eeprom_at_power_on(self, position: int, image: bytes) -> None:
        """Gives a slave another SII image at its next power-on."""
        ...

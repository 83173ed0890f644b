"""The interface between plants and devices: a PDO entry as a physical value."""

from __future__ import annotations

import math

from ecatd.base.errors import ConfigError, UsageError
from ecatd.etg.datatypes import is_real, is_signed
from ecatd.etg.pdo import Entry
from ecatd.etg.scaling import to_physical, to_raw

from ..slave.device import Device
from ..slave.objects import Variable

Terminal = tuple[Device, int, int]
"""A device and the index and subindex of one of its PDO entries."""

_LARGEST_REAL32 = (2 - 2**-23) * 2.0**127


class Point:
    """An entry of a device, in the unit of the entry (volts at an analog terminal) or raw.

    A value that is set is rounded, and cut to the range of the entry's type, as a converter does.

    Args:
        terminal: The device, and index and subindex of the entry.

    Attributes:
        variable: The entry with the raw value.
        unit: The unit, or empty.
        scale: Physical value = raw value * scale + offset.
        offset: See `scale`.

    Raises:
        UsageError: The device has no such entry.
    """

    def __init__(self, terminal: Terminal) -> None:
        device, index, subindex = terminal
        try:
            self.variable: Variable = device.connection(index, subindex)
        except ConfigError:
            known = ", ".join(entry.address for entry in _entries(device)) or "none"
            raise UsageError(
                f"{device.order or 'the device'} has no entry 0x{index:04X}:{subindex:02X}; "
                f"its process data has {known}"
            ) from None
        self.unit, self.scale, self.offset = "", 1.0, 0.0
        for entry in _entries(device):
            if (entry.index, entry.subindex) == (index, subindex):
                self.unit, self.scale, self.offset = entry.unit, entry.scale, entry.offset
        kind, bits = self.variable.type, self.variable.bits
        self._whole = not is_real(kind)
        self._low = -(1 << bits - 1) if is_signed(kind) else 0
        self._high = (1 << bits - is_signed(kind)) - 1

    def get(self) -> float:
        """Returns the physical value; 0 if a master has written an infinite value or NaN."""
        raw = self.variable.value
        if not isinstance(raw, int | float) or not math.isfinite(raw):
            return 0.0
        return to_physical(raw, self.scale, self.offset)

    def set(self, value: float) -> None:
        """Sets the physical value; NaN changes nothing."""
        raw = to_raw(value, self.scale, self.offset)
        if raw != raw:  # NaN
            return
        if self._whole:
            self.variable.value = round(min(max(raw, self._low), self._high))
        elif self.variable.bits == 32 and abs(raw) > _LARGEST_REAL32:
            self.variable.value = math.copysign(math.inf, raw)
        else:
            self.variable.value = float(raw)

    def same_scale(self, other: Point) -> bool:
        """Whether raw values have the same meaning at both points."""
        return (self.unit, self.scale, self.offset) == (other.unit, other.scale, other.offset)


def _entries(device: Device) -> list[Entry]:
    """Returns the PDO entries of a device, without gaps."""
    pdos = (*device.rx_pdos, *device.tx_pdos)
    return [entry for pdo in pdos for entry in pdo.entries if not entry.is_gap]

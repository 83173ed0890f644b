"""Profiles of devices: the meanings of the entries of their process data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ecatd.description.bus import ProfileName, Slave
from ecatd.etg.pdo import Entry

Meaning = Mapping[str, Any]
"""What a profile says of an entry: values of attributes of `Entry`."""


@dataclass(frozen=True, slots=True)
class EntryProfile:
    """The entries at `index`, `index + step`, ... (`count` of them) with some subindices."""

    index: int
    subindices: frozenset[int]
    step: int
    count: int
    meaning: Meaning

    def fits(self, entry: Entry) -> bool:
        """Whether this describes the entry."""
        place, rest = divmod(entry.index - self.index, self.step)
        return entry.subindex in self.subindices and rest == 0 and 0 <= place < self.count


@dataclass(frozen=True, slots=True)
class DeviceProfile:
    """Profile of one kind of device.

    Attributes:
        source: The file. It does not count when profiles are compared.
        name: What documentation calls it.
        vendor: Vendor ID, -1: any.
        products: Product codes, empty: any.
        has: Index and subindex of entries that a device must have in its process data.
        entries: The meanings of its entries.
    """

    source: str = field(compare=False)
    name: ProfileName
    vendor: int
    products: frozenset[int]
    has: tuple[tuple[int, int], ...]
    entries: tuple[EntryProfile, ...]

    def meaning(self, entry: Entry) -> Meaning | None:
        """The meaning of an entry, or None if the profile does not describe it."""
        return next((known.meaning for known in self.entries if known.fits(entry)), None)

    def fits(self, slave: Slave) -> bool:
        """Whether the slave is such a device."""
        if self.vendor not in (-1, slave.vendor):
            return False
        if self.products and slave.product not in self.products:
            return False
        return all(_has(slave, *address) for address in self.has)

    @property
    def wanted(self) -> str:
        """The conditions that a slave must meet to be such a device, for messages."""
        parts = [f"vendor 0x{self.vendor:08X}"] if self.vendor != -1 else []
        if self.products:
            parts.append(
                f"product {' or '.join(f'0x{code:08X}' for code in sorted(self.products))}"
            )
        parts += [f"with entry 0x{index:04X}:{subindex:02X}" for index, subindex in self.has]
        return ", ".join(parts)


def _has(slave: Slave, index: int, subindex: int) -> bool:
    return any(
        (entry.index, entry.subindex) == (index, subindex)
        for outputs in (True, False)
        for _, entry, _ in slave.entries(outputs=outputs)
    )


@dataclass(frozen=True, slots=True)
class Profiles:
    """All profiles. The first one that knows an entry decides what the entry means.

    Attributes:
        devices: The profiles; an earlier one takes precedence over a later one.
        named: How many of the first ones are from folders that the configuration names.
    """

    devices: tuple[DeviceProfile, ...] = ()
    named: int = 0

    def of(self, slave: Slave) -> list[DeviceProfile]:
        """The profiles that fit a slave."""
        return [device for device in self.devices if device.fits(slave)]

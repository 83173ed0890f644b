"""Devices, and what the entries of their process data mean."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from ecatd.model.bus import Entry, Slave


@dataclass(frozen=True, slots=True)
class Value:
    """One number of an enumeration.

    Attributes:
        number: The number.
        name: What it stands for.
    """

    number: int
    name: str


@dataclass(frozen=True, slots=True)
class Meaning:
    """What the value of an entry means: physical value = raw value * scale + offset.

    Attributes:
        unit: Unit of the physical value as Modelica writes it (`V`, `rad/s`), or as the
            configuration of the daemon has it; empty for a raw value.
        display_unit: Unit that tools show it in, or empty.
        quantity: Physical quantity (`ElectricPotential`), or empty.
        scale: See above.
        offset: See above, in `unit`.
        values: What the numbers stand for, in their order.
        note: What else a user should know, for the documentation.
        connector: Whether the block has a connector for it, or only a variable.
    """

    unit: str = ""
    display_unit: str = ""
    quantity: str = ""
    scale: float = 1.0
    offset: float = 0.0
    values: tuple[Value, ...] = ()
    note: str = ""
    connector: bool = True

    @property
    def is_physical(self) -> bool:
        """Whether the value is something else than what the process data hold."""
        return bool(self.unit) or self.scale != 1 or self.offset != 0


@dataclass(frozen=True, slots=True)
class EntryProfile:
    """The entries at `index`, `index + step`, ... (`count` of them) with some subindices."""

    index: int
    subindices: frozenset[int]
    step: int
    count: int
    meaning: Meaning

    def fits(self, entry: Entry) -> bool:
        """Whether this is about the entry."""
        place, rest = divmod(entry.index - self.index, self.step)
        return entry.subindex in self.subindices and rest == 0 and 0 <= place < self.count


@dataclass(frozen=True, slots=True)
class DeviceProfile:
    """One kind of device.

    Attributes:
        source: File that it is from; the same device in two files is equal.
        description: What the devices are.
        facts: Where what it says is documented, or empty.
        vendor: Vendor ID, -1: any.
        products: Product codes, empty: any.
        has: Index and subindex of entries that a device must have in its process data.
        entries: What its entries mean.
    """

    source: str = field(compare=False)
    description: str
    facts: str
    vendor: int
    products: frozenset[int]
    has: tuple[tuple[int, int], ...]
    entries: tuple[EntryProfile, ...]

    def fits(self, slave: Slave) -> bool:
        """Whether the slave is such a device."""
        if self.vendor not in (-1, slave.vendor):
            return False
        if self.products and slave.product not in self.products:
            return False
        return all(_has(slave, *address) for address in self.has)

    @property
    def wanted(self) -> str:
        """What a slave must be to be such a device, for messages."""
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
    """All profiles; where two know an entry, the first one counts."""

    devices: tuple[DeviceProfile, ...] = ()

    def of(self, slave: Slave) -> SlaveProfile:
        """What is known about a slave."""
        return SlaveProfile(tuple(device for device in self.devices if device.fits(slave)))


@dataclass(frozen=True, slots=True)
class SlaveProfile:
    """The profiles that fit one slave."""

    devices: tuple[DeviceProfile, ...]

    def meaning(self, entry: Entry) -> Meaning:
        """What an entry means. What the daemon's configuration says about it, counts first."""
        known = next(
            (p.meaning for device in self.devices for p in device.entries if p.fits(entry)),
            Meaning(),
        )
        if entry.unit or entry.scale != 1 or entry.offset != 0:
            return replace(
                known,
                unit=entry.unit,
                display_unit="",
                quantity="",
                scale=entry.scale,
                offset=entry.offset,
            )
        return known

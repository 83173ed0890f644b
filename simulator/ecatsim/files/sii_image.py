"""Makes a device from the EEPROM image of a real one (ETG.2010)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import count

from ecatd.base.errors import ConfigError, UsageError
from ecatd.etg.datatypes import STRINGS, DataType, bit_length, is_real, is_signed, type_of_bits
from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.sii import Sii, SiiMailbox, SiiSyncManager, in_memory
from ecatd.etg.sii_categories import FIRST_CATEGORY
from ecatd.etg.sii_check import MAILBOX_SIZES, MAX_IMAGE, check_sii

from ..esc import Chip
from ..slave.device import Device
from ..slave.sii import Mailbox, SmType, SyncManager
from ..slave.telegrams import telegram_idns

_RAM = 0x1000
_RAM_SIZES = (1, 2, 4, 8, 16, 32, 60)
_DEVICE_EMULATION = 0x0100  # bit of SII word 0
_PDO_ASSIGN, _PDO_CONFIGURATION = 0x04, 0x08  # bits of the CoE details
_PORT_0 = 0x03  # without port 0 no frame would reach the slave
_PORT_KINDS = {0: 0, 1: 3, 3: 2}  # SII: 1 MII, 3 EBUS; register 0x0007: 3 MII, 2 EBUS
_INTERNAL = 0x10000  # beyond all indices of objects and IDNs
_LAST_DUMMY = 0x001F  # CiA 301: mapping a data type leaves a gap of its size


class DeviceFromSii(Device):
    """A device that behaves as its SII image says.

    The master reads the image byte for byte. Inputs keep the values that they are given (0 at
    first); outputs can be read from the dictionary.

    Args:
        image: The whole content of the EEPROM.
        sii: The parsed image.
        chip: The slave controller; None chooses the smallest common one that has all it needs.
    """

    def __init__(self, image: bytes, sii: Sii, chip: Chip | None = None) -> None:
        self._image = image
        self.vendor, self.product = sii.vendor, sii.product
        self.revision, self.serial = sii.revision, sii.serial
        self.alias, self.order, self.name = sii.alias, sii.order, sii.name
        self.group, self.group_name = sii.group, sii.group_name
        self.ebus_current, self.physical_ports = sii.ebus_current, sii.physical_ports
        self.pdi_control = sii.pdi_control
        self.mailbox = _mailbox(sii, sii.mailbox)
        self.bootstrap = _mailbox(sii, sii.bootstrap) if self.mailbox else None
        self.sync_managers = [
            SyncManager(_purpose(sm), sm.start, sm.length, sm.control, sm.enable)
            for sm in sii.sync_managers
        ] or None
        if sii.has_idns:
            self.idns = telegram_idns((*sii.outputs, *sii.inputs))
            self.rx_pdos, self.tx_pdos = _telegrams(sii.outputs, sii.inputs)
        else:
            self.rx_pdos, self.tx_pdos = _pdos(sii.outputs), _pdos(sii.inputs)
        self.emulated = bool(sii.pdi_control & _DEVICE_EMULATION) and self.mailbox is None
        self.variable_assignment = bool(sii.coe & _PDO_ASSIGN)
        configurable = bool(sii.coe & _PDO_CONFIGURATION)
        indices = [pdo.index for pdo in (*self.rx_pdos, *self.tx_pdos)]
        self.variable_mapping = [i for i in indices if configurable and i not in sii.fixed]
        self.chip = chip or _chip(sii)
        super().__init__()

    def sii_image(self) -> bytes:
        """Returns the content of the EEPROM, unchanged."""
        return self._image


def device_from_sii(
    image: bytes, source: str, *, strict: bool | None = None, chip: Chip | None = None
) -> Device:
    """Makes a device from an SII image; `remarks` has what is wrong in it.

    Args:
        image: The whole EEPROM.
        source: Origin of the image, for messages.
        strict: Whether to refuse a damaged image. Else the device leaves out the damaged parts, but
            the master reads the whole image, which shows how it handles the damage. An image that
            is only unusual is never refused. None refuses one without an identity.
        chip: The slave controller; None chooses the smallest common one that has all it needs.

    Raises:
        ConfigError: The image is damaged (the message names the first problem), or larger than any
            EEPROM.
    """
    if len(image) > MAX_IMAGE:
        raise ConfigError(f"{source}: {len(image)} bytes: an EEPROM has at most 512 KiB")
    sii = check_sii(image)
    if strict is None and len(image) < 2 * FIRST_CATEGORY:
        raise ConfigError(f"{source}: {sii.problems[0].where_and_what}")
    if strict and sii.damaged:
        damage = [problem for problem in sii.problems if problem.damage]
        more = f" (and {len(damage) - 1} more)" if len(damage) > 1 else ""
        raise ConfigError(f"{source}: {damage[0].where_and_what}{more}")
    try:
        device = DeviceFromSii(image, sii, chip)
        device.remarks = [f"{source}: {problem}" for problem in sii.problems]
        return device
    except UsageError as error:
        raise ConfigError(f"{source}: {error}") from error


def _purpose(manager: SiiSyncManager) -> SmType:
    right = manager.usage <= max(SmType) and manager.holds(manager.length)
    return SmType(manager.usage) if right else SmType.UNUSED


def _mailbox(sii: Sii, box: SiiMailbox) -> Mailbox | None:
    low, high = MAILBOX_SIZES
    areas = ((box.receive, box.receive_size), (box.send, box.send_size))
    usable = all(
        low <= size <= high and start >= _RAM and in_memory(start, size) for start, size in areas
    )
    if not (sii.mailbox_protocols and usable):
        return None
    return Mailbox(
        box.receive, box.receive_size, box.send, box.send_size, sii.mailbox_protocols, sii.coe
    )


def _chip(sii: Sii) -> Chip:
    """Chooses the smallest common controller that has everything the SII needs."""
    ends = [sm.start + sm.length for sm in sii.sync_managers if in_memory(sm.start, sm.length)]
    if sii.mailbox_protocols:
        ends += [sii.mailbox.send + sii.mailbox.send_size]
        ends += [sii.mailbox.receive + sii.mailbox.receive_size]
    mapped: Counter[int] = Counter()
    for pdo in (*sii.outputs, *sii.inputs):
        mapped[pdo.sync_manager] += pdo.bit_length
    for number, sm in enumerate(sii.sync_managers):
        if in_memory(sm.start, size := (mapped[number] + 7) // 8):
            ends.append(sm.start + size)
    needed = max(ends, default=_RAM) - _RAM
    smallest = 8 if sii.mailbox_protocols else 1
    ports = sum(_PORT_KINDS.get(sii.physical_ports >> 4 * i & 0x0F, 0) << 2 * i for i in range(4))
    channels = 8 if sii.mailbox_protocols else 4
    return Chip(
        fmmus=min(16, max(channels, len(sii.fmmus))),
        sync_managers=min(16, max(channels, len(sii.sync_managers))),
        ram_kib=next((k for k in _RAM_SIZES if k >= smallest and 1024 * k >= needed), 60),
        ports=ports if ports & _PORT_0 else Chip().ports,
    )


def _pdos(pdos: list[Pdo]) -> tuple[Pdo, ...]:
    """Converts PDOs of the SII to those of a device."""
    return tuple(
        Pdo(pdo.index, pdo.name, pdo.sync_manager, [_entry(entry) for entry in pdo.entries])
        for pdo in pdos
    )


def _telegrams(*directions: list[Pdo]) -> Iterator[tuple[Pdo, ...]]:
    """Converts PDOs whose indices are IDNs.

    They get other indices: in the dictionary, which no master reads, a PDO and an entry can have
    no index in common.
    """
    free = count(_INTERNAL)

    def typed(entry: Entry) -> Entry:
        return replace(entry, data_type=_type(entry.data_type, entry.bit_length))

    for pdos in directions:
        yield tuple(
            replace(pdo, index=next(free), entries=list(map(typed, pdo.entries))) for pdo in pdos
        )


def _entry(entry: Entry) -> Entry:
    dummy = entry.index <= _LAST_DUMMY and entry.subindex == 0
    gap = dummy or entry.index == 0
    return Entry(
        0 if gap else entry.index,
        0 if gap else entry.subindex,
        entry.name,
        DataType.PADDING if gap else _type(entry.data_type, entry.bit_length),
        entry.bit_length,
    )


def _type(data_type: int, bits: int) -> DataType:
    """Returns the data type of an entry, by its size if the SII has no fitting type."""
    try:
        known = DataType(data_type)
    except ValueError:
        known = DataType.PADDING
    size = bit_length(known)
    if (known in STRINGS and bits % 8 == 0) or bits == size or (bits < size and not is_real(known)):
        return known
    return type_of_bits(bits, signed=is_signed(known))

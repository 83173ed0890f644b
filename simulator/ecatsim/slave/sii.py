"""Builds SII images, the content of the EEPROM (ETG.2010, ETG.1000.6 "SII coding")."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum

from ecatd.base.errors import UsageError
from ecatd.etg.pdo import Pdo
from ecatd.etg.sii import UNASSIGNED as UNASSIGNED
from ecatd.etg.sii_check import sii_checksum as checksum
from ecatd.etg.wire_text import decode_text, encode_text

_HEADER_WORDS = 0x40
_MAX_STRINGS = 255
_VIRTUAL = 0x04
_RAM = 0x1000
_MAX_STRING = 255


class Category(IntEnum):
    """Types of SII categories."""

    STRINGS = 10
    GENERAL = 30
    FMMU = 40
    SYNC_MANAGER = 41
    TX_PDO = 50
    RX_PDO = 51
    DC = 60
    END = 0xFFFF


class SmType(IntEnum):
    """The purpose of a sync manager, as in object 0x1C00."""

    UNUSED = 0
    MAILBOX_OUT = 1
    MAILBOX_IN = 2
    OUTPUTS = 3
    INPUTS = 4


class FmmuType(IntEnum):
    """The purpose of an FMMU."""

    UNUSED = 0
    OUTPUTS = 1
    INPUTS = 2
    MAILBOX_STATE = 3


@dataclass(frozen=True, slots=True)
class SyncManager:
    """Default settings of a sync manager.

    Attributes:
        type: Purpose of the sync manager.
        start: First byte in the memory of the slave.
        size: Size in bytes; for process data, that of the default PDOs.
        control: Control register 0x0804: mode, direction, events, watchdog.
        enable: Bit 0 goes to the activate register 0x0806; bit 2: virtual; bit 3: used in OP only.
    """

    type: SmType
    start: int
    size: int
    control: int
    enable: int = 1

    @property
    def virtual(self) -> bool:
        """Whether an FMMU maps this memory without a sync manager; see `SiiSyncManager`."""
        return bool(self.enable & _VIRTUAL)

    @property
    def in_registers(self) -> bool:
        """Whether its memory is among the registers of the slave controller."""
        return self.virtual and self.start < _RAM


@dataclass(frozen=True, slots=True)
class Mailbox:
    """The mailbox of a slave, as seen from the slave.

    Attributes:
        receive: Address of the mailbox that the master writes.
        receive_size: Size of this mailbox in bytes.
        send: Address of the mailbox that the master reads.
        send_size: Size of this mailbox in bytes.
        protocols: Bits: 1 AoE, 2 EoE, 4 CoE, 8 FoE, 16 SoE, 32 VoE.
        coe_details: Bits: 1 SDO, 2 SDO information, 4 PDO assignment, 8 PDO configuration,
            16 upload at start-up, 32 complete access.
    """

    receive: int = 0x1000
    receive_size: int = 128
    send: int = 0x1080
    send_size: int = 128
    protocols: int = 0x04
    coe_details: int = 0x07


@dataclass(frozen=True, slots=True)
class DcMode:
    """A way to use SYNC signals that a master may choose (category 60, ESI `Dc/OpMode`).

    Attributes:
        name: Name of the mode; the first mode is the default.
        assign_activate: Value for the registers 0x0980 and 0x0981: 0 free run, 0x0300 SYNC0,
            0x0700 SYNC0 and SYNC1.
        sync0_cycle_ns: Cycle time of SYNC0; 0 means the bus cycle times `sync0_factor`.
        sync0_factor: Length of a SYNC0 cycle in bus cycles; a negative factor divides.
        sync0_shift_ns: Shift of SYNC0 against the bus cycle.
        sync1_cycle_factor: Length of a SYNC1 cycle in SYNC0 cycles; a negative factor divides the
            bus cycle.
        sync1_shift_ns: Shift of SYNC1 against SYNC0.
        description: Text that the master may show.
    """

    name: str
    assign_activate: int = 0x0300
    sync0_cycle_ns: int = 0
    sync0_factor: int = 1
    sync0_shift_ns: int = 0
    sync1_cycle_factor: int = 0
    sync1_shift_ns: int = 0
    description: str = ""


@dataclass(slots=True)
class Description:
    """All data of an SII image.

    Attributes:
        vendor: Vendor ID.
        product: Product code.
        revision: Revision number.
        serial: Serial number.
        alias: Configured station alias.
        order: Order code; string 1, which SOEM shows as the name.
        name: Name of the device.
        group: Group type.
        group_name: Name of the group.
        pdi_control: Word 0, loaded into register 0x0140.
        pdi_config: Word 1, loaded into register 0x0150; bits 11 and 15 make SYNC0 and SYNC1 events
            for the device.
        sync_pulse: Word 2, loaded into register 0x0982: length of SYNC pulses in 10 ns; with 0, a
            pulse lasts until the device acknowledges it.
        mailbox: The mailbox, or None.
        bootstrap: The mailbox in BOOT, or None.
        sync_managers: Sync managers by channel.
        fmmus: FMMUs by channel.
        tx_pdos: All TxPDOs; those without a sync manager have 0xFF.
        rx_pdos: All RxPDOs.
        ebus_current: Current drawn from the E-bus in mA; negative if the slave feeds it.
        physical_ports: Nibbles from port 0: 0 none, 1 MII, 3 EBUS.
        no_lrw: Whether the slave cannot process LRW.
        tells_identification: Whether the slave reports its identification on request (AL control).
        identification_register: Address in its ESC where its identification is; 0 for none.
        dc_modes: The ways in which it can use SYNC signals.
        config_data: First bytes of the image, up to 14, which replace those of the fields above.
        pdo_flags: Flags of PDOs by index: 0x01 mandatory, 0x10 fixed content.
        categories: Further categories, each with type and data.
        size: Smallest size of the image in bytes.
    """

    vendor: int
    product: int
    revision: int
    serial: int = 0
    alias: int = 0
    order: str = ""
    name: str = ""
    group: str = ""
    group_name: str = ""
    pdi_control: int = 0
    pdi_config: int = 0
    sync_pulse: int = 0
    mailbox: Mailbox | None = None
    bootstrap: Mailbox | None = None
    sync_managers: Sequence[SyncManager] = ()
    fmmus: Sequence[FmmuType] = ()
    tx_pdos: Sequence[Pdo] = ()
    rx_pdos: Sequence[Pdo] = ()
    ebus_current: int = 0
    physical_ports: int = 0x11
    no_lrw: bool = False
    tells_identification: bool = False
    identification_register: int = 0
    dc_modes: Sequence[DcMode] = ()
    config_data: bytes = b""
    pdo_flags: Mapping[int, int] = field(default_factory=dict)
    categories: Sequence[tuple[int, bytes]] = ()
    size: int = 2048


@dataclass(slots=True)
class _Strings:
    """The string category: each text once, numbered from 1; 0 means no text."""

    texts: list[bytes] = field(default_factory=list)
    cut: list[str] = field(default_factory=list)
    left_out: set[bytes] = field(default_factory=set)

    def number(self, text: str, *, force: bool = False) -> int:
        raw = encode_text(text, _MAX_STRING)
        if decode_text(raw) != text:
            self.cut.append(text)
        if not raw and not force:
            return 0
        if raw not in self.texts:
            if len(self.texts) == _MAX_STRINGS:
                self.left_out.add(raw)
                return 0
            self.texts.append(raw)
        return self.texts.index(raw) + 1

    def tell(self, tell: Callable[[str], None]) -> None:
        """Tells which texts have no room."""
        for text in dict.fromkeys(self.cut):
            tell(f"the name '{text[:40]}…' has more than {_MAX_STRING} bytes; its end is left out")
        if self.left_out:
            text = f"there are {len(self.left_out) + _MAX_STRINGS} names"
            tell(f"{text}, and an EEPROM has room for {_MAX_STRINGS}; the others are left out")

    def encode(self) -> bytes:
        body = b"".join(bytes([len(text)]) + text for text in self.texts)
        return bytes([len(self.texts)]) + body


def _category(kind: int, body: bytes) -> bytes:
    if len(body) % 2:
        body += b"\xff"
    return struct.pack("<HH", kind, len(body) // 2) + body


def _pdos(pdos: Iterable[Pdo], strings: _Strings, flags: Mapping[int, int]) -> bytes:
    parts = []
    for pdo in pdos:
        head = (pdo.index, len(pdo.entries), pdo.sync_manager, 0, strings.number(pdo.name))
        parts.append(struct.pack("<HBBBBH", *head, flags.get(pdo.index, 0)))
        parts += [
            struct.pack(
                "<HBBBBH",
                entry.index,
                entry.subindex,
                strings.number(entry.name),
                entry.data_type,
                entry.bit_length,
                0,
            )
            for entry in pdo.entries
        ]
    return b"".join(parts)


def _dc_modes(modes: Iterable[DcMode], strings: _Strings) -> bytes:
    parts = []
    for mode in modes:
        numbers = (
            mode.sync0_cycle_ns,
            mode.sync0_shift_ns,
            mode.sync1_shift_ns,
            mode.sync1_cycle_factor,
            mode.assign_activate,
            mode.sync0_factor,
        )
        texts = strings.number(mode.name), strings.number(mode.description)
        try:
            parts.append(struct.pack("<IiihHhBB4x", *numbers, *texts))
        except struct.error as error:
            raise UsageError(
                f"DC mode '{mode.name}': a number does not fit into SII category 60: {error}"
            ) from error
    return b"".join(parts)


def _general(info: Description, strings: _Strings) -> bytes:
    mailbox = info.mailbox
    group = strings.number(info.group)
    return struct.pack(
        "<BBBBxBBBBBBBhBxHH12x",
        group,
        0,  # no image
        strings.number(info.order, force=True),
        strings.number(info.name),
        mailbox.coe_details if mailbox and mailbox.protocols & 0x04 else 0,
        1 if mailbox and mailbox.protocols & 0x08 else 0,
        1 if mailbox and mailbox.protocols & 0x02 else 0,
        0,  # SoE channels
        0,  # DS402 channels
        0,  # SysMan class
        (0x02 if info.no_lrw else 0) | _identification_flags(info),
        info.ebus_current,
        strings.number(info.group_name),
        info.physical_ports,
        info.identification_register,
    )


def _identification_flags(info: Description) -> int:
    if info.identification_register:
        return 0x10
    return 0x08 if info.tells_identification else 0


def _header(info: Description, size: int) -> bytes:
    header = bytearray(2 * _HEADER_WORDS)
    words = (info.pdi_control, info.pdi_config, info.sync_pulse, 0, info.alias)
    struct.pack_into("<5H", header, 0, *words)
    header[: len(info.config_data)] = info.config_data
    struct.pack_into("<H", header, 14, checksum(bytes(header[:14])))
    struct.pack_into("<IIII", header, 16, info.vendor, info.product, info.revision, info.serial)
    if info.bootstrap:
        box = info.bootstrap
        areas = (box.receive, box.receive_size, box.send, box.send_size)
        struct.pack_into("<HHHH", header, 2 * 0x14, *areas)
    if info.mailbox:
        box = info.mailbox
        struct.pack_into(
            "<HHHHH",
            header,
            2 * 0x18,
            box.receive,
            box.receive_size,
            box.send,
            box.send_size,
            box.protocols,
        )
    struct.pack_into("<HH", header, 2 * 0x3E, size * 8 // 1024 - 1, 1)
    return bytes(header)


def build(info: Description, tell: Callable[[str], None] = lambda text: None) -> bytes:
    """Builds the SII image, padded with 0xFF to `info.size`, doubled as often as necessary.

    Args:
        info: The data.
        tell: Called with what has no room in an image.

    Raises:
        UsageError: The description does not fit into an SII image.
    """
    strings = _Strings()
    strings.number(info.order, force=True)
    general = _general(info, strings)
    tx_pdos = _pdos(info.tx_pdos, strings, info.pdo_flags)
    rx_pdos = _pdos(info.rx_pdos, strings, info.pdo_flags)
    dc_modes = _dc_modes(info.dc_modes, strings)
    strings.tell(tell)
    parts = [_category(Category.STRINGS, strings.encode()), _category(Category.GENERAL, general)]
    if info.fmmus:
        parts.append(_category(Category.FMMU, bytes(info.fmmus) + b"\xff" * (len(info.fmmus) % 2)))
    if info.sync_managers:
        body = b"".join(
            struct.pack("<HHBBBB", sm.start, sm.size, sm.control, 0, sm.enable, sm.type)
            for sm in info.sync_managers
        )
        parts.append(_category(Category.SYNC_MANAGER, body))
    if tx_pdos:
        parts.append(_category(Category.TX_PDO, tx_pdos))
    if rx_pdos:
        parts.append(_category(Category.RX_PDO, rx_pdos))
    if dc_modes:
        parts.append(_category(Category.DC, dc_modes))
    parts += [_category(kind, data) for kind, data in info.categories]
    parts.append(struct.pack("<H", Category.END))
    body = b"".join(parts)
    size = info.size
    while size < 2 * _HEADER_WORDS + len(body):
        size *= 2
    if size > 0x20000:
        raise UsageError(f"the SII image of {info.order or 'a device'} would exceed 128 KiB")
    return (_header(info, size) + body).ljust(size, b"\xff")

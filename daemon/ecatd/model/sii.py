"""Reading the Slave Information Interface, the EEPROM of a slave (ETG.2010).

The first 64 words have a fixed meaning; from word 0x40 on come categories, each with its type and
its length in words. Everything here may be wrong in a real device: `SiiError` says what and where.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from .bus import Entry, Pdo
from .errors import StateError

CATEGORY_STRINGS = 10
CATEGORY_GENERAL = 30
CATEGORY_FMMU = 40
CATEGORY_SYNC_MANAGER = 41
CATEGORY_TXPDO = 50
CATEGORY_RXPDO = 51
CATEGORY_END = 0xFFFF

_FIRST_CATEGORY = 0x40
_WORDS_MAX = 0x8000
_CATEGORIES_MAX = 256


class SiiError(StateError):
    """An EEPROM whose content makes no sense."""


@dataclass(slots=True)
class SiiSyncManager:
    """One sync manager (category 41): how the vendor wants it set up.

    Attributes:
        start: Physical start address.
        length: Default length in bytes.
        control: Control register (0x0804).
        enable: Bit 0: to be enabled.
        usage: 1 mailbox out, 2 mailbox in, 3 process data outputs, 4 process data inputs.
    """

    start: int
    length: int
    control: int
    enable: int
    usage: int


@dataclass(slots=True)
class Sii:
    """What a master needs from an SII.

    Attributes:
        alias: Configured station alias.
        vendor: Vendor ID.
        product: Product code.
        serial: Serial number.
        mailbox_protocols: Bit 2: CoE; bit 3: FoE (word 0x1C).
        name: Device name from the general category, empty if there is none.
        order: Order code from the general category, empty if there is none.
        coe: CoE details from the general category; bit 0: SDO, bit 1: SDO information.
        without_lrw: Whether the slave cannot do LRW.
        sync_managers: Sync managers in order.
        inputs: TxPDOs.
        outputs: RxPDOs.
    """

    alias: int = 0
    vendor: int = 0
    product: int = 0
    serial: int = 0
    mailbox_protocols: int = 0
    name: str = ""
    order: str = ""
    coe: int = 0
    without_lrw: bool = False
    sync_managers: list[SiiSyncManager] = field(default_factory=list)
    inputs: list[Pdo] = field(default_factory=list)
    outputs: list[Pdo] = field(default_factory=list)


class _Words:
    """The EEPROM as words, read four bytes at a time and only where somebody looks."""

    def __init__(self, read: Callable[[int], bytes]) -> None:
        self._read = read
        self._cache: dict[int, bytes] = {}

    def bytes(self, word: int, count: int) -> bytes:
        data = b""
        for address in range(word & ~1, word + count, 2):
            if address not in self._cache:
                self._cache[address] = self._read(address)
            data += self._cache[address]
        start = 2 * (word & 1)
        return data[start : start + 2 * count]


def read_sii(read: Callable[[int], bytes]) -> Sii:
    """Reads an SII.

    Args:
        read: Gives four bytes from a word address on.

    Raises:
        SiiError: The content makes no sense.
    """
    words = _Words(read)
    sii = Sii()
    (sii.alias,) = struct.unpack("<H", words.bytes(0x04, 1))
    sii.vendor, sii.product = struct.unpack("<II", words.bytes(0x08, 4))
    (sii.serial,) = struct.unpack("<I", words.bytes(0x0E, 2))
    (sii.mailbox_protocols,) = struct.unpack("<H", words.bytes(0x1C, 1))
    categories = dict(_categories(words))
    strings = _strings(categories.get(CATEGORY_STRINGS, b""))
    _read_general(sii, categories.get(CATEGORY_GENERAL, b""), strings)
    rows = categories.get(CATEGORY_SYNC_MANAGER, b"")
    sii.sync_managers = [
        SiiSyncManager(start, length, control, enable, usage)
        for start, length, control, _status, enable, usage in struct.iter_unpack(
            "<HHBBBB", rows[: len(rows) // 8 * 8]
        )
    ]
    sii.inputs = _pdos(categories.get(CATEGORY_TXPDO, b""), strings, "TxPDO")
    sii.outputs = _pdos(categories.get(CATEGORY_RXPDO, b""), strings, "RxPDO")
    return sii


def _categories(words: _Words) -> Iterator[tuple[int, bytes]]:
    at = _FIRST_CATEGORY
    for _ in range(_CATEGORIES_MAX):
        if at + 2 > _WORDS_MAX:
            raise SiiError(f"the category at word 0x{at:04X} lies beyond the largest EEPROM")
        kind, length = struct.unpack("<HH", words.bytes(at, 2))
        if kind == CATEGORY_END:
            return
        if kind == 0 and length == 0:
            raise SiiError(f"there is no category at word 0x{at:04X}, only zeros")
        if at + 2 + length > _WORDS_MAX:
            raise SiiError(
                f"category {kind} at word 0x{at:04X} claims {length} words, more than fit"
            )
        if kind in (
            CATEGORY_STRINGS,
            CATEGORY_GENERAL,
            CATEGORY_SYNC_MANAGER,
            CATEGORY_TXPDO,
            CATEGORY_RXPDO,
        ):
            yield kind, words.bytes(at + 2, length)
        at += 2 + length
    raise SiiError(f"more than {_CATEGORIES_MAX} categories")


def _strings(data: bytes) -> list[str]:
    """Strings by number; number 0 is the empty one."""
    strings = [""]
    if not data:
        return strings
    at = 1
    for number in range(1, data[0] + 1):
        if at >= len(data) or at + 1 + data[at] > len(data):
            raise SiiError(f"string {number} of {data[0]} ends beyond its category")
        text = data[at + 1 : at + 1 + data[at]]
        strings.append(_decode(text))
        at += 1 + data[at]
    return strings


def _decode(text: bytes) -> str:
    """The standard says visible string; vendors write UTF-8 or Latin-1."""
    try:
        decoded = text.decode("utf-8")
    except UnicodeDecodeError:
        decoded = text.decode("latin-1")
    return "".join(c if c.isprintable() else " " for c in decoded.split("\0", 1)[0]).strip()


def _string(strings: list[str], number: int) -> str:
    return strings[number] if number < len(strings) else ""


def _read_general(sii: Sii, data: bytes, strings: list[str]) -> None:
    if len(data) < 12:
        return
    sii.order = _string(strings, data[2])
    sii.name = _string(strings, data[3])
    sii.coe = data[5]
    sii.without_lrw = bool(data[0x0B] & 0x02)


def _pdos(data: bytes, strings: list[str], kind: str) -> list[Pdo]:
    pdos = []
    at = 0
    while at + 8 <= len(data):
        index, count, sync_manager, _dc, name, _flags = struct.unpack_from("<HBBBBH", data, at)
        at += 8
        if at + 8 * count > len(data):
            raise SiiError(f"{kind} 0x{index:04X} claims {count} entries, more than there are")
        entries = [
            Entry(entry_index, subindex, _string(strings, entry_name), data_type, bits)
            for entry_index, subindex, entry_name, data_type, bits, _flags in struct.iter_unpack(
                "<HBBBBH", data[at : at + 8 * count]
            )
        ]
        at += 8 * count
        pdos.append(Pdo(index, _string(strings, name), sync_manager, entries))
    return pdos

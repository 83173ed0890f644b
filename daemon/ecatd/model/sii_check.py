"""What is wrong with an SII image (ETG.2010), and what can be read of it all the same."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NoReturn

from .bus import Pdo
from .sii import (
    CATEGORY_DC,
    CATEGORY_FMMU,
    FIRST_CATEGORY,
    UNASSIGNED,
    Sii,
    SiiError,
    SiiMailbox,
    SiiReader,
    SiiSyncManager,
)

_CHECKED_BYTES = 14
_CHECKSUM_OFF = b"\xa4\x88"  # for development: the ESC takes it as right
_GENERAL_BYTES = 18
MAX_IMAGE = 0x80000  # bytes: the largest EEPROM that a slave controller can have
_MAX_PROBLEMS = 100
_DIGITAL_OUTPUTS = (0x0F00, 0x0F04)
_RAM = (0x1000, 0x10000)
MAILBOX_SIZES = (24, 1486)
"""Smallest mailbox that carries an SDO, and the largest that fits a frame, in bytes."""
_PDO_INDICES = {"RxPDO": (0x1600, 0x17FF), "TxPDO": (0x1A00, 0x1BFF)}
_USAGES = {"RxPDO": 3, "TxPDO": 4}


@dataclass(frozen=True, slots=True)
class SiiProblem:
    """Something in an SII image that is against ETG.2010.

    Attributes:
        byte: Offset in the image.
        text: What is wrong and, where that is not plain, what is allowed.
    """

    byte: int
    text: str

    def __str__(self) -> str:
        return f"byte 0x{self.byte:04X} (word 0x{self.byte // 2:04X}): {self.text}"


def check_sii(image: bytes) -> tuple[Sii, list[SiiProblem]]:
    """Reads a whole SII image and tells what is wrong with it.

    Beyond the end of the image an EEPROM reads as 0xFF. A category that makes no sense is left
    out, or read up to where it does.
    """
    reader = _ImageReader(image)
    return reader.read(), reader.problems


def is_description(index: int) -> bool:
    """Whether an object says what the process data are: PDO mapping and assignment."""
    return 0x1600 <= index < 0x1C00 or index in (0x1C00, 0x1C12, 0x1C13)


def in_memory(start: int, size: int) -> bool:
    """Whether an ESC can have memory there: process data RAM, or digital outputs."""
    end = start + size
    return any(low <= start < high and end <= high for low, high in (_DIGITAL_OUTPUTS, _RAM))


def sii_checksum(data: bytes) -> int:
    """CRC of the configuration area: x^8 + x^2 + x + 1, initial value 0xFF."""
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = ((crc << 1) ^ (0x07 if crc & 0x80 else 0)) & 0xFF
    return crc


class _ImageReader(SiiReader):
    """Decodes a whole SII image and notes everything that is wrong with it."""

    wanted = SiiReader.wanted | {CATEGORY_FMMU, CATEGORY_DC}

    def __init__(self, image: bytes) -> None:
        super().__init__(lambda word, count: image[2 * word : 2 * (word + count)], len(image))
        self._head = image[: 2 * FIRST_CATEGORY].ljust(2 * FIRST_CATEGORY, b"\xff")
        self.problems: list[SiiProblem] = []
        self._indices: set[int] = set()  # of the PDOs so far
        self._bits: Counter[int] = Counter()  # of the mapped PDOs so far, by sync manager
        if len(image) % 2 or len(image) > MAX_IMAGE:
            self.note(
                len(image),
                f"the image has {len(image)} bytes: words, and at most {MAX_IMAGE} bytes, fit "
                "into an EEPROM",
            )
        if len(image) < 2 * FIRST_CATEGORY:
            self.note(len(image), f"the image ends within its first {2 * FIRST_CATEGORY} bytes")

    def stop(self, byte: int, text: str) -> NoReturn:
        """Leaves the category."""
        self.note(byte, text)
        raise SiiError(text)

    def note(self, byte: int, text: str) -> None:
        """Keeps the problem."""
        if len(self.problems) < _MAX_PROBLEMS:
            self.problems.append(SiiProblem(byte, text))

    def attempt(self, step: Callable[..., None], *arguments: Any) -> None:
        """Decodes a part as far as it goes."""
        with suppress(SiiError):
            step(*arguments)

    def header(self) -> None:
        """The fixed words and their checksum."""
        sii, head = self.sii, self._head
        found, right = head[_CHECKED_BYTES], sii_checksum(head[:_CHECKED_BYTES])
        if found != right and head[_CHECKED_BYTES : _CHECKED_BYTES + 2] != _CHECKSUM_OFF:
            self.note(
                _CHECKED_BYTES,
                f"the checksum of the first {_CHECKED_BYTES} bytes is 0x{found:02X}, but they "
                f"give 0x{right:02X}",
            )
        sii.pdi_control, sii.pdi_config = struct.unpack_from("<HH", head)
        (sii.alias,) = struct.unpack_from("<H", head, 2 * 0x04)
        sii.vendor, sii.product, sii.revision, sii.serial = struct.unpack_from("<IIII", head, 16)
        sii.bootstrap = SiiMailbox(*struct.unpack_from("<HHHH", head, 2 * 0x14))
        sii.mailbox = SiiMailbox(*struct.unpack_from("<HHHH", head, 2 * 0x18))
        (sii.mailbox_protocols,) = struct.unpack_from("<H", head, 2 * 0x1C)
        if sii.mailbox_protocols:
            self._check_mailbox(sii.mailbox)

    def _check_mailbox(self, box: SiiMailbox) -> None:
        low, high = MAILBOX_SIZES
        for byte, text, start, size in (
            (0x30, "written", box.receive, box.receive_size),
            (0x34, "read", box.send, box.send_size),
        ):
            if not low <= size <= high:
                self.note(
                    byte + 2,
                    f"the mailbox {text} by the master has {size} bytes: {low} to {high} are "
                    "allowed, or no protocols (word 0x1C)",
                )
            elif start < _RAM[0] or not in_memory(start, size):
                self.note(
                    byte,
                    f"the mailbox {text} by the master takes {size} bytes from 0x{start:04X}: "
                    "memory is from 0x1000 to 0xFFFF",
                )

    def beyond(self, word: int) -> None:
        """An image must end its categories, except where it is no longer than the fixed words."""
        ended = self._words(word, 1) == b"\xff\xff"
        if not ended and (word > FIRST_CATEGORY or self._end > FIRST_CATEGORY):
            self.note(2 * word, "the image ends without the end of categories, 0xFFFF")

    def general(self, at: int, data: bytes) -> None:
        """Category 30, with what only the device itself needs."""
        super().general(at, data)
        if len(data) >= _GENERAL_BYTES:
            sii = self.sii
            sii.group = self._string(at, data[0])
            (sii.ebus_current,) = struct.unpack_from("<h", data, 12)
            sii.group_name = self._string(at + 14, data[14])
            (sii.physical_ports,) = struct.unpack_from("<H", data, 16)

    def check_sync_manager(self, at: int, manager: SiiSyncManager) -> None:
        """Usage and memory of a sync manager."""
        number = len(self.sii.sync_managers) - 1
        if manager.usage > 4:
            self.note(
                at + 7, f"sync manager {number} has the usage {manager.usage}: 0 to 4 are allowed"
            )
        elif manager.usage and not in_memory(manager.start, manager.length):
            self.note(
                at,
                f"sync manager {number} takes {manager.length} bytes from 0x{manager.start:04X}: "
                "memory is from 0x1000 to 0xFFFF, and digital outputs from 0x0F00 to 0x0F03",
            )

    def check_pdo(self, at: int, pdo: Pdo, pdos: list[Pdo]) -> None:
        """Index, sync manager, entries and size of a PDO."""
        kind = "TxPDO" if pdos is self.sii.inputs else "RxPDO"
        label, (low, high) = f"{kind} 0x{pdo.index:04X}", _PDO_INDICES[kind]
        if not low <= pdo.index <= high:
            self.note(at, f"{label}: its index must be from 0x{low:04X} to 0x{high:04X}")
        if pdo.index in self._indices:
            self.note(at, f"{label} occurs a second time")
        self._indices.add(pdo.index)
        for i, entry in enumerate(pdo.entries):
            if entry.bit_length == 0:
                self.note(at + 8 * i + 13, f"{label}: entry {entry.address} has no bits")
            if is_description(entry.index):
                self.note(
                    at + 8 * i + 8,
                    f"{label}: entry {entry.address} describes process data and cannot be part "
                    "of it",
                )
        if pdo.sync_manager != UNASSIGNED and self.sii.sync_managers:
            self._check_assignment(at, pdo, kind)

    def _check_assignment(self, at: int, pdo: Pdo, kind: str) -> None:
        managers, number = self.sii.sync_managers, pdo.sync_manager
        label = f"{kind} 0x{pdo.index:04X}"
        if number >= len(managers):
            self.note(
                at + 3,
                f"{label} lies in sync manager {number}: 0 to {len(managers) - 1} are allowed, "
                "and 255 for none",
            )
            return
        manager = managers[number]
        if manager.usage != _USAGES[kind]:
            self.note(
                at + 3,
                f"{label} lies in sync manager {number}, whose usage is {manager.usage}, "
                f"not {_USAGES[kind]}",
            )
        self._bits[number] += pdo.bit_length
        size = (self._bits[number] + 7) // 8
        if in_memory(manager.start, 1) and not in_memory(manager.start, size):
            self.note(
                at,
                f"up to {label}, the PDOs of sync manager {number} take {size} bytes from "
                f"0x{manager.start:04X}: memory is from 0x1000 to 0xFFFF, and digital outputs "
                "from 0x0F00 to 0x0F03",
            )

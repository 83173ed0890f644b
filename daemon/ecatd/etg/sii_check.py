"""Checks a whole SII image (ETG.2010), and decodes its readable parts."""

from __future__ import annotations

import struct

from .frame_sizes import DATAGRAM_MAX
from .pdo import Entry
from .sii import (
    CATEGORY_DC,
    CATEGORY_FMMU,
    USAGE_INPUTS,
    USAGE_OUTPUTS,
    Sii,
    SiiMailbox,
    SiiSyncManager,
    in_memory,
)
from .sii_categories import FIRST_CATEGORY
from .sii_reader import SiiReader

_CHECKED_BYTES = 14
_CHECKSUM_OFF = b"\xa4\x88"  # for development: an ESC accepts it as correct
_GENERAL_BYTES = 18
MAX_IMAGE = 0x80000  # bytes: the largest EEPROM that an ESC can have
_RAM = 0x1000
MAILBOX_SIZES = (24, DATAGRAM_MAX)
"""Size in bytes of the smallest mailbox that can hold an SDO, and of the largest that fits into
a frame."""
_PDO_INDICES = {USAGE_OUTPUTS: (0x1600, 0x17FF), USAGE_INPUTS: (0x1A00, 0x1BFF)}


def check_sii(image: bytes) -> Sii:
    """Reads a whole SII image; `problems` of the result lists all its errors.

    Bytes after the end of the image count as 0xFF. A malformed category is left out, or read up
    to the malformed part, by the same rules as in a master (`sii_reader.read_sii`).
    """
    return _ImageReader(image).read()


def is_description(index: int) -> bool:
    """Whether an object describes process data: PDO mapping, assignment, or sync manager types."""
    return 0x1600 <= index < 0x1C00 or index in (0x1C00, 0x1C12, 0x1C13)


def sii_checksum(data: bytes) -> int:
    """CRC-8 of the configuration area: polynomial x^8 + x^2 + x + 1, initial value 0xFF."""
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = ((crc << 1) ^ (0x07 if crc & 0x80 else 0)) & 0xFF
    return crc


class _ImageReader(SiiReader):
    """Decodes a whole SII image and notes all its errors."""

    wanted = SiiReader.wanted | {CATEGORY_FMMU, CATEGORY_DC}

    def __init__(self, image: bytes) -> None:
        super().__init__(
            lambda word, count: image[2 * word : 2 * (word + count)].ljust(2 * count, b"\xff")
        )
        self._image = image
        self._told: set[str] = set()  # PDOs whose entries have been noted
        if len(image) % 2 or len(image) > MAX_IMAGE:
            self.note(
                len(image),
                f"the image has {len(image)} bytes: an EEPROM has an even number, and at most "
                f"{MAX_IMAGE}",
            )
        if len(image) < 2 * FIRST_CATEGORY:
            self.note(len(image), f"the image ends within its first {2 * FIRST_CATEGORY} bytes")

    def header(self) -> None:
        """Decodes the fixed words, and checks their checksum."""
        super().header()
        sii, head = self.sii, self._image[: 2 * FIRST_CATEGORY].ljust(2 * FIRST_CATEGORY, b"\xff")
        found, right = head[_CHECKED_BYTES], sii_checksum(head[:_CHECKED_BYTES])
        if found != right and head[_CHECKED_BYTES : _CHECKED_BYTES + 2] != _CHECKSUM_OFF:
            self.note(
                _CHECKED_BYTES,
                f"the checksum of the first {_CHECKED_BYTES} bytes is 0x{found:02X}, but they "
                f"give 0x{right:02X}",
            )
        sii.pdi_control, sii.pdi_config = struct.unpack_from("<HH", head)

    def compare_mailboxes(self) -> None:
        """Compares words and sync managers, and checks the size and the place of the mailbox."""
        words = self.sii.mailbox
        super().compare_mailboxes()
        if self.sii.mailbox_protocols:
            self._check_mailbox(words if words.written else self.sii.mailbox)

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
            elif start < _RAM or not in_memory(start, size):
                self.note(
                    byte,
                    f"the mailbox {text} by the master takes {size} bytes from 0x{start:04X}: "
                    "memory is from 0x1000 to 0xFFFF",
                )

    def begin_category(self, word: int, kind: int, length: int) -> None:
        """Notes a category that the image does not contain completely."""
        if len(self._image) < 2 * (word + 2 + length):
            self.note(
                2 * word,
                f"category {kind} at word 0x{word:04X} has {length} words, but the image ends "
                f"{max(0, len(self._image) // 2 - word - 2)} words behind its beginning",
            )

    def end_of_categories(self, word: int) -> None:
        """Notes an image with categories that lacks the word 0xFFFF after the last one."""
        if len(self._image) < 2 * (word + 1) and word > FIRST_CATEGORY:
            self.note(2 * word, "the image ends without the end of categories, 0xFFFF")

    def general(self, at: int, data: bytes) -> None:
        """Decodes category 30 with all fields, also those that a master does not need."""
        super().general(at, data)
        if len(data) >= _GENERAL_BYTES:
            sii = self.sii
            sii.group = self.string(at, data[0])
            (sii.ebus_current,) = struct.unpack_from("<h", data, 12)
            sii.group_name = self.string(at + 14, data[14])
            (sii.physical_ports,) = struct.unpack_from("<H", data, 16)

    def check_sync_manager(self, at: int, manager: SiiSyncManager) -> None:
        """Checks usage and memory of a sync manager."""
        number = len(self.sii.sync_managers) - 1
        if manager.usage > 4:
            self.note(
                at + 7,
                f"sync manager {number} has the usage {manager.usage}: 0 to 4 are allowed",
                damage=False,
            )
        elif manager.usage and not manager.is_placeholder and not manager.holds(manager.length):
            self.note(
                at,
                f"sync manager {number} takes {manager.length} bytes from 0x{manager.start:04X}: "
                "memory is from 0x1000 to 0xFFFF, and digital outputs from 0x0F00 to 0x0F03",
                "no PDO can lie in it",
                damage=False,  # if one does, this is noted, too
            )

    def check_pdo(self, at: int, index: int, usage: int, label: str) -> None:
        """Checks that the index of a PDO fits its direction."""
        low, high = _PDO_INDICES[usage]
        if not (self.sii.has_idns or low <= index <= high):
            text = f"{label}: its index should be from 0x{low:04X} to 0x{high:04X}"
            self.note(at, text, damage=False)

    def check_entry(self, at: int, entry: Entry, label: str) -> None:
        """Notes an entry that maps an object that describes process data."""
        if is_description(entry.index) and not self.sii.has_idns:
            if label in self._told:
                return
            self._told.add(label)
            text = f"{label}: entry {entry.address} has the index of a PDO"
            self.note(at, text, "it is used as it is, and so are others there", damage=False)

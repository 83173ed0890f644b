"""Decodes an SII, even a malformed one (ETG.2010).

The first 64 words have a fixed meaning. Categories follow from word 0x40 on, each with its type and
its length in words; 0xFFFF follows the last one. Any of this can be wrong in a real device. The
reader decodes what is well-formed, and notes everything else as a problem with its effect.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from contextlib import suppress
from typing import NoReturn

from .pdo import Entry, Pdo
from .sii import (
    CATEGORY_DC,
    CATEGORY_END,
    CATEGORY_FMMU,
    CATEGORY_GENERAL,
    CATEGORY_RXPDO,
    CATEGORY_STRINGS,
    CATEGORY_SYNC_MANAGER,
    CATEGORY_TXPDO,
    UNASSIGNED,
    UNPROGRAMMED,
    USAGE_INPUTS,
    USAGE_OUTPUTS,
    Sii,
    SiiDc,
    SiiMailbox,
    SiiProblem,
    SiiSyncManager,
)
from .sii_placement import Placement

Words = Callable[[int, int], bytes]
"""Returns words of an EEPROM. Arguments: word address, and number of words."""

FIRST_CATEGORY = 0x40
PDO_INDICES = (0x1600, 0x1BFF)
"""First and last index that a PDO of either direction can have (ETG.1000.6)."""

_PROTOCOLS, _SIZE = 0x1C, 0x3E  # words
_WORDS_MAX = 0x10000
_IMAGE_WORDS_MAX = 0x40000  # 4 MBit, the largest EEPROM of ETG.1000.6
_WORDS_PER_KIBIT = 64
_CATEGORIES_MAX = 256
_PROBLEMS_MAX = 100
_SYNC_MANAGER_BYTES, _PDO_BYTES, _DC_BYTES = 8, 8, 24
_BLANK_VENDOR = 0xFFFF_FFFF
_PADDING = 0xFF
_FIXED = 0x10  # flag of a PDO
_KNOWN = {*range(10), 10, 20, 30, 40, 41, 42, 43, 50, 51, 60, 70, 80, 90, 100, 110}
_VENDOR_SPECIFIC = 0x0800  # types from here on; lower ones belong to the standard
_SYNC_MANAGERS_MAX = 16
_MAILBOX_WRITTEN, _MAILBOX_READ = 0x26, 0x22  # control of sync managers 0 and 1 (ETG.1000.4)


def read_sii(words: Words) -> Sii:
    """Reads what a master needs from an SII.

    Args:
        words: Reads words of the EEPROM.
    """
    return SiiReader(words).read()


def read_name(words: Words) -> Sii:
    """Reads what a slave is, and how it tells its identification; nothing of its process data.

    Args:
        words: Reads words of the EEPROM.
    """
    return _NameReader(words).read()


def read_dc_modes(words: Words) -> list[SiiDc]:
    """Reads the operation modes of the distributed clocks (category 60), if there are any.

    Args:
        words: Reads words of the EEPROM.
    """
    return _DcReader(words).read().dc


def read_mailbox(words: Words) -> list[SiiSyncManager]:
    """Reads the settings of the mailbox: sync managers 0 and 1; empty if there is no mailbox.

    They are those of category 41. If it is missing, or does not begin with the two mailboxes, they
    follow from the standard mailbox (words 0x18 to 0x1B).

    Args:
        words: Reads words of the EEPROM.
    """
    sii = _MailboxReader(words).read()
    box, managers = sii.mailbox, sii.sync_managers[:2]
    if box.receive_size in (0, UNPROGRAMMED):
        return []
    if [manager.usage for manager in managers if manager.length] == [1, 2]:
        return managers
    return [
        SiiSyncManager(box.receive, box.receive_size, _MAILBOX_WRITTEN, 1, 1),
        SiiSyncManager(box.send, box.send_size or box.receive_size, _MAILBOX_READ, 1, 2),
    ]


def whole_image(words: Words) -> bytes:
    """Reads a whole EEPROM: the size in word 0x3E, or more if the categories need it."""

    def word(address: int) -> int:
        return int.from_bytes(words(address, 1), "little")

    size = _WORDS_PER_KIBIT * (word(_SIZE) + 1)  # word 0x3E has the size in KiBit, less 1
    at = FIRST_CATEGORY
    for _ in range(_CATEGORIES_MAX):
        if at >= _IMAGE_WORDS_MAX - 1 or word(at) == CATEGORY_END:
            break
        at += 2 + word(at + 1)
    end = min(at + 1, _IMAGE_WORDS_MAX)
    if size > _IMAGE_WORDS_MAX or size < end:
        size = 1 << (end - 1).bit_length()
    return words(0, size)


class _Stop(Exception):  # noqa: N818  not an error, but the end of a part
    """Ends decoding of a malformed category, or of all further categories."""


class SiiReader:
    """Decodes what a master needs from an SII. Subclasses decode more, or less.

    Args:
        words: Reads words of the EEPROM.

    Attributes:
        wanted: Types of the categories that are read.
        sii: What has been decoded.
    """

    wanted = frozenset(
        {
            CATEGORY_STRINGS,
            CATEGORY_GENERAL,
            CATEGORY_SYNC_MANAGER,
            CATEGORY_TXPDO,
            CATEGORY_RXPDO,
        }
    )

    def __init__(self, words: Words) -> None:
        self._words = words
        self._strings = [""]
        self._indices: set[int] = set()  # of the PDOs decoded so far
        self.sii = Sii()
        self._placement = Placement(self.sii.sync_managers)

    def stop(self, byte: int, text: str, effect: str) -> NoReturn:
        """Notes a problem, and ends the part that is being decoded by raising `_Stop`."""
        self.note(byte, text, effect)
        raise _Stop

    def note(self, byte: int, text: str, effect: str = "", *, damage: bool = True) -> None:
        """Adds a problem, unless there are too many already.

        Args:
            byte: Offset in the EEPROM.
            text: What is wrong.
            effect: How the reader handles it.
            damage: Whether information is lost.
        """
        if len(self.sii.problems) < _PROBLEMS_MAX:
            self.sii.problems.append(SiiProblem(byte, text, effect, damage))

    def read(self) -> Sii:
        """Decodes the fixed words and the wanted categories."""
        self.header()
        categories = self._categories()
        # Strings come first, since others refer to them; PDOs need the sync managers.
        for kind, decode in (
            (CATEGORY_STRINGS, self._read_strings),
            (CATEGORY_GENERAL, self.general),
            (CATEGORY_FMMU, self._fmmus),
            (CATEGORY_SYNC_MANAGER, self._sync_managers),
            (CATEGORY_TXPDO, self._inputs),
            (CATEGORY_RXPDO, self._outputs),
            (CATEGORY_DC, self._dc),
        ):
            if kind in categories:
                with suppress(_Stop):
                    decode(*categories[kind])
        if CATEGORY_SYNC_MANAGER in categories and not self.sii.mailbox_protocols:
            self._check_use(categories[CATEGORY_SYNC_MANAGER][0])
        return self.sii

    def _check_use(self, at: int) -> None:
        """Notes process-data sync managers without PDOs, for a slave without a mailbox.

        A slave with a mailbox can describe further PDOs over CoE.
        """
        used = {pdo.sync_manager for pdo in (*self.sii.outputs, *self.sii.inputs)}
        for number, manager in enumerate(self.sii.sync_managers):
            if manager.usage in (USAGE_OUTPUTS, USAGE_INPUTS) and number not in used:
                data = "outputs" if manager.usage == USAGE_OUTPUTS else "inputs"
                self.note(
                    at + _SYNC_MANAGER_BYTES * number,
                    f"sync manager {number} is for {data}, but no PDO lies in it, and there is no "
                    "mailbox that could describe more PDOs",
                    "it is not used",
                )

    def header(self) -> None:
        """Decodes the fixed words."""
        sii = self.sii
        (sii.alias,) = struct.unpack("<H", self._words(0x04, 1))
        identity = self._words(0x08, 8)
        sii.vendor, sii.product, sii.revision, sii.serial = struct.unpack("<IIII", identity)
        *boxes, sii.mailbox_protocols = struct.unpack("<9H", self._words(0x14, 9))
        sii.bootstrap, sii.mailbox = SiiMailbox(*boxes[:4]), SiiMailbox(*boxes[4:])
        if sii.mailbox_protocols == UNPROGRAMMED:
            sii.mailbox_protocols = 0
        if sii.mailbox_protocols and sii.mailbox.receive_size in (0, UNPROGRAMMED):
            self.note(
                2 * _PROTOCOLS,
                f"the mailbox protocols 0x{sii.mailbox_protocols:04X} are announced, but the words "
                "0x18 to 0x1B describe no mailbox",
                "its mailbox is not used",
            )
            sii.mailbox_protocols = 0

    # --- the chain of categories ---------------------------------------------------------------

    def _categories(self) -> dict[int, tuple[int, bytes]]:
        """Reads the wanted categories: by type, the byte offset of the data, and the data."""
        found: dict[int, tuple[int, bytes]] = {}
        present: set[int] = set()
        with suppress(_Stop):
            self._walk(found, present)
            self._check_presence(present)
        return found

    def _walk(self, found: dict[int, tuple[int, bytes]], present: set[int]) -> None:
        at, end = FIRST_CATEGORY, self._size()
        for _ in range(_CATEGORIES_MAX):
            if at >= end:
                self.stop(
                    2 * at,
                    f"the categories reach to the end of the EEPROM, which has {end} words "
                    f"(word 0x{_SIZE:X}), without 0xFFFF behind the last one",
                    "if there are more, they are not read",
                )
            kind, length = struct.unpack("<HH", self._words(at, 2))
            if kind == CATEGORY_END:
                self.end_of_categories(at)
                return
            if kind == 0 and length == 0:
                self.stop(
                    2 * at,
                    f"there is no category at word 0x{at:04X}, only zeros",
                    "the rest is not read",
                )
            if at + 2 + length > end:
                self.stop(
                    2 * at,
                    f"category {kind} at word 0x{at:04X} claims {length} words, more than fit: "
                    f"{max(0, end - at - 2)} are left of the {end} words of the EEPROM "
                    f"(word 0x{_SIZE:X})",
                    "neither this one nor the following ones are read",
                )
            if kind < _VENDOR_SPECIFIC and kind not in _KNOWN:
                self.note(
                    2 * at, f"category {kind} at word 0x{at:04X} is unknown", "it is left out"
                )
            self.begin_category(at, kind, length)
            if kind in found:
                self.note(2 * at, f"category {kind} occurs a second time", "only the first counts")
            elif kind in self.wanted:
                found[kind] = 2 * at + 4, self._words(at + 2, length)
            present.add(kind)
            at += 2 + length
        self.stop(2 * at, f"more than {_CATEGORIES_MAX} categories", "the rest is not read")

    def _size(self) -> int:
        """Number of words that the EEPROM has by word 0x3E; the maximum if this word is 0."""
        (kibit,) = struct.unpack("<H", self._words(_SIZE, 1))
        return min((kibit + 1) * _WORDS_PER_KIBIT, _WORDS_MAX) if kibit else _WORDS_MAX

    def begin_category(self, word: int, kind: int, length: int) -> None:
        """Called for each category, with its word address, type and length in words."""

    def end_of_categories(self, word: int) -> None:
        """Called with the word address of the end of the categories, 0xFFFF."""

    def _check_presence(self, present: set[int]) -> None:
        """Notes missing categories that are required."""
        first, protocols = 2 * FIRST_CATEGORY, self.sii.mailbox_protocols
        if not present:
            blank = self.sii.vendor == _BLANK_VENDOR
            text = "this EEPROM was never written" if blank else "there are no categories"
            self.note(first, text, "name and process data are unknown")
        elif CATEGORY_GENERAL not in present:
            self.note(first, f"category {CATEGORY_GENERAL} (general) is missing", "it has no name")
        missing = f"category {CATEGORY_SYNC_MANAGER} (sync managers) is missing"
        if CATEGORY_SYNC_MANAGER in present:
            return
        if protocols:
            text = f"the mailbox protocols 0x{protocols:04X} are announced, but {missing}"
            self.note(2 * _PROTOCOLS, text, "process data have no place")
        elif CATEGORY_FMMU in present:
            text = f"category {CATEGORY_FMMU} (FMMUs) is there, but {missing}"
            self.note(first, text, "process data have no place")

    # --- single categories ---------------------------------------------------------------------

    def _read_strings(self, at: int, data: bytes) -> None:
        """Decodes category 10: strings, which count from 1; number 0 is the empty string."""
        if not data:
            return
        count, offset = data[0], 1
        for number in range(1, count + 1):
            end = offset + 1 + data[offset] if offset < len(data) else len(data) + 1
            if end > len(data):
                self.stop(
                    at + offset,
                    f"string {number} of {count} ends beyond its category",
                    "it is left out, and those that follow",
                )
            self._strings.append(_decode(data[offset + 1 : end]))
            offset = end

    def string(self, at: int, number: int) -> str:
        """Returns a string by its number; notes a number that does not exist.

        Args:
            at: Byte offset of the number, for the problem.
            number: Number of the string.
        """
        if number < len(self._strings):
            return self._strings[number]
        self.note(
            at,
            f"there is no string {number}: 0 to {len(self._strings) - 1} are allowed",
            "it is taken as empty",
            damage=False,
        )
        return ""

    def general(self, at: int, data: bytes) -> None:
        """Decodes category 30."""
        if len(data) < 12:
            text = f"category 30 has {len(data)} bytes, less than the 12 that matter"
            self.stop(at, text, "it is left out")
        sii = self.sii
        sii.order = self.string(at + 2, data[2])
        sii.name = self.string(at + 3, data[3])
        sii.coe = data[5]
        sii.without_lrw = bool(data[0x0B] & 0x02)
        sii.tells_identification = bool(data[0x0B] & 0x08)
        if data[0x0B] & 0x10 and len(data) >= 0x14:  # ETG.1000.6, identification methods
            (sii.identification_register,) = struct.unpack_from("<H", data, 0x12)

    def _fmmus(self, at: int, data: bytes) -> None:
        for i, usage in enumerate(data):
            if usage != _PADDING:
                self.sii.fmmus.append(usage)
                if usage > 3:
                    text = f"an FMMU has the usage {usage}: 0 to 3 are allowed"
                    self.note(at + i, text, damage=False)

    def _sync_managers(self, at: int, data: bytes) -> None:
        size = _SYNC_MANAGER_BYTES
        self._whole_rows(at, data, size)
        rows = struct.iter_unpack("<HHBBBB", data[: len(data) // size * size])
        for i, (start, length, control, _status, enable, usage) in enumerate(rows):
            manager = SiiSyncManager(start, length, control, enable, usage)
            self.sii.sync_managers.append(manager)
            self.check_sync_manager(at + size * i, manager)
        if (count := len(self.sii.sync_managers)) > _SYNC_MANAGERS_MAX:
            text = f"{count} sync managers are described: a slave controller has up to 16"
            self.note(at, text, "the first of them count")
            del self.sii.sync_managers[_SYNC_MANAGERS_MAX:]

    def check_sync_manager(self, at: int, manager: SiiSyncManager) -> None:
        """Called for each sync manager, so that a subclass can note what is wrong with it."""

    def _whole_rows(self, at: int, data: bytes, size: int) -> None:
        """Notes a table whose last row is incomplete."""
        if len(data) % size:
            text = f"{len(data)} bytes are not whole rows of {size} bytes"
            self.note(at + len(data), text, "the last row is left out")

    def _inputs(self, at: int, data: bytes) -> None:
        self._pdos(at, data, self.sii.inputs, USAGE_INPUTS)

    def _outputs(self, at: int, data: bytes) -> None:
        self._pdos(at, data, self.sii.outputs, USAGE_OUTPUTS)

    def _pdos(self, at: int, data: bytes, pdos: list[Pdo], usage: int) -> None:
        here = 0
        while here + _PDO_BYTES <= len(data):
            index, count, sync_manager, _dc, name, flags = struct.unpack_from("<HBBBBH", data, here)
            label = f"{'RxPDO' if usage == USAGE_OUTPUTS else 'TxPDO'} 0x{index:04X}"
            first, end = here + _PDO_BYTES, here + _PDO_BYTES * (1 + count)
            if end > len(data):
                self.stop(
                    at + here,
                    f"{label} claims {count} entries, more than there are: "
                    f"{(len(data) - first) // _PDO_BYTES} follow",
                    "it is left out, and those that follow",
                )
            pdo = Pdo(index, self.string(at + here + 5, name), sync_manager)
            pdo.entries = self._entries(at + first, data[first:end], label)
            if self._is_known(at + here, index, label):
                self._place(at + here + 3, pdo, usage, label)
                pdos.append(pdo)
                if flags & _FIXED:
                    self.sii.fixed.add(index)
                self.check_pdo(at + here, index, usage, label)
            here = end
        self._whole_rows(at, data, _PDO_BYTES)

    def _entries(self, at: int, data: bytes, label: str) -> list[Entry]:
        entries = []
        for i, (index, subindex, name, data_type, bits, _flags) in enumerate(
            struct.iter_unpack("<HBBBBH", data)
        ):
            text = self.string(at + 8 * i + 3, name)
            entry = Entry(index, subindex, text, data_type, bits)
            if bits:
                entries.append(entry)
                self.check_entry(at + 8 * i, entry, label)
            else:
                text = f"{label}: entry {entry.address} has no bits"
                self.note(at + 8 * i + 5, text, "it is left out")
        return entries

    def _is_known(self, at: int, index: int, label: str) -> bool:
        """Whether a PDO can have this index; notes the reason if not."""
        low, high = PDO_INDICES
        text = ""
        if not low <= index <= high:
            text = f"{label}: its index must be from 0x{low:04X} to 0x{high:04X}"
        elif index in self._indices:
            text = f"{label} occurs a second time"
        if text:
            self.note(at, text, "it is left out")
        self._indices.add(index)
        return not text

    def check_pdo(self, at: int, index: int, usage: int, label: str) -> None:
        """Called for each PDO, so that a subclass can note what is wrong with it."""

    def check_entry(self, at: int, entry: Entry, label: str) -> None:
        """Called for each entry, so that a subclass can note what is wrong with it."""

    def _place(self, at: int, pdo: Pdo, usage: int, label: str) -> None:
        """Removes a PDO from the default mapping if it cannot lie in its sync manager."""
        if pdo.sync_manager == UNASSIGNED:
            return
        if why := self._placement.place(pdo, usage):
            text = f"{label} lies in sync manager {pdo.sync_manager}, {why}"
            self.note(at, text, "it is not mapped")
            pdo.sync_manager = UNASSIGNED

    def _dc(self, at: int, data: bytes) -> None:
        self._whole_rows(at, data, _DC_BYTES)
        for i in range(len(data) // _DC_BYTES):
            cycle, shift0, shift1, factor1, assign, factor0, name = struct.unpack_from(
                "<IiihHhB", data, i * _DC_BYTES
            )
            text = self.string(at + i * _DC_BYTES + 18, name)
            self.sii.dc.append(SiiDc(text, cycle, shift0, shift1, assign, factor0, factor1))


class _NameReader(SiiReader):
    """Decodes only what the slave is."""

    wanted = frozenset({CATEGORY_STRINGS, CATEGORY_GENERAL})


class _DcReader(SiiReader):
    """Decodes only the modes of the distributed clocks."""

    wanted = frozenset({CATEGORY_STRINGS, CATEGORY_DC})


class _MailboxReader(SiiReader):
    """Decodes only the settings of the mailbox."""

    wanted = frozenset({CATEGORY_SYNC_MANAGER})

    def header(self) -> None:
        self.sii.mailbox = SiiMailbox(*struct.unpack("<4H", self._words(0x18, 4)))


def _decode(text: bytes) -> str:
    """Decodes a string as UTF-8 or Latin-1; the standard has VISIBLE_STRING, vendors write both."""
    try:
        decoded = text.decode("utf-8")
    except UnicodeDecodeError:
        decoded = text.decode("latin-1")
    return "".join(c if c.isprintable() else " " for c in decoded.split("\0", 1)[0]).strip()

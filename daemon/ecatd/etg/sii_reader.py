"""Decodes an SII, even a malformed one (ETG.2010).

The first 64 words have a fixed meaning, and categories follow (`sii_categories`). Any of this can
be wrong in a real device. The reader decodes what is well-formed, and notes everything else as a
problem with its effect.
"""

from __future__ import annotations

import struct
from contextlib import suppress

from .pdo import Entry, Pdo
from .sii import (
    CATEGORY_DC,
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
    SiiSyncManager,
    mailbox_managers,
    replace_overlapping,
)
from .sii_categories import FIRST_CATEGORY, CategoryReader, Stop, Words
from .sii_placement import Placement
from .wire_text import decode_text

PDO_INDICES = (0x1600, 0x1BFF)
"""First and last index that a PDO of either direction can have (ETG.1000.6); in a drive with SoE
the index is an IDN."""

_MAILBOX, _PROTOCOLS = 0x18, 0x1C  # words
_PROTOCOL_COE = 0x04
_GENERAL_BYTES, _SYNC_MANAGER_BYTES, _PDO_BYTES, _DC_BYTES = 12, 8, 8, 24
_BLANK_VENDOR = 0xFFFF_FFFF
_PADDING = 0xFF
_FIXED = 0x10  # flag of a PDO
_SYNC_MANAGERS_MAX = 16
_JOINED = {CATEGORY_TXPDO, CATEGORY_RXPDO}


def read_sii(words: Words) -> Sii:
    """Reads what a master needs from an SII.

    Args:
        words: Reads words of the EEPROM.
    """
    return SiiReader(words).read()


class SiiReader(CategoryReader):
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
        super().__init__(words)
        self._strings = [""]
        self._indices: set[int] = set()  # of the PDOs decoded so far
        self._placement = Placement(self.sii.sync_managers)

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
            for at, data in self._once(kind, categories.get(kind, [])):
                with suppress(Stop):
                    decode(at, data)
        self.compare_mailboxes()
        for number, wrong, counts in self._placement.outvoted:
            at = categories[CATEGORY_SYNC_MANAGER][0][0] + _SYNC_MANAGER_BYTES * number
            self.note(at, f"sync manager {number}: {wrong}", counts, damage=False)
        for one, other in self._placement.overlaps():
            at = categories[CATEGORY_SYNC_MANAGER][0][0] + _SYNC_MANAGER_BYTES * other
            text = f"sync managers {one} and {other} overlap"
            self.note(at, text, "the slave may refuse them", damage=False)
        if CATEGORY_SYNC_MANAGER in categories and not self.sii.mailbox_protocols:
            self._check_use(categories[CATEGORY_SYNC_MANAGER][0][0])
        return self.sii

    def compare_mailboxes(self) -> None:
        """Compares the words about the mailbox with the sync managers, which count."""
        sii, words = self.sii, self.sii.mailbox
        managers = mailbox_managers(sii.sync_managers)
        if not managers:
            if sii.mailbox_protocols and not words.written:
                self.note(
                    2 * _PROTOCOLS,
                    f"the mailbox protocols 0x{sii.mailbox_protocols:04X} are announced, but the "
                    "words 0x18 to 0x1B describe no mailbox",
                    "its mailbox is not used",
                )
                sii.mailbox_protocols = 0
            return
        out, back = managers
        described = SiiMailbox(out.start, out.length, back.start, back.length)
        if replace_overlapping(managers, words):
            self.note(
                2 * _MAILBOX,
                f"sync managers 0 and 1 are {described.text}, which overlap, but the words 0x18 to "
                f"0x1B describe {words.text}",
                "the words count",
                damage=False,
            )
            described = words
        if not words.written or (sii.mailbox_protocols and not words.fits(described)):
            what = words.text if words.written else "no mailbox"
            self.note(
                2 * _MAILBOX,
                f"the words 0x18 to 0x1B describe {what}, but sync managers 0 and 1 are "
                f"{described.text}",
                "the sync managers count",
                damage=False,
            )
            sii.mailbox = described
        if not sii.mailbox_protocols and sii.coe:
            self.note(
                2 * _PROTOCOLS,
                "no mailbox protocols are announced, but there are a mailbox and details of CoE "
                f"(0x{sii.coe:02X})",
                "it counts as a slave with CoE",
                damage=False,
            )
            sii.mailbox_protocols = _PROTOCOL_COE

    def _once(self, kind: int, found: list[tuple[int, bytes]]) -> list[tuple[int, bytes]]:
        """The categories of a type that count; notes the others.

        PDOs of all categories count, as some tools write one category for each PDO. Of others the
        first counts. Only in sync managers could another one mean other process data.
        """
        if kind in _JOINED:
            return found
        if kind == CATEGORY_GENERAL:  # the first that can be read
            found = sorted(found, key=lambda item: len(item[1]) < _GENERAL_BYTES)
        for at, data in found[1:]:
            same = data == found[0][1]
            self.note(
                at - 4,
                f"category {kind} occurs a second time{', as it was' if same else ''}",
                "this one is left out",
                damage=kind == CATEGORY_SYNC_MANAGER and not same,
            )
        return found[:1]

    def _check_use(self, at: int) -> None:
        """Notes process-data sync managers without PDOs, for a slave without a mailbox.

        A slave with a mailbox can describe further PDOs over CoE.
        """
        used = {pdo.sync_manager for pdo in (*self.sii.outputs, *self.sii.inputs)}
        none = not used - {UNASSIGNED}
        for number, manager in enumerate(self.sii.sync_managers):
            if manager.is_placeholder:
                continue
            if manager.usage in (USAGE_OUTPUTS, USAGE_INPUTS) and number not in used:
                data = "outputs" if manager.usage == USAGE_OUTPUTS else "inputs"
                self.note(
                    at + _SYNC_MANAGER_BYTES * number,
                    f"sync manager {number} is for {data}, but no PDO lies in it, and there is no "
                    "mailbox that could describe more PDOs",
                    "it is not used",
                    damage=none,
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

    # --- the chain of categories ---------------------------------------------------------------

    def _categories(self) -> dict[int, list[tuple[int, bytes]]]:
        """Reads the wanted categories: by type, byte offset and data of each of this type."""
        found: dict[int, list[tuple[int, bytes]]] = {}
        present: set[int] = set()
        with suppress(Stop):
            self.walk(found, present)
            self._check_presence(present)
        return found

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
        if len(data) < _GENERAL_BYTES:
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
        if not (self.sii.has_idns or low <= index <= high):
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


def _decode(text: bytes) -> str:
    return "".join(c if c.isprintable() else " " for c in decode_text(text)).strip()

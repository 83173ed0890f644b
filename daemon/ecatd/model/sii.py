"""Reading the Slave Information Interface, the EEPROM of a slave (ETG.2010).

The first 64 words have a fixed meaning; from word 0x40 on come categories, each with its type and
its length in words. Everything here may be wrong in a real device. A master (`read_sii`) lives
with what it can and refuses the rest; `sii_check` tells all that is wrong with an image.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, NoReturn

from .bus import Entry, Pdo
from .errors import StateError

CATEGORY_STRINGS = 10
CATEGORY_GENERAL = 30
CATEGORY_FMMU = 40
CATEGORY_SYNC_MANAGER = 41
CATEGORY_TXPDO = 50
CATEGORY_RXPDO = 51
CATEGORY_DC = 60
CATEGORY_END = 0xFFFF
USAGE_OUTPUTS, USAGE_INPUTS = 3, 4
"""What a sync manager is for (category 41)."""

UNASSIGNED = 0xFF
"""In place of a sync manager: the PDO is not mapped by default."""

FIRST_CATEGORY = 0x40
_WORDS_MAX = 0x8000
_CATEGORIES_MAX = 256
_DC_BYTES = 24
_PADDING = 0xFF
_FIXED = 0x10  # flag of a PDO
_UNPROGRAMMED = 0xFFFF  # a word of an EEPROM that nobody has written
_MAILBOX_WRITTEN, _MAILBOX_READ = 0x26, 0x22  # control of sync managers 0 and 1 (ETG.1000.4)


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
class SiiMailbox:
    """Mailbox areas, seen from the slave (words 0x14 to 0x1B).

    Attributes:
        receive: Offset of the mailbox that the master writes.
        receive_size: Its size in bytes.
        send: Offset of the mailbox that the master reads.
        send_size: Its size in bytes.
    """

    receive: int = 0
    receive_size: int = 0
    send: int = 0
    send_size: int = 0

    @property
    def exists(self) -> bool:
        """Whether there is one: words that nobody has written are 0, or 0xFFFF."""
        return all(0 < size < _UNPROGRAMMED for size in (self.receive_size, self.send_size))


@dataclass(slots=True)
class SiiDc:
    """An operation mode of the distributed clocks (category 60).

    Attributes:
        name: Its name.
        cycle_time: Cycle time of SYNC0 in ns; 0: that of the master.
        shift_time0: Shift of SYNC0 in ns.
        shift_time1: Shift of SYNC1 in ns.
        assign_activate: What goes to the registers 0x0980 (low byte) and 0x0981.
        cycle_factor0: Cycle of SYNC0 as a multiple (or, negative, a part) of that of the master.
        cycle_factor1: Cycle of SYNC1 as a multiple (or part) of that of SYNC0.
    """

    name: str
    cycle_time: int
    shift_time0: int
    shift_time1: int
    assign_activate: int
    cycle_factor0: int
    cycle_factor1: int


@dataclass(slots=True)
class Sii:
    """What an SII says.

    The attributes from `pdi_control` on are not read by `read_sii`, but by `sii_check.check_sii`: a
    master does without them, and reading an EEPROM takes its time.

    Attributes:
        alias: Configured station alias.
        vendor: Vendor ID.
        product: Product code.
        revision: Revision number.
        serial: Serial number.
        bootstrap: Mailbox in BOOT; it does not exist where there is no such state.
        mailbox_protocols: Bit 2: CoE; bit 3: FoE (word 0x1C).
        name: Device name from the general category, empty if there is none.
        order: Order code from the general category, empty if there is none.
        coe: CoE details from the general category; bit 0: SDO, bit 1: SDO information.
        without_lrw: Whether the slave cannot do LRW.
        sync_managers: Sync managers in order.
        inputs: TxPDOs.
        outputs: RxPDOs.
        pdi_control: Word 0; bit 8: the ESC itself answers AL control (device emulation).
        pdi_config: Word 1.
        mailbox: Standard mailbox.
        group: Group type.
        group_name: Name of the group.
        ebus_current: Current taken from the E-bus in mA; negative where it is fed.
        physical_ports: Nibbles from port 0: 0 none, 1 MII, 3 EBUS.
        fmmus: Purposes of the FMMUs: 1 outputs, 2 inputs, 3 mailbox state.
        dc: Operation modes of the distributed clocks.
        fixed: Indices of PDOs whose entries cannot be changed.
    """

    alias: int = 0
    vendor: int = 0
    product: int = 0
    revision: int = 0
    serial: int = 0
    bootstrap: SiiMailbox = field(default_factory=SiiMailbox)
    mailbox_protocols: int = 0
    name: str = ""
    order: str = ""
    coe: int = 0
    without_lrw: bool = False
    sync_managers: list[SiiSyncManager] = field(default_factory=list)
    inputs: list[Pdo] = field(default_factory=list)
    outputs: list[Pdo] = field(default_factory=list)
    pdi_control: int = 0
    pdi_config: int = 0
    mailbox: SiiMailbox = field(default_factory=SiiMailbox)
    group: str = ""
    group_name: str = ""
    ebus_current: int = 0
    physical_ports: int = 0
    fmmus: list[int] = field(default_factory=list)
    dc: list[SiiDc] = field(default_factory=list)
    fixed: set[int] = field(default_factory=set)

    def channels(self, usage: int) -> list[int]:
        """Numbers of the sync managers for process data of a usage.

        Where the SII has none they are the usual ones of ETG.1000.4: 2 for outputs, 3 for inputs.
        """
        found = [n for n, item in enumerate(self.sync_managers) if item.usage == usage]
        return found or ([2] if usage == USAGE_OUTPUTS else [3])


def read_sii(words: Callable[[int, int], bytes]) -> Sii:
    """Reads what a master needs from an SII.

    Args:
        words: Gives words: the word address and how many.

    Raises:
        SiiError: The content makes no sense.
    """
    return SiiReader(words, 2 * _WORDS_MAX).read()


def read_dc_modes(words: Callable[[int, int], bytes]) -> list[SiiDc]:
    """Reads the operation modes of the distributed clocks (category 60), if there are any.

    Args:
        words: Gives words: the word address and how many.

    Raises:
        SiiError: The content makes no sense.
    """
    return _DcReader(words, 2 * _WORDS_MAX).read().dc


def read_mailbox(words: Callable[[int, int], bytes]) -> list[SiiSyncManager]:
    """Reads how the mailbox is set up: sync managers 0 and 1; empty where there is no mailbox.

    Category 41 describes them; without it, or where that makes no sense, the standard mailbox
    (words 0x18 to 0x1B) says where they are.

    Args:
        words: Gives words: the word address and how many.
    """
    reader = _MailboxReader(words, 2 * _WORDS_MAX)
    with suppress(SiiError):  # `read_sii` tells
        reader.read()
    box, managers = reader.sii.mailbox, reader.sii.sync_managers[:2]
    if box.receive_size in (0, _UNPROGRAMMED):
        return []
    if [manager.usage for manager in managers if manager.length] == [1, 2]:
        return managers
    return [
        SiiSyncManager(box.receive, box.receive_size, _MAILBOX_WRITTEN, 1, 1),
        SiiSyncManager(box.send, box.send_size or box.receive_size, _MAILBOX_READ, 1, 2),
    ]


class SiiReader:
    """Decodes what a master needs from an SII, and refuses what it cannot make sense of.

    Args:
        read: Gives words: the word address and how many.
        size: Bytes that can be read.
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

    def __init__(self, read: Callable[[int, int], bytes], size: int) -> None:
        self._words = read
        self._end = size // 2
        self._strings = [""]
        self.sii = Sii()

    def stop(self, byte: int, text: str) -> NoReturn:
        """What follows in a category, or all that follow it, make no sense."""
        raise SiiError(text)

    def note(self, byte: int, text: str) -> None:
        """Something is wrong, but one can live with it."""

    def attempt(self, step: Callable[..., None], *arguments: Any) -> None:
        """Decodes a part."""
        step(*arguments)

    def read(self) -> Sii:
        """Decodes everything."""
        self.header()
        categories = self._categories()
        # Names are needed by the others, so strings come first.
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
                self.attempt(decode, *categories[kind])
        return self.sii

    def header(self) -> None:
        """The fixed words."""
        sii = self.sii
        (sii.alias,) = struct.unpack("<H", self._words(0x04, 1))
        identity = self._words(0x08, 8)
        sii.vendor, sii.product, sii.revision, sii.serial = struct.unpack("<IIII", identity)
        sii.bootstrap = SiiMailbox(*struct.unpack("<HHHH", self._words(0x14, 4)))
        (sii.mailbox_protocols,) = struct.unpack("<H", self._words(0x1C, 1))

    def _categories(self) -> dict[int, tuple[int, bytes]]:
        """The categories by type: byte offset and data of each."""
        found: dict[int, tuple[int, bytes]] = {}
        self.attempt(self._walk, found)
        return found

    def _walk(self, found: dict[int, tuple[int, bytes]]) -> None:
        at = FIRST_CATEGORY
        for _ in range(_CATEGORIES_MAX):
            if at + 2 > self._end:
                self.beyond(at)
                return
            kind, length = struct.unpack("<HH", self._words(at, 2))
            if kind == CATEGORY_END:
                return
            if kind == 0 and length == 0:
                self.stop(2 * at, f"there is no category at word 0x{at:04X}, only zeros")
            if at + 2 + length > self._end:
                self.stop(
                    2 * at,
                    f"category {kind} at word 0x{at:04X} claims {length} words, more than fit: "
                    f"{self._end - at - 2} are left",
                )
            if kind in self.wanted:
                if kind in found:
                    self.note(2 * at, f"category {kind} occurs a second time")
                found[kind] = 2 * at + 4, self._words(at + 2, length)
            at += 2 + length
        self.stop(2 * at, f"more than {_CATEGORIES_MAX} categories")

    def beyond(self, word: int) -> None:
        """The categories reach to the end of what can be read."""
        self.stop(2 * word, f"the category at word 0x{word:04X} lies beyond the largest EEPROM")

    def _read_strings(self, at: int, data: bytes) -> None:
        """Strings by number; number 0 is the empty one."""
        if not data:
            return
        count, offset = data[0], 1
        for number in range(1, count + 1):
            end = offset + 1 + data[offset] if offset < len(data) else len(data) + 1
            if end > len(data):
                self.stop(at + offset, f"string {number} of {count} ends beyond its category")
            self._strings.append(_decode(data[offset + 1 : end]))
            offset = end

    def _string(self, at: int, number: int) -> str:
        if number < len(self._strings):
            return self._strings[number]
        self.note(at, f"there is no string {number}: 0 to {len(self._strings) - 1} are allowed")
        return ""

    def general(self, at: int, data: bytes) -> None:
        """Category 30."""
        if len(data) < 12:
            self.note(at, f"category 30 has {len(data)} bytes, less than the 12 that matter")
            return
        sii = self.sii
        sii.order = self._string(at + 2, data[2])
        sii.name = self._string(at + 3, data[3])
        sii.coe = data[5]
        sii.without_lrw = bool(data[0x0B] & 0x02)

    def _fmmus(self, at: int, data: bytes) -> None:
        for i, usage in enumerate(data):
            if usage != _PADDING:
                self.sii.fmmus.append(usage)
                if usage > 3:
                    self.note(at + i, f"an FMMU has the usage {usage}: 0 to 3 are allowed")

    def _sync_managers(self, at: int, data: bytes) -> None:
        self.whole_rows(at, data, 8)
        rows = struct.iter_unpack("<HHBBBB", data[: len(data) // 8 * 8])
        for i, (start, length, control, _status, enable, usage) in enumerate(rows):
            manager = SiiSyncManager(start, length, control, enable, usage)
            self.sii.sync_managers.append(manager)
            self.check_sync_manager(at + 8 * i, manager)

    def check_sync_manager(self, at: int, manager: SiiSyncManager) -> None:
        """Notes what is wrong with a sync manager."""

    def whole_rows(self, at: int, data: bytes, size: int) -> None:
        """Notes a table whose last row is cut off."""
        if len(data) % size:
            self.note(at + len(data), f"{len(data)} bytes are no whole rows of {size} bytes")

    def _inputs(self, at: int, data: bytes) -> None:
        self._pdos(at, data, self.sii.inputs, "TxPDO")

    def _outputs(self, at: int, data: bytes) -> None:
        self._pdos(at, data, self.sii.outputs, "RxPDO")

    def _pdos(self, at: int, data: bytes, pdos: list[Pdo], kind: str) -> None:
        here = 0
        while here + 8 <= len(data):
            index, count, sync_manager, _dc, name, flags = struct.unpack_from("<HBBBBH", data, here)
            start, end = here + 8, here + 8 + 8 * count
            if end > len(data):
                self.stop(
                    at + here,
                    f"{kind} 0x{index:04X} claims {count} entries, more than there are: "
                    f"{(len(data) - start) // 8} follow",
                )
            entries = [
                Entry(entry, subindex, self._string(at + start + 8 * i + 3, text), data_type, bits)
                for i, (entry, subindex, text, data_type, bits, _flags) in enumerate(
                    struct.iter_unpack("<HBBBBH", data[start:end])
                )
            ]
            pdo = Pdo(index, self._string(at + here + 5, name), sync_manager, entries)
            pdos.append(pdo)
            if flags & _FIXED:
                self.sii.fixed.add(index)
            self.check_pdo(at + here, pdo, pdos)
            here = end
        self.whole_rows(at, data, 8)

    def check_pdo(self, at: int, pdo: Pdo, pdos: list[Pdo]) -> None:
        """Notes what is wrong with a PDO, the last one of `pdos`."""

    def _dc(self, at: int, data: bytes) -> None:
        self.whole_rows(at, data, _DC_BYTES)
        for i in range(len(data) // _DC_BYTES):
            cycle, shift0, shift1, factor1, assign, factor0, name = struct.unpack_from(
                "<IiihHhB", data, i * _DC_BYTES
            )
            text = self._string(at + i * _DC_BYTES + 18, name)
            self.sii.dc.append(SiiDc(text, cycle, shift0, shift1, assign, factor0, factor1))


class _DcReader(SiiReader):
    """Decodes the distributed clocks alone."""

    wanted = frozenset({CATEGORY_STRINGS, CATEGORY_DC})


class _MailboxReader(SiiReader):
    """Decodes what the mailbox needs."""

    wanted = frozenset({CATEGORY_SYNC_MANAGER})

    def header(self) -> None:
        self.sii.mailbox = SiiMailbox(*struct.unpack("<4H", self._words(0x18, 4)))


def _decode(text: bytes) -> str:
    """The standard says visible string; vendors write UTF-8 or Latin-1."""
    try:
        decoded = text.decode("utf-8")
    except UnicodeDecodeError:
        decoded = text.decode("latin-1")
    return "".join(c if c.isprintable() else " " for c in decoded.split("\0", 1)[0]).strip()

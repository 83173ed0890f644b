"""Content of the SII, the EEPROM of a slave (ETG.2010).

`sii_reader` decodes what a master needs, and `sii_parts` less; `sii_check` decodes and checks a
whole image.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from .pdo import Pdo

CATEGORY_STRINGS = 10
CATEGORY_GENERAL = 30
CATEGORY_FMMU = 40
CATEGORY_SYNC_MANAGER = 41
CATEGORY_TXPDO = 50
CATEGORY_RXPDO = 51
CATEGORY_DC = 60
CATEGORY_END = 0xFFFF
USAGE_OUTPUTS, USAGE_INPUTS = 3, 4
"""Usage of a sync manager for process data (category 41)."""

UNASSIGNED = 0xFF
"""Sync manager number of a PDO that is not mapped by default."""

UNPROGRAMMED = 0xFFFF
"""A word of an EEPROM that was never written."""

_COMPLETE_ACCESS = 0x20  # bit of the CoE details
_IN_USE = 0x0D  # enabled, virtual, or enabled in OP: bits of the enable byte of a sync manager
_VIRTUAL = 0x04  # bit of the enable byte of a sync manager
_DIGITAL_OUTPUTS = (0x0F00, 0x0F04)
_RAM = (0x1000, 0x10000)
_COE, _SOE = 0x04, 0x10


def in_memory(start: int, size: int) -> bool:
    """Whether an ESC can have process data there: in its RAM, or in the digital output register."""
    end = start + size
    return any(low <= start < high and end <= high for low, high in (_DIGITAL_OUTPUTS, _RAM))


@dataclass(frozen=True, slots=True)
class SiiProblem:
    """An error in an SII, or a violation of ETG.2010.

    Attributes:
        byte: Offset in the EEPROM.
        text: What is wrong and, where that is not obvious, what is allowed.
        effect: How the reader handles it; empty if it does no harm.
        damage: Whether information that the SII should contain is lost.
    """

    byte: int
    text: str
    effect: str = ""
    damage: bool = False

    @property
    def where_and_what(self) -> str:
        """The problem without its effect."""
        return f"byte 0x{self.byte:04X} (word 0x{self.byte // 2:04X}): {self.text}"

    def __str__(self) -> str:
        return f"{self.where_and_what}{'; ' if self.effect else ''}{self.effect}"


@dataclass(slots=True)
class SiiSyncManager:
    """One sync manager (category 41), as the vendor wants it to be set up.

    Attributes:
        start: Physical start address.
        length: Default length in bytes.
        control: Control register (0x0804).
        enable: Bit 0: to be enabled; bit 2: virtual; bit 3: to be enabled in OP only.
        usage: 1 mailbox out, 2 mailbox in, 3 process data outputs, 4 process data inputs; 0 if
            the SII does not say.
    """

    start: int
    length: int
    control: int
    enable: int
    usage: int

    @property
    def virtual(self) -> bool:
        """Whether an FMMU maps the memory of the slave directly, without a real sync manager.

        The memory may be registers, which a sync manager cannot guard.
        """
        return bool(self.enable & _VIRTUAL)

    @property
    def is_placeholder(self) -> bool:
        """Whether it is switched off and nowhere in memory: it only keeps a number."""
        return not self.enable & _IN_USE and not self.holds(self.length)

    def holds(self, size: int) -> bool:
        """Whether `size` bytes from its start address on can be process data."""
        return self.start + size <= _RAM[1] if self.virtual else in_memory(self.start, size)


@dataclass(slots=True)
class SiiMailbox:
    """Mailbox areas, as seen from the slave (words 0x14 to 0x17 for BOOT, else 0x18 to 0x1B).

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
    def text(self) -> str:
        """`128 bytes from 0x1000 on and 96 from 0x1080 on`; the master writes the first one."""
        return (
            f"{self.receive_size} bytes from 0x{self.receive:04X} on and {self.send_size} from "
            f"0x{self.send:04X} on"
        )

    @property
    def written(self) -> bool:
        """Whether somebody has written its words."""
        return self.receive_size not in (0, UNPROGRAMMED)

    @property
    def overlaps(self) -> bool:
        """Whether the two areas share bytes, so that the slave can have no such mailbox."""
        return (
            self.receive < self.send + self.send_size
            and self.send < self.receive + self.receive_size
        )

    def fits(self, other: SiiMailbox) -> bool:
        """Whether it is the same. One without a size of the second area has that of the first."""
        size = self.send_size or self.receive_size
        return replace(self, send_size=size) == other

    @property
    def exists(self) -> bool:
        """Whether there is a mailbox: sizes that were never written are 0 or 0xFFFF."""
        return all(0 < size < UNPROGRAMMED for size in (self.receive_size, self.send_size))


def mailbox_managers(managers: list[SiiSyncManager]) -> list[SiiSyncManager]:
    """Sync managers 0 and 1, if they are a mailbox; else none."""
    first = managers[:2]
    return first if [item.usage for item in first if item.length] == [1, 2] else []


def replace_overlapping(managers: list[SiiSyncManager], words: SiiMailbox) -> bool:
    """Puts the mailbox where its words say, if its sync managers overlap and the words do not.

    Args:
        managers: The two sync managers of the mailbox; they are changed.
        words: Words 0x18 to 0x1B.

    Returns:
        Whether they were changed.
    """
    out, back = managers
    here = SiiMailbox(out.start, out.length, back.start, back.length)
    if not here.overlaps or not words.exists or words.overlaps:
        return False
    out.start, out.length = words.receive, words.receive_size
    back.start, back.length = words.send, words.send_size
    return True


@dataclass(slots=True)
class SiiDc:
    """An operation mode of the distributed clocks (category 60).

    Attributes:
        name: Its name.
        cycle_time: Cycle time of SYNC0 in ns; 0: the cycle time of the master.
        shift_time0: Shift of SYNC0 in ns.
        shift_time1: Shift of SYNC1 in ns.
        assign_activate: Values of the registers 0x0980 (low byte) and 0x0981 (high byte).
        cycle_factor0: Cycle of SYNC0 as a multiple of that of the master; negative: a fraction.
        cycle_factor1: Cycle of SYNC1 as a multiple, or a fraction, of that of SYNC0.
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
    """Content of an SII.

    A PDO is mapped by default if its sync manager is not `UNASSIGNED`. The reader sets it to
    `UNASSIGNED` if the PDO cannot lie in the sync manager that the EEPROM names
    (`sii_placement`); `problems` has the reason.

    Of the attributes from `pdi_control` on, `sii_reader.read_sii` reads only `fixed`, since a
    master does not need them and reading an EEPROM is slow; `sii_check.check_sii` reads all.

    Attributes:
        alias: Configured station alias.
        vendor: Vendor ID.
        product: Product code.
        revision: Revision number.
        serial: Serial number.
        bootstrap: Mailbox in BOOT; it does not exist if the slave does not have this state.
        mailbox: Standard mailbox.
        mailbox_protocols: Bit 2: CoE; bit 3: FoE (word 0x1C).
        name: Device name from the general category, empty if there is none.
        order: Order code from the general category, empty if there is none.
        coe: CoE details from the general category; bit 0: SDO, bit 1: SDO information.
        without_lrw: Whether the slave does not support LRW.
        tells_identification: Whether it reports its identification on request, in its AL status.
        identification_register: Address in its ESC where its identification is; 0 for none.
        sync_managers: Sync managers in order.
        inputs: TxPDOs.
        outputs: RxPDOs.
        problems: The errors in the SII, in the order in which they were found.
        pdi_control: Word 0; bit 8: the ESC itself answers AL control (device emulation).
        pdi_config: Word 1.
        group: Group type.
        group_name: Name of the group.
        ebus_current: Current in mA that the slave takes from the E-bus; negative if it supplies it.
        physical_ports: A nibble for each port, port 0 lowest: 0 none, 1 MII, 3 EBUS.
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
    mailbox: SiiMailbox = field(default_factory=SiiMailbox)
    mailbox_protocols: int = 0
    name: str = ""
    order: str = ""
    coe: int = 0
    without_lrw: bool = False
    tells_identification: bool = False
    identification_register: int = 0
    sync_managers: list[SiiSyncManager] = field(default_factory=list)
    inputs: list[Pdo] = field(default_factory=list)
    outputs: list[Pdo] = field(default_factory=list)
    problems: list[SiiProblem] = field(default_factory=list)
    pdi_control: int = 0
    pdi_config: int = 0
    group: str = ""
    group_name: str = ""
    ebus_current: int = 0
    physical_ports: int = 0
    fmmus: list[int] = field(default_factory=list)
    dc: list[SiiDc] = field(default_factory=list)
    fixed: set[int] = field(default_factory=set)

    @property
    def complete_access(self) -> bool:
        """Whether the slave says that whole objects can be transferred at once."""
        return bool(self.coe & _COMPLETE_ACCESS)

    @property
    def damaged(self) -> bool:
        """Whether information is lost by a problem of the SII."""
        return any(problem.damage for problem in self.problems)

    @property
    def has_idns(self) -> bool:
        """Whether indices in its process data are IDNs: it has SoE, and no CoE."""
        return self.mailbox_protocols & (_SOE | _COE) == _SOE

    def channels(self, usage: int) -> list[int]:
        """Returns the numbers of the sync managers for outputs or inputs.

        If the SII describes none, this is the usual one of ETG.1000.4, 2 for outputs and 3 for
        inputs, unless the SII uses it for something else.

        Args:
            usage: `USAGE_OUTPUTS` or `USAGE_INPUTS`.
        """
        usages = [item.usage * (not item.is_placeholder) for item in self.sync_managers]
        found = [number for number, known in enumerate(usages) if known == usage]
        usual = 2 if usage == USAGE_OUTPUTS else 3
        free = usual >= len(usages) or usages[usual] == 0
        return found or [usual] * free

"""Classes for the content of ESI files."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

from ecatd.etg.pdo import Pdo

from .dictionary import EsiObject
from .findings import Findings
from .xml import Element


@dataclass(frozen=True, slots=True)
class EsiChoice:
    """One device of a file, without its details.

    Attributes:
        number: Its number in the file, 0 first.
        type: Name of the type, such as `EL1018`.
        name: Name of the device.
        product: Product code.
        revision: Revision number.
    """

    number: int
    type: str
    name: str
    product: int
    revision: int

    def fits(self, type: str | None, product: int | None, revision: int | None) -> bool:
        """Whether the device has this type, product code and revision; None fits any."""
        return (
            type in (None, self.type)
            and product in (None, self.product)
            and revision in (None, self.revision)
        )

    def __str__(self) -> str:
        return f"{self.type} (product 0x{self.product:08X}, revision 0x{self.revision:08X})"


@dataclass(slots=True)
class EsiSyncManager:
    """A sync manager.

    Attributes:
        usage: 0 none, 1 mailbox out, 2 mailbox in, 3 outputs, 4 inputs.
        start: First byte in the memory of the slave.
        size: Default size in bytes; 0 if it follows from the PDOs.
        control: Control register (0x0804).
        enable: Enable byte as in the SII; bit 0: to be enabled; bit 2: virtual; bit 3: in OP only.
        line: Line in the file.
    """

    usage: int
    start: int
    size: int
    control: int
    enable: int
    line: int


@dataclass(slots=True)
class EsiPdo(Pdo):
    """A PDO; its sync manager is 0xFF if it is not assigned by default.

    Attributes:
        fixed: Whether its entries cannot be changed.
        mandatory: Whether it cannot be removed from the assignment.
        excludes: Indices of PDOs that cannot be assigned together with it.
    """

    fixed: bool = False
    mandatory: bool = False
    excludes: list[int] = field(default_factory=list)

    def is_excluded(self, others: Iterable[EsiPdo]) -> bool:
        """Whether it cannot be assigned together with these; one of two says it for both."""
        return any(
            other.index != self.index
            and (other.index in self.excludes or self.index in other.excludes)
            for other in others
        )


@dataclass(slots=True)
class EsiDcMode:
    """An operation mode of the distributed clocks; attributes as in `ecatd.etg.sii.SiiDc`."""

    name: str
    description: str
    assign_activate: int
    cycle_time0: int
    cycle_factor0: int
    shift_time0: int
    cycle_time1: int
    cycle_factor1: int
    shift_time1: int


@dataclass(frozen=True, slots=True)
class EsiCommand:
    """A start-up command for an object (`<CoE>`, `<InitCmd>`).

    Attributes:
        line: Line in the file.
        transitions: When it is written, such as "PS".
        index: Index of the object.
        subindex: Its subindex.
        data: The data to write.
        complete: Whether the whole object is written at once (complete access).
        comment: The reason for it.
    """

    line: int
    transitions: tuple[str, ...]
    index: int
    subindex: int
    data: bytes
    complete: bool
    comment: str


@dataclass(frozen=True, slots=True)
class IdnCommand:
    """A start-up command for an IDN (`<SoE>`, `<InitCmd>`), which ESI and ENI files write alike.

    Attributes:
        line: Line in the file.
        transitions: When it is written, such as "PS".
        drive: The drive of the slave.
        idn: The IDN.
        data: The data to write; empty for a command that writes no value.
        comment: The reason for it.
        disabled: Whether the file switches it off.
    """

    line: int
    transitions: tuple[str, ...]
    drive: int
    idn: int
    data: bytes
    comment: str
    disabled: bool


@dataclass(frozen=True, slots=True)
class EsiSlot:
    """A slot for a module.

    Attributes:
        name: Its name; may be empty.
        idents: Idents of the modules that it may have, in addition to those of `classes`.
        classes: Classes of the modules that it may have.
        index_step: Distance of the objects of a module from those of the slot before.
        pdo_step: Distance of its PDOs.
    """

    name: str
    idents: tuple[int, ...]
    classes: tuple[str, ...]
    index_step: int
    pdo_step: int

    def takes(self, module: EsiModule) -> bool:
        """Whether the slot may have a module. A slot that names no modules may have any."""
        anything = not self.idents and not self.classes
        return anything or module.ident in self.idents or module.module_class in self.classes


@dataclass(frozen=True, slots=True)
class EsiModule:
    """A type of module. `modules.plug` adds its PDOs, commands and objects to a device.

    Attributes:
        ident: Module ident.
        module_class: Its class, which slots name.
        type: Name of the type.
        name: Name of the module.
        element: Its element in the file, which is read for each slot, since it depends on the slot.
    """

    ident: int
    module_class: str
    type: str
    name: str
    element: Element


@dataclass(slots=True)
class EsiDevice:
    """A device as its ESI file describes it.

    Attributes:
        path: The file.
        line: Line of the device in the file.
        vendor: Vendor ID.
        vendor_name: Name of the vendor.
        type: Name of the type.
        name: Name of the device.
        product: Product code.
        revision: Revision number.
        group: Group type.
        group_name: Name of the group.
        physics: A letter for each port from port 0 on: Y and H Ethernet, K E-bus, blank none.
        ebus_current: Current taken from the E-bus in mA.
        fmmus: Purposes of the FMMUs: 0 none, 1 outputs, 2 inputs, 3 mailbox state.
        sync_managers: Sync managers.
        outputs: RxPDOs.
        inputs: TxPDOs.
        protocols: Mailbox protocols, as in SII word 0x1C; 0 without a mailbox.
        coe_details: CoE details, as in SII category 30.
        commands: Start-up commands.
        idns: Start-up commands for IDNs.
        tells_identification: Whether it tells its identification on request (ETG.1020).
        identification_register: Address in its ESC where its identification is; 0 for none.
        dc: Operation modes of the distributed clocks; the first one is the default.
        eeprom_size: Size of the EEPROM in bytes, 0 if the file does not give it.
        config_data: First bytes of the EEPROM.
        bootstrap: Words 0x14 to 0x17 of the EEPROM: the mailbox in BOOT.
        categories: Further categories of the EEPROM: type and data of each.
        objects: The object dictionary.
        dictionary_file: Name of another file with the dictionary, or empty.
        diagnosis_texts: Texts of its diagnosis messages (ETG.1020), by their numbers.
        slots: Its slots for modules, slot 1 first.
        modules: The modules that its slots may have.
        findings: What is wrong in its description, and left out.
        misplaced: Why PDOs that it has by default would lie in another place than in the device. A
            simulated device like that would have wrong values.
    """

    path: str
    line: int
    vendor: int
    vendor_name: str
    type: str
    name: str
    product: int
    revision: int
    group: str = ""
    group_name: str = ""
    physics: str = ""
    ebus_current: int = 0
    fmmus: list[int] = field(default_factory=list)
    sync_managers: list[EsiSyncManager] = field(default_factory=list)
    outputs: list[EsiPdo] = field(default_factory=list)
    inputs: list[EsiPdo] = field(default_factory=list)
    protocols: int = 0
    coe_details: int = 0
    commands: list[EsiCommand] = field(default_factory=list)
    idns: list[IdnCommand] = field(default_factory=list)
    tells_identification: bool = False
    identification_register: int = 0
    dc: list[EsiDcMode] = field(default_factory=list)
    eeprom_size: int = 0
    config_data: bytes = b""
    bootstrap: bytes = b""
    categories: list[tuple[int, bytes]] = field(default_factory=list)
    objects: list[EsiObject] = field(default_factory=list)
    dictionary_file: str = ""
    diagnosis_texts: dict[int, str] = field(default_factory=dict)
    slots: list[EsiSlot] = field(default_factory=list)
    modules: list[EsiModule] = field(default_factory=list)
    findings: Findings = field(default_factory=Findings)
    misplaced: list[str] = field(default_factory=list)

    def is_like(self, other: EsiDevice) -> bool:
        """Whether another description is of the same device, with the same process data."""
        mine, theirs = (
            (
                (item.vendor, item.product, item.revision, item.type),
                [replace(manager, line=0) for manager in item.sync_managers],
                (item.outputs, item.inputs, item.protocols, len(item.slots)),
            )
            for item in (self, other)
        )
        return mine == theirs

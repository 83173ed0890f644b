"""Classes for the content of ENI files."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from ecatd.config import ModuleConfig
from ecatd.description.modules import CONFIGURED
from ecatd.etg.pdo import Pdo

from ..esi.device import IdnCommand
from ..esi.findings import Findings


@dataclass(frozen=True, slots=True)
class CoeCommand:
    """An `<InitCmd>` of CoE: an object that the master writes or reads.

    Attributes:
        line: Its line in the file.
        transitions: When it is sent, such as "PS".
        index: Index of the object.
        subindex: Its subindex.
        data: The data to write; empty for a command that reads.
        complete: Whether the whole object is written at once (complete access).
        disabled: Whether the file switches it off.
        comment: Its comment.
    """

    line: int
    transitions: tuple[str, ...]
    index: int
    subindex: int
    data: bytes
    complete: bool
    disabled: bool
    comment: str

    @property
    def address(self) -> str:
        """The object as it is always printed: `0x6060:00`."""
        return f"0x{self.index:04X}:{self.subindex:02X}"


@dataclass(frozen=True, slots=True)
class RegisterCommand:
    """An `<InitCmd>` that is one datagram.

    Attributes:
        line: Its line in the file.
        transitions: When it is sent.
        command: Command of the datagram (ETG.1000.4): 0 NOP, 1 APRD, 2 APWR, 4 FPRD, 5 FPWR, ...
        register: First register.
        data: The data to write.
        expected: What a slave must answer; None if that is not checked.
        comment: Its comment.
    """

    line: int
    transitions: tuple[str, ...]
    command: int
    register: int
    data: bytes
    expected: bytes | None
    comment: str


@dataclass(frozen=True, slots=True)
class EniSyncManager:
    """A sync manager for process data.

    Attributes:
        number: Its number.
        outputs: Whether it carries outputs.
        control: Its control register, 0x0804.
        pdos: Indices of the PDOs that it carries.
    """

    number: int
    outputs: bool
    control: int
    pdos: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class EniClock:
    """The distributed clock of a slave.

    Attributes:
        line: Its line in the file.
        reference: Whether it is the reference clock.
        cycle0_ns: Period of SYNC0.
        shift_ns: Shift of SYNC0.
    """

    line: int
    reference: bool
    cycle0_ns: int
    shift_ns: int


@dataclass(slots=True)
class EniSlave:
    """A slave.

    Attributes:
        line: Its line in the file.
        name: Its name in the project, such as `Term 2 (EL1008)`.
        address: Station address; 0 if the file has none.
        auto_increment: Auto-increment address; None if the file has none.
        vendor: Vendor ID.
        product: Product code.
        revision: Revision number.
        serial: Serial number, 0 if it is not known.
        identification: Register and value that identify the slave, such as its alias; or None.
        group: Number of its hot connect group, 1 and following; 0: it is in none.
        group_name: Name of the group that begins here; None if none does.
        sync_managers: Those of its process data, in the order of their numbers.
        outputs: RxPDOs that the file describes, assigned or not.
        inputs: TxPDOs.
        output_bits: Outputs in the process image; None if the file does not say.
        input_bits: Inputs in the process image; None if the file does not say.
        coe: Whether it has CoE.
        soe: Whether it has SoE.
        idns: SoE commands.
        objects: CoE commands.
        registers: Register commands.
        clock: Its distributed clock; None if the file has none.
        others: Line and name of elements that the converter has no place for.
    """

    line: int
    name: str
    address: int
    auto_increment: int | None
    vendor: int
    product: int
    revision: int
    serial: int = 0
    identification: tuple[int, int] | None = None
    group: int = 0
    group_name: str | None = None
    sync_managers: list[EniSyncManager] = field(default_factory=list)
    outputs: list[Pdo] = field(default_factory=list)
    inputs: list[Pdo] = field(default_factory=list)
    output_bits: int | None = None
    input_bits: int | None = None
    coe: bool = False
    soe: bool = False
    idns: list[IdnCommand] = field(default_factory=list)
    objects: list[CoeCommand] = field(default_factory=list)
    registers: list[RegisterCommand] = field(default_factory=list)
    clock: EniClock | None = None
    others: list[tuple[int, str]] = field(default_factory=list)


@dataclass(slots=True)
class EniTask:
    """A `<Cyclic>`: frames that are sent with one period.

    Attributes:
        line: Its line in the file.
        cycle_us: The period; 0 if the file does not say.
        name: Its comment.
        areas: First logical address and length of each datagram with process data.
        clock: Auto-increment or station address of the reference clock whose time it distributes;
            None if it distributes no time.
        others: Line and name of further parts of the frames.
    """

    line: int
    cycle_us: int
    name: str = ""
    areas: list[tuple[int, int]] = field(default_factory=list)
    clock: int | None = None
    others: list[tuple[int, str]] = field(default_factory=list)


@dataclass(slots=True)
class EniNetwork:
    """The content of an ENI file.

    Attributes:
        path: The file.
        name: Name of the master.
        commands: Number of the commands of the master for all slaves.
        slaves: Slaves in the order of the file.
        findings: What is wrong in the file, and left out.
        tasks: Cyclic tasks.
        others: Line and name of elements that the converter has no place for.
    """

    path: str
    name: str
    commands: int = 0
    slaves: list[EniSlave] = field(default_factory=list)
    findings: Findings = field(default_factory=Findings)
    tasks: list[EniTask] = field(default_factory=list)
    others: list[tuple[int, str]] = field(default_factory=list)


_SIZE = 4


def is_about_modules(command: CoeCommand) -> bool:
    """Whether a command writes the list on the way to OP."""
    up = not {"IP", "PS", "SO"}.isdisjoint(command.transitions)
    return command.index == CONFIGURED and bool(command.data) and not command.disabled and up


def find_modules(commands: Iterable[CoeCommand]) -> list[ModuleConfig]:
    """The modules that the commands write, by slot.

    With complete access, a byte with their number and a byte of padding come first (ETG.1000.6).
    """
    idents: dict[int, int] = {}
    for command in filter(is_about_modules, commands):
        data, slot = command.data, command.subindex
        if command.complete and slot == 0:
            data, slot = data[2:], 1
        for at in range(0, len(data) if slot else 0, _SIZE):
            idents[slot + at // _SIZE] = int.from_bytes(data[at : at + _SIZE], "little")
    return [ModuleConfig(slot, ident) for slot, ident in sorted(idents.items()) if ident]

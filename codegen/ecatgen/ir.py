"""The contents of a generated library. All decisions are made here; templates only write files.

A `str` is plain: the templates escape it for the language that they write. `Code` is written as it
is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ecatd.etg.pdo import Entry, Value

from .text import NOTHING, Code

Kind = Literal["Boolean", "Integer", "Real"]

SlaveKind = Literal[
    "drive",
    "digital inputs",
    "digital outputs",
    "digital inputs and outputs",
    "analog inputs",
    "analog outputs",
    "coupler",
    "CAN terminal",
    "other",
]


@dataclass(frozen=True, slots=True)
class Point:
    """A point in an icon or diagram.

    Attributes:
        x: To the right.
        y: Upwards.
    """

    x: int
    y: int

    def __str__(self) -> Code:
        return Code("{%d, %d}") % (self.x, self.y)


@dataclass(frozen=True, slots=True)
class Extent:
    """A rectangle in an icon or diagram, by two corners.

    Attributes:
        a: A corner.
        b: The corner opposite.
    """

    a: Point
    b: Point

    @property
    def width(self) -> int:
        """Width of the rectangle."""
        return abs(self.b.x - self.a.x)

    @property
    def height(self) -> int:
        """Height of the rectangle."""
        return abs(self.b.y - self.a.y)

    def __str__(self) -> Code:
        return Code("{%s, %s}") % (self.a, self.b)


@dataclass(frozen=True, slots=True)
class Connector:
    """One PDO entry as a connector of a block.

    Attributes:
        name: Name in Modelica and in C.
        handle: Name of the external object (and of the pointer in C).
        written: Name of the variable that the write of this entry sets.
        after: Variable whose computation must come before the access.
        direction: `output` of the bus, which the model writes, or `input`, which it reads.
        access: What the model does with it: `write` or `read`.
        kind: Type of the value in the model: `Boolean`, `Integer` or `Real`.
        raw_kind: Type of the raw value: `Boolean`, `Integer` or `Real`.
        class_name: Modelica class of the connector, or prefix and type of a variable.
        function: Suffix of the C functions: `boolean`, `integer`, `real`.
        index: Object index.
        subindex: Object subindex.
        address: Index and subindex as printed for users.
        data_type: Number of the CoE data type.
        type_name: Name of the CoE data type.
        bit_length: Bits in the process image.
        description: Names of the PDO and the entry, with the address.
        pdo_name: Name of its PDO.
        entry_name: Name of the entry.
        modifiers: Modifications of the connector: unit, quantity, and start where it is read.
        scaling: Further arguments of the constructor of the external object: scale and offset, or
            nothing for a raw value.
        scale: Physical value = raw value * scale + offset.
        offset: See `scale`.
        unit: Unit of the value as Modelica writes it, or empty.
        unit_name: Unit as people write it, or empty.
        conversion: Formula for the value from the raw value, for the documentation, or empty.
        note: A further remark for the documentation, or empty.
        values: The named values: numbers with a meaning.
        placement: Annotation with the place in the icon; empty for a variable without a connector.
        label: Name in the icon, shortened if it is long; empty for a variable without a connector.
        label_extent: Place of the label.
    """

    name: Code
    handle: Code
    written: Code
    after: Code
    direction: Literal["output", "input"]
    access: Literal["write", "read"]
    kind: Kind
    raw_kind: Kind
    class_name: Code
    function: Code
    index: int
    subindex: int
    address: Code
    data_type: int
    type_name: str
    bit_length: int
    description: str
    pdo_name: str
    entry_name: str
    modifiers: tuple[Code, ...]
    scaling: Code
    scale: float
    offset: float
    unit: str
    unit_name: str
    conversion: str
    note: str
    values: tuple[Value, ...]
    placement: Code
    label: str
    label_extent: Extent | None


@dataclass(frozen=True, slots=True)
class Skipped:
    """A PDO entry that has no connector, and why.

    Attributes:
        address: Index and subindex as printed for users.
        entry_name: Name of the entry.
        type_name: Name of the CoE data type.
        bit_length: Bits in the process image.
        reason: Why it has no connector.
    """

    address: Code
    entry_name: str
    type_name: str
    bit_length: int
    reason: str


@dataclass(frozen=True, slots=True)
class CanSignal:
    """A signal of a CAN message.

    Attributes:
        connector: Its connector.
        entry: What its value is; index and subindex have no meaning.
        start: First bit as in a DBC file.
        big_endian: Whether the first byte has the highest bits.
        number: Number of the `EtherCAT.Types.CANNumber`.
        minimum: Smallest value that can be sent.
        maximum: Largest value that can be sent.
        selector: Start bit, bits, big endian, lowest and highest value of its multiplexer, or
            zeros.
    """

    connector: Connector
    entry: Entry
    start: int
    big_endian: bool
    number: int
    minimum: float
    maximum: float
    selector: tuple[int, int, int, int, int]

    @property
    def meaning(self) -> str:
        """Where it is in the frame, in words: `start bit 7, 16 bits, big endian, ...`."""
        c = self.connector
        order = "big endian" if self.big_endian else "little endian"
        *_, low, high = self.selector
        only = f", multiplexer {low} to {high}" if self.selector[1] else ""
        return f"start bit {self.start}, {c.bit_length} bits, {order}, {c.type_name}{only}"


@dataclass(frozen=True, slots=True)
class CanMessage:
    """A message of the CAN bus behind a slave.

    Attributes:
        name: Prefix of the names of its signals, in camel case.
        title: Its name in the file.
        handle: Name of its external object (and of the pointer in C).
        identifier: Its identifier.
        extended: Whether that has 29 bits.
        sent: Whether the model sends it; else it receives it.
        length: Bytes of data; of a received message the fewest that all its signals need.
        transmission: The usual `EtherCAT.Types.CANTransmission`.
        transmission_number: Its number.
        period: The usual period in s, of a message that is sent.
        timeout: The usual timeout in s, of a message that is received.
        note: What its file says about it, or empty.
        signals: Its signals.
        names: Names of its parameters and variables: `transmission`, `period`, `trigger` or
            `timeout`, `valid`, `age`; and `count`.
    """

    name: Code
    title: str
    handle: Code
    identifier: int
    extended: bool
    sent: bool
    length: int
    transmission: Code
    transmission_number: int
    period: float
    timeout: float
    note: str
    signals: tuple[CanSignal, ...]
    names: dict[str, Code]

    @property
    def written_last(self) -> Code:
        """The variable of the write of its last signal."""
        return self.signals[-1].connector.written

    @property
    def label(self) -> str:
        """The message as people name it: `Motor, identifier 0x181`."""
        bits = " (29 bits)" if self.extended else ""
        return f"{self.title}, identifier 0x{self.identifier:03X}{bits}"


@dataclass(frozen=True, slots=True)
class Can:
    """The CAN bus behind a slave.

    Attributes:
        sources: The files with its messages.
        messages: Its messages; none for a slave without a file.
        left_out: A sentence for all that the files have and the block does not, with the reason.
    """

    sources: tuple[str, ...]
    messages: tuple[CanMessage, ...]
    left_out: tuple[str, ...]

    def signals(self, *, sent: bool) -> list[Connector]:
        """The connectors of all signals of one direction."""
        return [
            signal.connector
            for message in self.messages
            if message.sent == sent
            for signal in message.signals
        ]


@dataclass(frozen=True, slots=True)
class Block:
    """The block of one slave.

    Attributes:
        name: Class name.
        instance: Usual name of a component of this class.
        position: Position on the bus.
        kind: Kind of the device, derived from its process data: `drive`, `digital inputs`,
            `digital outputs`, `digital inputs and outputs`, `analog inputs`, `analog outputs`,
            `coupler`, `CAN terminal` or `other`.
        description: Description of the class.
        title: Title in the icon.
        slave_name: Name that the slave itself reports.
        slave_label: Name of the expected slave in messages.
        given_name: Name that the slave must have in the configuration; empty for no name.
        vendor: Vendor ID.
        product: Product code.
        revision: Revision number.
        profiles: Device profiles that define the units and meanings, each with its source.
        reads: Inputs of the bus: connectors with values that the block delivers.
        writes: Outputs of the bus: connectors with values that the block takes.
        skipped: Entries without connector.
        can: The CAN bus behind it, instead of its process data; empty if no file describes it.
        explained: Connectors with a note or with named values.
        left: Connectors on the left side of the icon: all of `writes`, or the signals that the
            model sends.
        right: Connectors on the right side of the icon: those of `reads` that are drawn, or the
            signals that the model receives.
        variables: Elements of `reads` that are variables without a connector.
        icon: Extent of the icon, which is the box that is drawn.
        symbol: Graphical primitives, as Modelica writes them, that show the kind of the device.
        name_extent: Place of the component's name, above the icon.
        title_extent: Place of the title in the icon.
        valid_extent: Place of the name of the connector `valid` in the icon.
        rule: Line below the title, from point to point.
    """

    name: Code
    instance: Code
    position: int
    kind: SlaveKind
    description: str
    title: str
    slave_name: str
    slave_label: str
    given_name: str
    vendor: int
    product: int
    revision: int
    profiles: tuple[str, ...]
    reads: tuple[Connector, ...]
    writes: tuple[Connector, ...]
    skipped: tuple[Skipped, ...]
    can: Can
    explained: tuple[Connector, ...]
    left: tuple[Connector, ...]
    right: tuple[Connector, ...]
    variables: tuple[Connector, ...]
    icon: Extent
    symbol: tuple[Code, ...]
    name_extent: Extent
    title_extent: Extent
    valid_extent: Extent
    rule: Extent


@dataclass(frozen=True, slots=True)
class Component:
    """A component of an example model.

    Attributes:
        class_name: Full name of its class.
        name: Its name.
        modifiers: Its modifications.
        description: Its description.
        extent: Its place in the diagram.
        prefix: `inner` and a space, or nothing.
    """

    class_name: Code
    name: Code
    modifiers: tuple[Code, ...]
    description: str
    extent: Extent
    prefix: Code = NOTHING


@dataclass(frozen=True, slots=True)
class Connection:
    """A connection of an example model.

    Attributes:
        source: The connector at its beginning.
        target: The connector at its end.
        points: Points of its line in the diagram.
        color: Colour of the line, as Modelica writes it.
    """

    source: Code
    target: Code
    points: tuple[Point, ...]
    color: Code


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable of an example model that gives a result a short name.

    Attributes:
        name: Its name.
        unit: Its unit.
        description: Its description.
        expression: Expression for its value.
    """

    name: Code
    unit: str
    description: str
    expression: Code


@dataclass(frozen=True, slots=True)
class Example:
    """A model that can be simulated.

    Attributes:
        name: Name of the model.
        description: Description of the model.
        paragraphs: Its documentation.
        components: Its components.
        connections: Its connections.
        variables: Its variables.
        diagram: Extent of the diagram.
        stop_time: End of the simulation in s.
        interval: Time between two results in s.
    """

    name: Code
    description: str
    paragraphs: tuple[str, ...]
    components: tuple[Component, ...]
    connections: tuple[Connection, ...]
    variables: tuple[Variable, ...]
    diagram: Extent
    stop_time: Code
    interval: Code


@dataclass(frozen=True, slots=True)
class DriveLine:
    """A connector of EtherCAT.Drives.CiA402, with the slave's connector for the same object.

    Attributes:
        drive: Name in CiA402, which has raw values.
        slave: Name in the block of the slave.
        conversion: Name of the block between the two if the slave has a physical value, else empty.
        class_name: Class of that block.
        size: Extent of that block, around its origin.
        origin: Origin of that block in the diagram.
        rotation: Rotation of that block in the diagram in degrees.
        scale: Physical value = raw value * scale + offset.
        offset: See scale.
    """

    drive: Code
    slave: Code
    conversion: Code
    class_name: Code
    size: Extent
    origin: Point
    rotation: int
    scale: float
    offset: float


@dataclass(frozen=True, slots=True)
class DriveParameter:
    """A parameter of a drive that follows from the units of its process data.

    Attributes:
        name: Name in EtherCAT.Interfaces.DriveParameters.
        member: Name in `ecatm_drive_settings`.
        value: Its value.
    """

    name: Code
    member: Code
    value: Code


@dataclass(frozen=True, slots=True)
class Drive:
    """A block in SI units around the block of a CiA 402 drive.

    Attributes:
        name: Class name, the same as that of the block of the slave.
        instance: Usual name of a component.
        title: Text in the icon.
        description: Description of the class.
        block: The block of the slave.
        mode: Its usual mode, an element of EtherCAT.Types.DriveMode.
        modes: The modes for which the process data are sufficient.
        modifiers: Modifications of the state machine.
        parameters: Parameters that follow from the units of the process data.
        mode_object: Index of the object for writing the mode by SDO, 0 if the process data have it.
        entries: The mapped objects in C (enum ecatm_drive_entries).
        missing: For each quantity that is not mapped: a condition that the mode must meet, and the
            name of its target.
        writes: Values that go to the slave.
        reads: Values that come from the slave.
        unused: Outputs of the slave that the state machine does not use; each has a parameter.
        slave_extent: Place of the slave in the diagram.
        connections: Lines between state machine and slave.
        diagram: Extent of the diagram.
    """

    name: Code
    instance: Code
    title: str
    description: str
    block: Block
    mode: Code
    modes: tuple[Code, ...]
    modifiers: tuple[Code, ...]
    parameters: tuple[DriveParameter, ...]
    mode_object: int
    entries: Code
    missing: tuple[tuple[Code, str], ...]
    writes: tuple[DriveLine, ...]
    reads: tuple[DriveLine, ...]
    unused: tuple[Connector, ...]
    slave_extent: Extent
    connections: tuple[Connection, ...]
    diagram: Extent


@dataclass(frozen=True, slots=True)
class Vector:
    """A connector of a block with vectors, for several equal channels or for a single one.

    Attributes:
        name: Name of the connector.
        kind: Type of its elements in the model: `Boolean`, `Integer` or `Real`.
        class_name: Modelica class of the connector.
        dimension: Its dimension in brackets, empty for a single connector.
        modifiers: Modifications of the connector: unit and quantity.
        description: Names of the entries, with their addresses.
        members: The connectors of the slave's block that are the elements of the vector.
        place: Its place in the icon.
        diagram_place: Its place in the diagram.
        label: Its name in the icon, shortened if it is long.
        label_extent: Place of the label.
    """

    name: Code
    kind: Kind
    class_name: Code
    dimension: Code
    modifiers: tuple[Code, ...]
    description: str
    members: tuple[Code, ...]
    place: Extent
    diagram_place: Extent
    label: str
    label_extent: Extent


@dataclass(frozen=True, slots=True)
class Channels:
    """A block around the block of a slave, with vectors for equal channels.

    Attributes:
        name: Class name, the same as that of the block of the slave.
        instance: Usual name of a component.
        title: Text in the icon.
        description: Description of the class.
        block: The block of the slave.
        vectors: Its connectors.
        left: Connectors on the left, which the model writes.
        right: Connectors on the right, which the model reads.
        icon: Extent of the icon.
        symbol: Graphical primitives, as Modelica writes them, that show the kind of the device.
        name_extent: Place of the component's name.
        title_extent: Place of the title.
        valid_label: Place of the label of the connector `valid`.
        valid_place: Place of the connector `valid` in the diagram.
        rule: Line below the title.
        slave_extent: Place of the slave in the diagram.
        connections: Lines between the vectors and the slave.
        diagram: Extent of the diagram.
    """

    name: Code
    instance: Code
    title: str
    description: str
    block: Block
    vectors: tuple[Vector, ...]
    left: tuple[Vector, ...]
    right: tuple[Vector, ...]
    icon: Extent
    symbol: tuple[Code, ...]
    name_extent: Extent
    title_extent: Extent
    valid_label: Extent
    valid_place: Extent
    rule: Extent
    slave_extent: Extent
    connections: tuple[Connection, ...]
    diagram: Extent


@dataclass(frozen=True, slots=True)
class Library:
    """A generated library.

    Attributes:
        name: Name of the package.
        description: Description of the package.
        bus: Name of the bus.
        cycle_time_us: Base cycle of the bus in µs.
        fingerprint: Fingerprint of the bus, 16 hex digits.
        command: Command that generates the library again.
        version: Version of the library EtherCAT that it uses.
        blocks: Blocks by position.
        drives: Blocks in SI units around the blocks of drives.
        channels: Blocks with vectors around the blocks of slaves with equal channels.
        notes: A sentence for each block that is missing or has another name, with the reason.
        examples: Example models.
    """

    name: Code
    description: str
    bus: str
    cycle_time_us: int
    fingerprint: Code
    command: str
    version: str
    blocks: tuple[Block, ...]
    drives: tuple[Drive, ...]
    channels: tuple[Channels, ...]
    notes: tuple[str, ...]
    examples: tuple[Example, ...]

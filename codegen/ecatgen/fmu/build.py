"""Builds the intermediate representation of an FMU, with all decisions about its variables."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from ecatd.base.version import VERSION
from ecatd.description.bus import Bus
from ecatd.etg.datatypes import DataType, is_real, is_signed, value_range
from ecatd.etg.pdo import Entry
from ecatd.etg.scaling import to_physical

from .. import names
from ..ir import Block, CanMessage, CanSignal, Connector, Library
from ..text import NOTHING, Code, identifier, table_text, table_word
from . import common_variables as common
from .drives import FmuDrive, find_drives
from .ir import Attributes, BusTerminal, Fmu, Slave, Unknown, Variable
from .units import units

_FLOAT = {2: "Real", 3: "Float64"}
_COUNTER = {2: "Integer", 3: "UInt32"}
_ENUMERATION_ACCESS = {2: "Integer", 3: "Int64"}
_REAL_LIMIT = {32: float(2**128 - 2**104), 64: float(2**1023) * (2 - 2.0**-52)}
_UNSET = ("Clock", "Binary")
"""Types without a start attribute. In the table, that of a clock says whether it is triggered."""
_EXTENDED = 1 << 31
"""ECAT_CAN_EXTENDED: the identifier has 29 bits."""

_KNOWN_AT_START = ("bus", "whenMissing", "patience")
"""Parameters on which the initial values of the outputs depend."""


def build_fmu(
    bus: Bus,
    library: Library,
    fmi: int,
    sources: Sequence[str],
    ecus: int = 0,
    tx_clock: str = "",
) -> Fmu:
    """Builds the FMU for a bus, without its token.

    Args:
        bus: Description of the bus.
        library: Library for the bus; the variables have its names.
        fmi: Major version of FMI: 2 or 3.
        sources: C files to compile.
        ecus: With FMI 3.0: number of virtual ECUs on the CAN bus behind the only slave.
        tx_clock: One of `TX_CLOCKS`, with ECUs.
    """
    instances = instance_names(library.blocks)
    messages = [
        (number, message)
        for number, block in enumerate(library.blocks)
        for message in block.can.messages
    ]
    drives = () if ecus else tuple(find_drives(library.blocks))
    builder = _Builder(fmi, bus, ecus, drives)
    variables = tuple(builder.all(library.blocks, instances))
    variables += tuple(builder.bus_terminals(tx_clock)) if ecus else ()
    references = {item.name: item.reference for item in variables}
    first = 1 if fmi == 2 else 0
    known = " ".join(str(references[item] + first) for item in _KNOWN_AT_START)
    return Fmu(
        fmi=fmi,
        name=library.name,
        description=library.description,
        token="",
        tool=f"ecatd {VERSION}",
        bus=bus.name,
        fingerprint=library.fingerprint,
        command=library.command + ("" if ecus else " --fmu" + ("" if fmi == 2 else " --fmi 3")),
        step_size=repr(bus.cycle_time_us / 1e6),
        unit_groups=tuple(filter(None, [units(item.unit for item in variables)])),
        enumerations=common.ENUMERATIONS
        + ((common.CAN_STATE,) if messages or ecus else ())
        + ((common.DRIVE_MODE, common.DRIVE_STATE) if drives else ()),
        categories=common.CATEGORIES,
        variables=variables,
        slaves=tuple(_slaves(library.blocks, instances, variables)),
        messages=tuple(_message(number, message) for number, message in messages),
        drives=tuple(map(_drive, drives)),
        bus_terminals=tuple(map(_bus_terminal, range(ecus))),
        unknowns=tuple(
            _unknown(item, first, known) for item in variables if item.causality == "output"
        ),
        sources=tuple(sources),
    )


def _drive(drive: FmuDrive) -> Code:
    """The line of a drive in the table."""
    scales = Code(" ").join(map(_bits, drive.scales))
    return Code("drive %d %d %d %s") % (drive.block, drive.axis, int(drive.linear), scales)


def _message(slave: int, message: CanMessage) -> Code:
    """The line of a CAN message in the table."""
    number = message.identifier | (_EXTENDED if message.extended else 0)
    return Code("message %d %08x %d %d %d %s %s") % (
        slave,
        number,
        int(message.sent),
        message.length,
        message.transmission_number,
        _bits(message.period),
        _bits(message.timeout),
    )


def instance_names(blocks: Sequence[Block]) -> list[str]:
    """Returns the prefix of each slave's variables: the usual name of its block, made unique."""
    own = [item.name for item in common.PARAMETERS + common.DIAGNOSTICS + common.OF_BUS_TERMINALS]
    namespace = names.Namespace([*own, "time"], suffix="Slave")
    return [namespace.take(block.instance) for block in blocks]


def _unknown(item: Variable, first: int, known: str) -> Unknown:
    attributes = dict(item.attributes)
    clock = dict(item.type_attributes).get("clocks", "")
    has_initial = not clock and attributes["variability"] != "constant"
    return Unknown(item.reference + first, known if has_initial else None, clock)


def ecu_name(number: int) -> str:
    """Returns the name of the bus terminal of a virtual ECU, 0 first."""
    return f"Ecu{number + 1}"


def _bus_terminal(number: int) -> BusTerminal:
    name = ecu_name(number)
    return BusTerminal(
        name=name,
        variables=tuple((f"{name}.{item}", item) for item in common.BUS_TERMINAL),
        settings=((f"{name}.{common.BUS_NOTIFICATIONS}", common.BUS_NOTIFICATIONS),),
    )


def _slaves(
    blocks: Sequence[Block], instances: Sequence[str], variables: Sequence[Variable]
) -> Iterator[Slave]:
    members: dict[str, list[tuple[str, str]]] = {instance: [] for instance in instances}
    for item in variables:
        instance, dot, member = item.name.partition(".")
        if dot and instance in members:
            members[instance].append((item.name, member))
    for block, instance in zip(blocks, instances, strict=True):
        yield Slave(
            instance=instance,
            position=block.position,
            vendor=block.vendor,
            product=block.product,
            revision=block.revision,
            given_name=block.given_name,
            label=block.slave_label,
            variables=tuple(members[instance]),
        )


@dataclass(frozen=True, slots=True)
class _Value:
    """Type, limits and start value of a variable.

    Attributes:
        element: XML element.
        access: Type of the FMI functions that get and set the variable.
        start: Start value, or None.
        minimum: Smallest value, or None.
        maximum: Largest value, or None.
        unit: Unit, or empty.
        declared: Name of the enumeration, or empty.
        more: Further XML attributes.
    """

    element: str
    access: str
    start: float | int | bool | None = None
    minimum: float | int | None = None
    maximum: float | int | None = None
    unit: str = ""
    declared: str = ""
    more: Attributes = ()

    def attributes(self) -> Attributes:
        """Returns the XML attributes of the type."""
        found = {"declaredType": self.declared, "unit": self.unit}
        for name, number in (("min", self.minimum), ("max", self.maximum), ("start", self.start)):
            found[name] = "" if number is None or self.access in _UNSET else _number(number)
        return tuple((name, value) for name, value in found.items() if value) + self.more

    def limits(self) -> str:
        """Returns the limits for the documentation."""
        if self.minimum is None or self.maximum is None:
            return ""
        return f"{_number(self.minimum)} to {_number(self.maximum)}"


class _Builder:
    """Builds variables one after the other and counts their value references."""

    def __init__(self, fmi: int, bus: Bus, ecus: int, drives: Sequence[FmuDrive]) -> None:
        self._drives = drives
        self._fmi = fmi
        self._ecus = ecus
        self._bus = bus
        self._count = 0
        self._messages = 0

    def all(self, blocks: Sequence[Block], instances: Sequence[str]) -> Iterator[Variable]:
        """Builds all variables in the order of their value references."""
        if self._fmi == 3:
            yield self._variable(
                ("time", "Simulation time"), "independent", "time", _Value("Float64", "Float64")
            )
        for item in common.PARAMETERS:
            yield self._variable(
                (item.name, item.description), "parameter", item.name, self._fixed(item)
            )
        for item in common.DIAGNOSTICS:
            yield self._variable(
                (item.name, item.description), "output", item.name, self._fixed(item)
            )
        for number, (block, instance) in enumerate(zip(blocks, instances, strict=True)):
            yield from self._slave(number, block, instance)

    def bus_terminals(self, tx_clock: str) -> Iterator[Variable]:
        """Builds the variables of all bus terminals, and those of each."""
        for item in common.OF_BUS_TERMINALS:
            value = self._fixed(item)
            if item.name != common.INTERVAL:
                yield self._variable((item.name, item.description), "output", item.name, value)
            elif tx_clock == common.TX_CLOCKS[0]:
                value = replace(value, start=self._bus.cycle_time_us / 1e6)
                yield self._variable((item.name, item.description), "parameter", item.name, value)
        for number in range(self._ecus):
            yield from self._bus_terminal(number, tx_clock)

    def _bus_terminal(self, number: int, tx_clock: str) -> Iterator[Variable]:
        place = Code(" %d") % number
        first = self._count
        references = {name: str(first + 1 + n) for n, name in enumerate(common.BUS_TERMINAL)}
        yield self._variable(
            (f"{ecu_name(number)}.{common.BUS_NOTIFICATIONS}", "Frames are confirmed, errors told"),
            "output",
            common.BUS_NOTIFICATIONS,
            _Value("Boolean", "Boolean", start=True),
            place,
            variability="constant",
        )
        for name, (causality, description) in common.BUS_TERMINAL.items():
            end, _, kind = name.partition("_")
            is_triggered = end == "Rx" or tx_clock == "triggered"
            clock = "triggered" if is_triggered else "countdown"
            more: Attributes = (("intervalVariability", clock),)
            if kind == "Data":
                more = (
                    ("clocks", references[f"{end}_Clock"]),
                    ("mimeType", common.MIME_TYPE),
                    ("maxSize", str(common.MAXIMUM[end])),
                )
            element = "Binary" if kind == "Data" else "Clock"
            yield self._variable(
                (f"{ecu_name(number)}.{name}", description),
                "output" if name == "Tx_Clock" and is_triggered else causality,
                name,
                _Value(element, element, start=int(is_triggered), more=more),
                place,
            )

    def _slave(self, number: int, block: Block, instance: str) -> Iterator[Variable]:
        entries = {
            (outputs, entry.index, entry.subindex): entry
            for outputs in (False, True)
            for _, entry, _ in reversed(list(self._slave_entries(block, outputs=outputs)))
        }
        for item in common.OF_SLAVES:
            yield self._variable(
                (_member(instance, item.name), f"{block.slave_label}: {item.description}"),
                "output",
                item.name,
                self._fixed(item),
                Code(" %d") % number,
            )
        for outputs, connectors in ((True, block.writes), (False, block.reads)):
            for connector in connectors:
                entry = entries[outputs, connector.index, connector.subindex]
                yield self._entry(number, instance, connector, entry, outputs=outputs)
        for place, drive in enumerate(self._drives):
            if drive.block == number:
                yield from self._drive(place, block, f"{instance}.{drive.name}", drive)
        if block.can.messages or self._ecus:
            yield from self._terminal(number, block, instance)

    def _drive(self, place: int, block: Block, prefix: str, drive: FmuDrive) -> Iterator[Variable]:
        """The variables of a drive in SI units."""
        torque = ("N" if drive.linear else "N.m") if drive.has_torque_unit else ""
        for name, item in common.OF_DRIVES:
            unit = item.unit.replace("LENGTH", drive.length).replace("TORQUE", torque)
            value = replace(self._fixed(item), unit=unit)
            if item.kind == "Real":
                value = replace(value, minimum=None)
            if name == "mode":
                value = replace(value, start=4 + drive.targets.index(True))
            yield self._variable(
                (_member(prefix, name), f"{block.slave_label}: {item.description}"),
                "output" if item.start is None else "input",
                item.name,
                value,
                Code(" %d %d") % (drive.block, place),
            )

    def _terminal(self, number: int, block: Block, instance: str) -> Iterator[Variable]:
        """The variables of the CAN bus behind a slave."""
        for item in common.OF_TERMINALS:
            text = _member(instance, item.name), f"{block.slave_label}: {item.description}"
            place = Code(" %d") % number
            yield self._variable(text, "output", item.name, self._fixed(item), place)
        own = [item.name for item in common.OF_SLAVES + common.OF_TERMINALS]
        namespace = names.Namespace(own, suffix="Message")
        for message in block.can.messages:
            prefix = _member(instance, namespace.take(message.name))
            yield from self._can_message(number, prefix, message)
            self._messages += 1

    def _can_message(self, number: int, prefix: str, message: CanMessage) -> Iterator[Variable]:
        fixed = common.OF_SENT if message.sent else common.OF_RECEIVED
        for item in fixed:
            text = (
                _member(prefix, common.MEMBERS[item.name]),
                f"{message.label}: {item.description}",
            )
            place = Code(" %d %d") % (number, self._messages)
            yield self._variable(text, "output", item.name, self._fixed(item), place)
        namespace = names.Namespace(common.MEMBERS.values(), suffix="Signal")
        for signal in message.signals:
            name = names.component_name(signal.entry.name, f"bit{signal.start}")
            yield self._signal(number, _member(prefix, namespace.take(name)), signal, message)

    def _signal(self, number: int, name: str, signal: CanSignal, message: CanMessage) -> Variable:
        connector, entry = signal.connector, signal.entry
        unit = table_text(connector.unit_name)
        numbers = (connector.scale, connector.offset, signal.minimum, signal.maximum)
        where = (
            *(number, self._messages, signal.start, entry.bit_length, int(signal.big_endian)),
            *(signal.number, *signal.selector),
        )
        place = Code(" %s %s%s") % (
            Code(" ").join(where),
            Code(" ").join(map(_bits, numbers)),
            Code(" %s") % unit if unit else NOTHING,
        )
        return self._variable(
            (name, connector.description),
            "input" if message.sent else "output",
            "canInput" if message.sent else "canOutput",
            self._value(connector, _without_limits(entry, message), start=message.sent),
            place,
        )

    def _slave_entries(self, block: Block, *, outputs: bool) -> Iterator[tuple[object, Entry, int]]:
        return self._bus.slaves[block.position].entries(outputs=outputs)

    def _entry(
        self, number: int, instance: str, connector: Connector, entry: Entry, *, outputs: bool
    ) -> Variable:
        numbers = (connector.scale, connector.offset, *map(float, entry.raw_range()))
        unit = table_text(connector.unit_name)
        place = Code(" %d %04x %02x %04x %d %s%s") % (
            number,
            entry.index,
            entry.subindex,
            entry.data_type,
            entry.bit_length,
            Code(" ").join(map(_bits, numbers)),
            Code(" %s") % unit if unit else NOTHING,
        )
        return self._variable(
            (_member(instance, connector.name), connector.description),
            "input" if outputs else "output",
            "input" if outputs else "output",
            self._value(connector, entry, start=outputs),
            place,
        )

    def _value(self, connector: Connector, entry: Entry, *, start: bool) -> _Value:
        """Returns the FMI type, limits and start value of an entry."""
        zero = 0 if start else None
        low, high = _raw_limits(entry)
        if entry.is_physical or is_real(entry.data_type):
            ends = sorted(to_physical(end, entry.scale, entry.offset) for end in (low, high))
            whole = is_real(entry.data_type) and entry.minimum is entry.maximum is None
            minimum, maximum = (
                None if whole or math.isinf(end) else end  # there is no infinity in XML
                for end in ends
            )
            first = None if zero is None else float(min(max(0.0, ends[0]), ends[1]))
            element = _FLOAT[self._fmi]
            unit = connector.unit or connector.unit_name
            return _Value(element, element, first, minimum, maximum, unit)
        if connector.kind == "Boolean":
            return _Value("Boolean", "Boolean", None if zero is None else False)
        first = None if zero is None else min(max(0, low), high)
        if self._fmi == 2:
            element = connector.kind
            if element == "Real":  # more than 31 bits
                first, high = first and float(first), _below(high)
            return _Value(element, element, first, low, high)
        element = _sized(entry)
        bits = int(element.lstrip("UInt"))
        whole = (low, high) == value_range(entry.data_type, bits)
        limits = (None, None) if whole else (low, high)
        return _Value(element, element, first, *limits)

    def _fixed(self, item: common.Fixed) -> _Value:
        if item.kind == "Real":
            element = _FLOAT[self._fmi]
            low = None if item.start is None else 0.0
            return _Value(element, element, item.start, low, unit=item.unit)
        if item.kind == "Counter":
            element = _COUNTER[self._fmi]
            return _Value(element, element, item.start, 0 if self._fmi == 2 else None)
        if item.kind in ("Boolean", "String"):
            return _Value(item.kind, item.kind, item.start)
        access = _ENUMERATION_ACCESS[self._fmi]
        return _Value("Enumeration", access, item.start, declared=item.kind)

    def _start_of_text(self) -> Attributes:
        """Returns the start attribute of a text; empty for FMI 3.0, which uses an element."""
        return (("start", self._bus.name),) if self._fmi == 2 else ()

    def _start_texts(self, value: _Value, causality: str) -> tuple[str, ...]:
        """Returns the start elements of FMI 3.0: those of a text, and of bytes that are set."""
        if self._fmi == 3 and value.element == "String":
            return (self._bus.name,)
        return ("",) if value.element == "Binary" and causality == "input" else ()

    def _variable(
        self,
        text: tuple[str, str],
        causality: str,
        role: str,
        value: _Value,
        place: Code = NOTHING,
        *,
        variability: str = "",
    ) -> Variable:
        name, description = text
        usual = {"parameter": "fixed", "independent": "continuous"}.get(causality, "discrete")
        access = "Real" if value.access in _FLOAT.values() else value.access
        words = (identifier(access), identifier(role), _start(value), table_word(name), place)
        is_text = value.element == "String"
        attributes = {
            "name": name,
            "valueReference": str(self._count),
            "description": description,
            "causality": causality,
            "variability": variability or usual,
        }
        self._count += 1
        return Variable(
            reference=self._count - 1,
            name=name,
            description=description,
            causality=causality,
            element=identifier(value.element),
            attributes=tuple(attributes.items()),
            type_attributes=self._start_of_text() if is_text else value.attributes(),
            start_texts=self._start_texts(value, causality),
            unit=value.unit,
            kind=value.declared or value.element,
            limits=value.limits(),
            row=Code("variable %s %s %s %s%s") % words,
        )


def _without_limits(entry: Entry, message: CanMessage) -> Entry:
    """What another node sends may be beyond the limits, which importers take for a failure."""
    return entry if message.sent else replace(entry, minimum=None, maximum=None)


def _member(instance: str, name: str) -> str:
    return f"{instance}.{name}"


def _sized(entry: Entry) -> str:
    """Returns the smallest integer type of FMI 3.0 that holds the entry."""
    bits = next(size for size in (8, 16, 32, 64) if entry.bit_length <= size)
    return f"{'' if is_signed(entry.data_type) else 'U'}Int{bits}"


def _raw_limits(entry: Entry) -> tuple[float | int, float | int]:
    """Returns the smallest and largest raw value of an entry, by its type and declared range."""
    low: float | int
    high: float | int
    if is_real(entry.data_type):
        high = _REAL_LIMIT[entry.bit_length]
        low = -high
    else:
        low, high = value_range(entry.data_type, entry.bit_length)
        if entry.data_type == DataType.BOOLEAN:
            high = 1
    declared = entry.raw_range()
    return max(low, declared[0]), min(high, declared[1])


def _below(value: float | int) -> float:
    """Returns the largest float that is not above a value; 2^63 - 1, for example, is not one."""
    nearest = float(value)
    return math.nextafter(nearest, -math.inf) if nearest > value else nearest


def _bits(value: float) -> Code:
    """Returns the IEEE 754 bits of a number as 16 hexadecimal digits."""
    return Code("%016x") % int.from_bytes(struct.pack(">d", value), "big")


def _start(value: _Value) -> Code:
    if value.access == "String":
        return Code("-")
    start = value.start or (1 if value.declared else 0)  # enumerations begin at 1
    return _bits(float(start)) if value.access in _FLOAT.values() else Code("%d") % int(start)


def _number(value: float | int | bool) -> str:
    return str(value).lower() if isinstance(value, bool) else repr(value)

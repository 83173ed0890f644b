"""From a slave of the bus description to its block."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from ecatd.model.bus import Entry, Pdo, Slave
from ecatd.model.datatypes import DataType, is_real, is_signed, type_name

from . import layout, names
from .ir import Block, Connector, Extent, Kind, Skipped
from .profiles import Meaning, Profiles
from .profiles.profile import SlaveProfile
from .units import QUANTITIES, modelica_unit

_MAX_BITS = 64  # of one entry in the shared memory
_START = {"Boolean": "false", "Integer": "0", "Real": "0"}

NO_PROFILES = Profiles()
RAW = Meaning()

EXAMPLE_COMPONENTS = (
    *("etherCATMaster", "enable", "startUp", "reference", "standstill", "target", "toInteger"),
    *("ratedTorque", "off", "zero", "zeroReal", "w_ref", "w_m", "i_m"),
)
"""Names that the example models use beside those of the blocks."""

# Names that the blocks and their base class use, and so no connector can have.
_RESERVED = (
    *("domainID", "slaveData", "hwName", "fingerprint", "generateCommand", "etherCATMaster"),
    *("domain", "slave", "slaveConfiguration", "committed", "Modelica", "EtherCAT"),
    *("valid", "alState", "alStatusCode"),
)


def build_blocks(
    slaves: Iterable[Slave], library: str, profiles: Profiles = NO_PROFILES
) -> tuple[Block, ...]:
    """The blocks of all slaves, in their order on the bus.

    A class is named after the type of its slave. Only slaves of the same type are counted, from
    the second one on, so that other slaves that are added do not change the name.
    """
    namespace = names.Namespace(
        {*names.FOREIGN_LIBRARIES, library, "UsersGuide", "Examples"}
        | {"fingerprint", "generateCommand"},
        suffix="Slave",
    )
    instances = names.Namespace(EXAMPLE_COMPONENTS, suffix="Slave")
    blocks = []
    for slave in slaves:
        name = namespace.take(names.class_name(slave.name, f"Slave{slave.product:08X}"))
        instance = instances.take(names.instance_name(name))
        blocks.append(_block(slave, name, instance, profiles.of(slave)))
    return tuple(blocks)


def kind_of(entry: Entry, meaning: Meaning = RAW) -> Kind:
    """The Modelica type of an entry: a Modelica Integer has 32 bits and a sign."""
    if meaning.is_physical:
        return "Real"
    if entry.data_type == DataType.BOOLEAN or entry.bit_length == 1:
        return "Boolean"
    if is_real(entry.data_type):
        return "Real"
    return "Integer" if entry.bit_length <= 31 + is_signed(entry.data_type) else "Real"


def _block(slave: Slave, name: str, instance: str, profile: SlaveProfile) -> Block:
    skipped: list[Skipped] = []
    writes = list(_usable(slave, skipped, outputs=True))
    reads = list(_usable(slave, skipped, outputs=False))
    connector_names = names.connector_names(
        [
            (pdo.name, entry.name, f"object {entry.index:04X} {entry.subindex:02X}")
            for pdo, entry in writes + reads
        ],
        _RESERVED,
    )
    title = f"{name}, slave {slave.position}"
    output_names, input_names = connector_names[: len(writes)], connector_names[len(writes) :]
    drawn = (
        n
        for n, (_, entry) in zip(input_names, reads, strict=True)
        if profile.meaning(entry).connector
    )
    icon = layout.icon(title, output_names, drawn)
    outputs = _connectors(writes, output_names, icon, profile, outputs=True)
    inputs = _connectors(reads, input_names, icon, profile, outputs=False)
    label = slave.name or f"product 0x{slave.product:08X}"
    return Block(
        name=name,
        instance=instance,
        position=slave.position,
        description=f"{label}, slave {slave.position}",
        title=title,
        slave_name=slave.name,
        slave_label=label,
        vendor=slave.vendor,
        product=slave.product,
        revision=slave.revision,
        reads=inputs,
        writes=outputs,
        skipped=tuple(skipped),
        left=outputs,
        right=tuple(c for c in inputs if c.placement),
        explained=tuple(c for c in outputs + inputs if c.note or c.values),
        icon=icon,
        name_extent=layout.above(icon),
        title_extent=layout.title(icon),
        valid_extent=layout.valid_label(),
        rule=layout.rule(icon),
    )


def _usable(slave: Slave, skipped: list[Skipped], *, outputs: bool) -> Iterator[tuple[Pdo, Entry]]:
    seen = set()
    for pdo, entry, _ in slave.entries(outputs=outputs):
        address = (entry.index, entry.subindex)
        reason = ""
        if entry.bit_length > _MAX_BITS:
            reason = f"more than {_MAX_BITS} bits"
        elif address in seen:
            reason = "mapped twice; the first one has the connector"
        seen.add(address)
        if reason:
            skipped.append(
                Skipped(
                    entry.address, entry.name, type_name(entry.data_type), entry.bit_length, reason
                )
            )
        else:
            yield pdo, entry


def _connectors(
    entries: Sequence[tuple[Pdo, Entry]],
    connector_names: Sequence[str],
    icon: Extent,
    profile: SlaveProfile,
    *,
    outputs: bool,
) -> tuple[Connector, ...]:
    result: list[Connector] = []
    row = 0
    for (pdo, entry), name in zip(entries, connector_names, strict=True):
        meaning = profile.meaning(entry)
        drawn = outputs or meaning.connector
        kind = kind_of(entry, meaning)
        place = f"{entry.index:04X}_{entry.subindex:02X}"  # no connector has such a name
        result.append(
            Connector(
                name=name,
                handle=f"{'output' if outputs else 'input'}_{place}",
                written=f"written_{place}",
                after=result[-1].written if outputs and result else "etherCATMaster.cycle",
                direction="output" if outputs else "input" if drawn else "(input)",
                kind=kind,
                class_name=_class_name(kind, outputs=outputs) if drawn else f"output {kind}",
                function=kind.lower(),
                index=entry.index,
                subindex=entry.subindex,
                address=entry.address,
                data_type=entry.data_type,
                type_name=type_name(entry.data_type),
                bit_length=entry.bit_length,
                description=_description(pdo, entry),
                pdo_name=pdo.name,
                entry_name=entry.name,
                modifiers=tuple(_modifiers(kind, meaning, outputs=outputs)),
                scaling=_scaling(meaning),
                scale=meaning.scale,
                offset=meaning.offset,
                unit=modelica_unit(meaning.unit),
                unit_name=meaning.unit,
                conversion=_conversion(meaning),
                note=meaning.note,
                values=meaning.values,
                placement=_placement(layout.port(icon, row, left=outputs)) if drawn else "",
                label_extent=layout.port_label(icon, row, name, left=outputs) if drawn else None,
            )
        )
        row += drawn
    return tuple(result)


def _description(pdo: Pdo, entry: Entry) -> str:
    text = ": ".join(dict.fromkeys(filter(None, (pdo.name, entry.name))))
    return f"{text} ({entry.address})" if text else entry.address


def _class_name(kind: Kind, *, outputs: bool) -> str:
    return f"Modelica.Blocks.Interfaces.{kind}{'Input' if outputs else 'Output'}"


def _placement(extent: Extent) -> str:
    return f"\n    annotation (Placement(transformation(extent = {extent})))"


def _modifiers(kind: Kind, meaning: Meaning, *, outputs: bool) -> Iterator[str]:
    unit, display_unit = modelica_unit(meaning.unit), meaning.display_unit
    quantity = meaning.quantity or QUANTITIES.get(unit, "")
    if quantity:
        yield f'quantity = "{quantity}"'
    if unit:
        yield f'unit = "{unit}"'
    if display_unit:
        yield f'displayUnit = "{display_unit}"'
    if not outputs:  # what the model writes has no start value: it follows from the equations
        yield f"start = {_START[kind]}"
        yield "fixed = true"


def _scaling(meaning: Meaning) -> str:
    """Arguments in the syntax of Modelica and of C, whose numbers are alike."""
    if meaning.scale == 1 and meaning.offset == 0:
        return ""
    return f", {meaning.scale!r}, {meaning.offset!r}"


def _conversion(meaning: Meaning) -> str:
    if meaning.scale == 1 and meaning.offset == 0:
        return ""
    shift = f" {'+' if meaning.offset > 0 else '-'} {abs(meaning.offset):g}"
    return f"raw * {meaning.scale:g}{shift if meaning.offset else ''}"

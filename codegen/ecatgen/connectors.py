"""From a PDO entry to the connector of a block, or to a variable."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ecatd.model.bus import Entry, Pdo
from ecatd.model.datatypes import DataType, is_real, is_signed, type_name

from . import layout
from .ir import Connector, Extent, Kind
from .profiles import Meaning
from .profiles.profile import SlaveProfile
from .units import QUANTITIES, modelica_unit

_START = {"Boolean": "false", "Integer": "0", "Real": "0"}

RAW = Meaning()


def kind_of(entry: Entry, meaning: Meaning = RAW) -> Kind:
    """The Modelica type of an entry: a Modelica Integer has 32 bits and a sign."""
    if meaning.is_physical:
        return "Real"
    if entry.data_type == DataType.BOOLEAN or entry.bit_length == 1:
        return "Boolean"
    if is_real(entry.data_type):
        return "Real"
    return "Integer" if entry.bit_length <= 31 + is_signed(entry.data_type) else "Real"


def connectors(
    entries: Sequence[tuple[Pdo, Entry]],
    names: Sequence[str],
    labels: Sequence[str],
    icon: Extent,
    profile: SlaveProfile,
    *,
    outputs: bool,
) -> tuple[Connector, ...]:
    """The connectors for the entries of one direction.

    Args:
        entries: The entries, each with its PDO.
        names: Their names.
        labels: Their names in the icon, empty for variables.
        icon: Extent of the icon.
        profile: What is known about the slave.
        outputs: Whether the model writes them.
    """
    result: list[Connector] = []
    row = 0
    for (pdo, entry), name, label in zip(entries, names, labels, strict=True):
        meaning = profile.meaning(entry)
        drawn = is_drawn(meaning, outputs=outputs)
        kind = kind_of(entry, meaning)
        place = f"{entry.index:04X}_{entry.subindex:02X}"  # no connector has such a name
        result.append(
            Connector(
                name=name,
                handle=f"{'output' if outputs else 'input'}_{place}",
                written=f"written_{place}",
                after=result[-1].written if outputs and result else "etherCATMaster.cycle",
                direction="output" if outputs else "input",
                access="write" if outputs else "read",
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
                label=label,
                label_extent=layout.port_label(icon, row, label, left=outputs) if drawn else None,
            )
        )
        row += drawn
    return tuple(result)


def is_drawn(meaning: Meaning, *, outputs: bool) -> bool:
    """Whether an entry has a connector: what the model writes, cannot be left to nobody."""
    return outputs or meaning.connector


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

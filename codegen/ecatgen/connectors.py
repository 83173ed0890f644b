"""Builds a connector of a block, or a variable, for each PDO entry."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ecatd.description.units import QUANTITIES, modelica_unit
from ecatd.etg.datatypes import DataType, is_real, is_signed, type_name
from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.scaling import formula_text

from . import placement
from .ir import Connector, Extent, Kind
from .text import NOTHING, Code, code, identifier, modelica_string

_START = {"Boolean": Code("false"), "Integer": Code("0"), "Real": Code("0")}


def kind_of(entry: Entry) -> Kind:
    """Returns the Modelica type of an entry: Real if it is physical, else the raw value's type."""
    return "Real" if entry.is_physical else raw_kind_of(entry)


def raw_kind_of(entry: Entry) -> Kind:
    """Returns the Modelica type of a raw value; integers beyond 32 signed bits are Real."""
    if entry.data_type == DataType.BOOLEAN or entry.bit_length == 1:
        return "Boolean"
    if is_real(entry.data_type):
        return "Real"
    return "Integer" if entry.bit_length <= 31 + is_signed(entry.data_type) else "Real"


def connectors(
    entries: Sequence[tuple[Pdo, Entry]],
    names: Sequence[Code],
    labels: Sequence[str],
    icon: Extent,
    *,
    outputs: bool,
) -> tuple[Connector, ...]:
    """Builds the connectors for the entries of one direction.

    Args:
        entries: The entries, each with its PDO.
        names: Names of the connectors.
        labels: Names of the connectors in the icon; empty for variables.
        icon: Extent of the icon.
        outputs: Whether the model writes the entries.
    """
    result: list[Connector] = []
    row = 0
    for (pdo, entry), name, label in zip(entries, names, labels, strict=True):
        drawn = is_drawn(entry, outputs=outputs)
        kind = kind_of(entry)
        place = (entry.index, entry.subindex)  # no connector has such a name
        extent = placement.port_label(icon, row, label, left=outputs)
        result.append(
            Connector(
                name=name,
                handle=Code("output_%04X_%02X" if outputs else "input_%04X_%02X") % place,
                written=Code("written_%04X_%02X") % place,
                after=result[-1].written if outputs and result else Code("etherCATMaster.cycle"),
                direction="output" if outputs else "input",
                access="write" if outputs else "read",
                kind=kind,
                raw_kind=raw_kind_of(entry),
                class_name=_class_name(kind, drawn=drawn, outputs=outputs),
                function=identifier(kind.lower()),
                index=entry.index,
                subindex=entry.subindex,
                address=address_code(entry),
                data_type=entry.data_type,
                type_name=type_name(entry.data_type),
                bit_length=entry.bit_length,
                description=_description(pdo, entry),
                pdo_name=pdo.name,
                entry_name=entry.name,
                modifiers=(*unit_modifiers(entry), *_start(kind, outputs=outputs)),
                scaling=_scaling(entry),
                scale=entry.scale,
                offset=entry.offset,
                unit=modelica_unit(entry.unit),
                unit_name=entry.unit,
                conversion=_conversion(entry),
                note=entry.note,
                values=tuple(entry.values),
                placement=_placement(placement.port(icon, row, left=outputs)) if drawn else NOTHING,
                label=label,
                label_extent=extent if drawn else None,
            )
        )
        row += drawn
    return tuple(result)


def is_drawn(entry: Entry, *, outputs: bool) -> bool:
    """Whether an entry has a connector: all outputs do, since a model must write each of them."""
    return outputs or entry.connector


def _description(pdo: Pdo, entry: Entry) -> str:
    text = ": ".join(dict.fromkeys(filter(None, (pdo.name, entry.name))))
    return f"{text} ({entry.address})" if text else entry.address


def address_code(entry: Entry) -> Code:
    """Returns the address of an entry, as people read it."""
    return Code("0x%04X:%02X") % (entry.index, entry.subindex)


def _class_name(kind: Kind, *, drawn: bool, outputs: bool) -> Code:
    if not drawn:
        return Code("output %s") % identifier(kind)
    direction = Code("Input" if outputs else "Output")
    return Code("Modelica.Blocks.Interfaces.%s%s") % (identifier(kind), direction)


def _placement(extent: Extent) -> Code:
    return Code("\n    annotation (Placement(transformation(extent = %s)))") % extent


def unit_modifiers(entry: Entry) -> Iterator[Code]:
    """Yields the modifications of a connector that say what its value is: quantity and units."""
    unit, display_unit = modelica_unit(entry.unit), entry.display_unit
    quantity = entry.quantity or QUANTITIES.get(unit, "")
    if quantity:
        yield Code("quantity = %s") % modelica_string(quantity)
    if unit:
        yield Code("unit = %s") % modelica_string(unit)
    if display_unit:
        yield Code("displayUnit = %s") % modelica_string(display_unit)


def _start(kind: Kind, *, outputs: bool) -> Iterator[Code]:
    if not outputs:  # an output has no start value: the equations of the model give it
        yield Code("start = %s") % _START[kind]
        yield Code("fixed = true")


def _scaling(entry: Entry) -> Code:
    """Returns scale and offset as further arguments; numbers look the same in Modelica and C."""
    if not entry.is_physical:
        return NOTHING
    return Code(", %s, %s") % (code(entry.scale), code(entry.offset))


def _conversion(entry: Entry) -> str:
    if entry.scale == 1 and entry.offset == 0:
        return ""
    return formula_text("raw", entry.scale, entry.offset)

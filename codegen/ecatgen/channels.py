"""Builds blocks with vectors around the blocks of slaves that have several equal channels."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

from . import names, placement
from .ir import Block, Channels, Connection, Connector, Extent, Point, Vector
from .labels import label
from .symbols import symbol
from .text import NOTHING, Code

_NUMBER = re.compile(r"\d+")
_COLORS = {
    "Boolean": Code("{255, 0, 255}"),
    "Integer": Code("{255, 127, 0}"),
    "Real": Code("{0, 0, 127}"),
}
_RESERVED = ("domainID", "slave", "valid", "Modelica", "EtherCAT")
_START = ("start = ", "fixed = ")
_CENTRE = Point(0, 0)  # centre of the slave in the diagram
_REACH = 40  # distance from the slave to the vectors
_LANE = 6  # distance from the slave to the vertical parts of lines
_HALF = 2  # half the size of a connector in the diagram


def build_channels(blocks: Iterable[Block]) -> tuple[Channels, ...]:
    """Builds a block with vectors for each slave that has at least two equal channels."""
    return tuple(made for block in blocks if (made := _channels(block)) is not None)


def _channels(block: Block) -> Channels | None:
    if block.can.messages:  # its parameters would be out of reach
        return None
    sides = [list(_groups(connectors)) for connectors in (block.left, block.right)]
    if all(len(group) == 1 for groups in sides for group in groups):
        return None
    namespace = names.Namespace(_RESERVED, suffix="Channel")
    titles = [[namespace.take(_name(group)) for group in groups] for groups in sides]
    labels = [
        [label(name) + _dimension(group) for group, name in zip(groups, side, strict=True)]
        for groups, side in zip(sides, titles, strict=True)
    ]
    icon = placement.icon(block.title, *labels)
    left, right = (
        tuple(
            _vector(block, group, name, icon, row, left=at_left)
            for row, (group, name) in enumerate(zip(groups, side, strict=True))
        )
        for groups, side, at_left in zip(sides, titles, (True, False), strict=True)
    )
    slave = placement.in_diagram(block.icon, _CENTRE)
    valid = Point(slave.b.x + _REACH, placement.valid_point(block.icon, _CENTRE).y)
    return Channels(
        name=block.name,
        instance=block.instance,
        title=block.title,
        description=f"{block.description}, with vectors",
        block=block,
        vectors=left + right,
        left=left,
        right=right,
        icon=icon,
        symbol=symbol(block.kind, placement.symbol_corner(icon)),
        name_extent=placement.above(icon),
        title_extent=placement.title(icon),
        valid_label=placement.valid_label(),
        valid_place=_around(valid),
        rule=placement.rule(icon),
        slave_extent=slave,
        connections=(
            *_lines(block, left, at_left=True),
            Connection(
                Code("slave.valid"),
                Code("valid"),
                (placement.valid_point(block.icon, _CENTRE), valid),
                _COLORS["Boolean"],
            ),
            *_lines(block, right, at_left=False),
        ),
        diagram=placement.extent(
            slave.a.x - _REACH - 20, slave.a.y - 20, slave.b.x + _REACH + 20, slave.b.y + 20
        ),
    )


def _groups(connectors: Sequence[Connector]) -> Iterator[list[Connector]]:
    """Groups equal connectors that are numbered from 1 on; any other connector is a group alone."""
    alike: dict[tuple[object, ...], list[Connector]] = {}
    for connector in connectors:
        alike.setdefault(_likeness(connector), []).append(connector)
    done = set()
    for connector in connectors:
        group = alike[_likeness(connector)]
        if connector.name in done:
            continue
        if len(group) > 1 and _numbers(group) == list(range(1, len(group) + 1)):
            done |= {member.name for member in group}
            yield group
        else:
            yield [connector]


def _likeness(connector: Connector) -> tuple[object, ...]:
    return (
        _NUMBER.sub("", connector.name, count=1),
        connector.kind,
        connector.data_type,
        connector.bit_length,
        connector.scale,
        connector.offset,
        connector.modifiers,
    )


def _numbers(group: Sequence[Connector]) -> list[int]:
    """Returns the first number in each name, or -1 if the name has no number."""
    found = (_NUMBER.search(connector.name) for connector in group)
    return [int(match[0]) if match else -1 for match in found]


def _name(group: Sequence[Connector]) -> str:
    first = group[0].name
    return _NUMBER.sub("", first, count=1) if len(group) > 1 else first


def _dimension(group: Sequence[Connector]) -> Code:
    return Code("[%d]") % len(group) if len(group) > 1 else NOTHING


def _vector(
    block: Block, group: Sequence[Connector], name: Code, icon: Extent, row: int, *, left: bool
) -> Vector:
    first, dimension = group[0], _dimension(group)
    text, is_vector = label(name) + dimension, bool(dimension)
    modifiers = [item for item in first.modifiers if not item.startswith(_START)]
    return Vector(
        name=name,
        kind=first.kind,
        class_name=first.class_name,
        dimension=dimension,
        modifiers=tuple(Code("each %s") % item if is_vector else item for item in modifiers),
        description=(
            f"{first.description} to {group[-1].description}" if is_vector else first.description
        ),
        members=tuple(connector.name for connector in group),
        place=placement.port(icon, row, left=left),
        diagram_place=_around(_point(block, group, left=left)),
        label=text,
        label_extent=placement.port_label(icon, row, text, left=left),
    )


def _ports(block: Block, *, left: bool) -> dict[str, Point]:
    """Returns the points at which lines meet the connectors of the slave, by connector name."""
    return {
        connector.name: placement.port_point(block.icon, row, _CENTRE, left=left)
        for row, connector in enumerate(block.left if left else block.right)
    }


def _point(block: Block, group: Sequence[Connector], *, left: bool) -> Point:
    """Returns the place of a vector in the diagram, at the height of its middle member."""
    middle = _ports(block, left=left)[group[(len(group) - 1) // 2].name]
    slave = placement.in_diagram(block.icon, _CENTRE)
    return Point(slave.a.x - _REACH if left else slave.b.x + _REACH, middle.y)


def _around(centre: Point) -> Extent:
    return placement.extent(centre.x - _HALF, centre.y - _HALF, centre.x + _HALF, centre.y + _HALF)


def _lines(block: Block, vectors: Sequence[Vector], *, at_left: bool) -> Iterator[Connection]:
    """Draws lines between the vectors and the slave, with one vertical lane for each vector."""
    ports = _ports(block, left=at_left)
    for number, vector in enumerate(vectors):
        place = vector.diagram_place
        end = Point((place.a.x + place.b.x) // 2, (place.a.y + place.b.y) // 2)
        for member, name in enumerate(vector.members, 1):
            outer = Code("%s[%d]") % (vector.name, member) if vector.dimension else vector.name
            port = ports[name]
            lane = port.x + (-1 if at_left else 1) * (_LANE + 2 * number % (_REACH - 2 * _LANE))
            points = placement.route(end, port, lane)
            color, inner = _COLORS[vector.kind], Code("slave.%s") % name
            if at_left:
                yield Connection(outer, inner, points, color)
            else:
                yield Connection(inner, outer, points[::-1], color)

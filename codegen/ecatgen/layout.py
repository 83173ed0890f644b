"""Where things are in icons and diagrams.

A block is a box with one connector per row: outputs of the bus (what the model writes) on the
left, inputs of the bus (what it reads) on the right. Its top right corner is at (100, 100), as in
every icon, whatever its size: PartialSlave has its connector `valid` there.
"""

from __future__ import annotations

from dataclasses import dataclass

from .ir import Extent, Point

ROW = 20
_RIGHT = _TOP = 100
_LEFT = -200
_TITLE = 40
_SCALE = 5  # units of an icon in a unit of a diagram


@dataclass(frozen=True, slots=True)
class Size:
    """Half of the height of a block's icon."""

    half: int


def block_size(left: int, right: int) -> Size:
    """The size of a block with so many connectors on its sides."""
    rows = max(left, right)
    return Size(max(100, -(-(rows * ROW + _TITLE) // 40) * 20))


def extent(x1: int, y1: int, x2: int, y2: int) -> Extent:
    """A rectangle."""
    return Extent(Point(x1, y1), Point(x2, y2))


def icon(size: Size) -> Extent:
    """The whole icon."""
    return extent(_LEFT, _TOP - 2 * size.half, _RIGHT, _TOP)


def above() -> Extent:
    """The place of the component's name, above the icon."""
    return extent(_LEFT, _TOP + 50, _RIGHT, _TOP + 10)


def title() -> Extent:
    """The place of the title, at the top of the box."""
    return extent(_LEFT + 10, _TOP - 5, _RIGHT - 10, _TOP - 35)


def row_y(row: int) -> int:
    """The height of a row of connectors."""
    return _TOP - _TITLE - ROW // 2 - row * ROW


def port(row: int, *, left: bool) -> Extent:
    """The place of a connector."""
    y = row_y(row)
    half = ROW // 2
    x = _LEFT - ROW if left else _RIGHT
    return extent(x, y - half, x + ROW, y + half)


def port_label(row: int, *, left: bool) -> Extent:
    """The place of a connector's name beside it."""
    y = row_y(row)
    middle = (_LEFT + _RIGHT) // 2
    if left:
        return extent(_LEFT + 5, y - 8, middle - 2, y + 8)
    return extent(middle + 2, y - 8, _RIGHT - 5, y + 8)


def port_point(size: Size, row: int, centre: Point, *, left: bool) -> Point:
    """Where a line ends at a connector of a block that is drawn around `centre` in a diagram."""
    x = (_RIGHT - _LEFT) // 2 + ROW // 2
    y = row_y(row) - (_TOP - size.half)
    return Point(centre.x + (-x if left else x) // _SCALE, centre.y + y // _SCALE)


def diagram_half(size: Size) -> int:
    """Half of the height of a block in a diagram."""
    return size.half // _SCALE


def in_diagram(size: Size, centre: Point) -> Extent:
    """The place of a block in a diagram."""
    x, y = (_RIGHT - _LEFT) // 2 // _SCALE, diagram_half(size)
    return extent(centre.x - x, centre.y - y, centre.x + x, centre.y + y)


def route(start: Point, end: Point, x: int | None = None) -> tuple[Point, ...]:
    """A line in right angles, whose vertical part is at `x`."""
    if start.y == end.y:
        return (start, end)
    middle = (start.x + end.x) // 2 if x is None else x
    return (start, Point(middle, start.y), Point(middle, end.y), end)

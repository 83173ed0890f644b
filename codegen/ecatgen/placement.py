"""The layout of icons and diagrams.

A block is a box with a title and one connector per row: outputs of the bus (which the model writes)
on the left, inputs of the bus (which it reads) on the right. Ten units of an icon are one unit of a
diagram, as for the blocks of the standard library. The top right corner is always at (100, 100):
PartialSlave has its connector `valid` there, beside the title.
"""

from __future__ import annotations

from collections.abc import Iterable

from . import font
from .ir import Extent, Point

ROW = 40
_PORT = 20
_RIGHT = _TOP = 100
_HEADER = 40
_LABEL, _TITLE = 28, 32  # heights of texts
_MARGIN, _GAP = 10, 40  # space beside texts, and between the texts of both sides
_SCALE = 10  # units of an icon in a unit of a diagram
_GRID = 40  # sizes are multiples of this, so that half sizes are on the grid of a diagram
_SMALLEST = 120  # smallest height
_SYMBOL = 32  # width and height
_VALID = "valid"  # name of the connector of PartialSlave


def icon(title: str, left: Iterable[str], right: Iterable[str]) -> Extent:
    """Returns the box of an icon with this title and these connectors on its sides."""
    left, right = list(left), list(right)
    rows = max(len(left), len(right))
    names = _widest(left) + _widest(right) + _GAP
    header = _SYMBOL + _MARGIN + _width(title, _TITLE, bold=True) + _GAP + _width(_VALID, _LABEL)
    width = _up(max(names, header) + 2 * _MARGIN)
    height = _up(max(_HEADER + rows * ROW, _SMALLEST))
    return extent(_RIGHT - width, _TOP - height, _RIGHT, _TOP)


def _widest(names: Iterable[str]) -> float:
    return max((_width(name, _LABEL) for name in names), default=0)


def _width(text: str, height: int, *, bold: bool = False) -> float:
    # 5 % are added, since tools use different fonts.
    return 1.05 * font.width(text, bold=bold) * height / font.LINE


def _up(size: float) -> int:
    return -int(-size // _GRID) * _GRID


def extent(x1: int, y1: int, x2: int, y2: int) -> Extent:
    """Returns a rectangle."""
    return Extent(Point(x1, y1), Point(x2, y2))


def above(icon: Extent) -> Extent:
    """Returns the place of the component's name, above the icon."""
    return extent(icon.a.x, _TOP + 50, _RIGHT, _TOP + 10)


def symbol_corner(icon: Extent) -> Point:
    """Returns the lower left corner of the symbol, which is left of the title."""
    return Point(icon.a.x + _MARGIN, _TOP - (_HEADER + _SYMBOL) // 2)


def title(icon: Extent) -> Extent:
    """Returns the place of the title, at the top of the box."""
    x = _RIGHT - round(_width(_VALID, _LABEL)) - _MARGIN - _GAP // 2
    return _text(icon.a.x + _SYMBOL + 2 * _MARGIN, x, _TOP - _HEADER // 2, _TITLE)


def valid_label() -> Extent:
    """Returns the place of the name of the connector `valid`."""
    x = _RIGHT - _MARGIN
    return _text(x - round(_width(_VALID, _LABEL)), x, _TOP - _HEADER // 2, _LABEL)


def rule(icon: Extent) -> Extent:
    """Returns the line below the title, from point to point."""
    return extent(icon.a.x, _TOP - _HEADER, _RIGHT, _TOP - _HEADER)


def _text(x1: int, x2: int, y: int, height: int) -> Extent:
    return extent(x1, y - height // 2, x2, y + height // 2)


def _row_y(row: int) -> int:
    return _TOP - _HEADER - ROW // 2 - row * ROW


def port(icon: Extent, row: int, *, left: bool) -> Extent:
    """Returns the place of a connector."""
    y, half = _row_y(row), _PORT // 2
    x = icon.a.x - _PORT if left else _RIGHT
    return extent(x, y - half, x + _PORT, y + half)


def port_label(icon: Extent, row: int, name: str, *, left: bool) -> Extent:
    """Returns the place of a connector's name beside it."""
    width = round(_width(name, _LABEL)) + 1
    if left:
        x = icon.a.x + _MARGIN
        return _text(x, x + width, _row_y(row), _LABEL)
    x = _RIGHT - _MARGIN
    return _text(x - width, x, _row_y(row), _LABEL)


def port_point(icon: Extent, row: int, centre: Point, *, left: bool, scale: int = _SCALE) -> Point:
    """Returns the point at which a line meets a connector of a block in a diagram.

    Args:
        icon: The icon of the block.
        row: Row of the connector.
        centre: Centre of the block.
        left: Whether the connector is on the left side.
        scale: Units of the icon in one unit of the diagram.
    """
    return _at(icon, _row_y(row), centre, left=left, scale=scale)


def valid_point(icon: Extent, centre: Point, scale: int = _SCALE) -> Point:
    """Returns the point at which a line meets the connector `valid`; see `port_point`."""
    return _at(icon, _TOP - _HEADER // 2, centre, left=False, scale=scale)


def _at(icon: Extent, icon_y: int, centre: Point, *, left: bool, scale: int) -> Point:
    x = (_RIGHT - icon.a.x) // 2 + _PORT // 2
    y = icon_y - (icon.a.y + _TOP) // 2
    return Point(centre.x + (-x if left else x) // scale, centre.y + y // scale)


def half_width(icon: Extent, scale: int = _SCALE) -> int:
    """Returns half of the width of a block in a diagram."""
    return (icon.b.x - icon.a.x) // 2 // scale


def half_height(icon: Extent, scale: int = _SCALE) -> int:
    """Returns half of the height of a block in a diagram."""
    return (icon.b.y - icon.a.y) // 2 // scale


def in_diagram(icon: Extent, centre: Point, scale: int = _SCALE) -> Extent:
    """Returns the place of a block in a diagram."""
    x, y = half_width(icon, scale), half_height(icon, scale)
    return extent(centre.x - x, centre.y - y, centre.x + x, centre.y + y)


def route(start: Point, end: Point, x: int | None = None) -> tuple[Point, ...]:
    """Returns a line with right angles; its vertical part is at `x`, by default in the middle."""
    if start.y == end.y:
        return (start, end)
    middle = (start.x + end.x) // 2 if x is None else x
    return (start, Point(middle, start.y), Point(middle, end.y), end)

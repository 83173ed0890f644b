"""The kind of a device, and the symbol in the icon of its block: 32 by 32 units."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator

from ecatd.description.bus import Slave

from .ir import Kind, Point, SlaveKind
from .text import Code

_CONTROL_WORD, _STATUS_WORD = (0x6040, 0), (0x6041, 0)
_COUPLER = re.compile(r"(EK|BK|CU|EPP?9|EKM)[0-9]|.*(coupler|junction)", re.IGNORECASE)

_DARK, _FILL = Code("{64, 64, 64}"), Code("{95, 158, 160}")


def slave_kind(slave: Slave, writes: Collection[Kind], reads: Collection[Kind]) -> SlaveKind:
    """Returns the kind of a slave by its process data, or by its name if it has none.

    Args:
        slave: The slave.
        writes: Types of the connectors for its outputs.
        reads: Types of the connectors for its inputs.
    """
    if _has(slave, _CONTROL_WORD, outputs=True) and _has(slave, _STATUS_WORD, outputs=False):
        return "drive"
    if not writes and not reads:
        return "coupler" if _COUPLER.match(slave.name) else "other"
    if {*writes, *reads} == {"Boolean"}:
        if writes and reads:
            return "digital inputs and outputs"
        return "digital outputs" if writes else "digital inputs"
    if writes and reads:
        return "other"
    return "analog outputs" if writes else "analog inputs"


def _has(slave: Slave, address: tuple[int, int], *, outputs: bool) -> bool:
    return any(
        (entry.index, entry.subindex) == address for _, entry, _ in slave.entries(outputs=outputs)
    )


def symbol(kind: SlaveKind, corner: Point) -> tuple[Code, ...]:
    """Returns the Modelica graphics of the symbol for a kind of slave.

    Args:
        kind: Kind of the slave.
        corner: Lower left corner of the symbol in the icon.
    """
    pen = _Pen(corner)
    if kind == "drive":
        return tuple(_drive(pen))
    if kind == "coupler":
        return tuple(_coupler(pen))
    if kind == "CAN terminal":
        return tuple(_can(pen))
    if kind == "other":
        return tuple(_chip(pen))
    return tuple(_waveform(pen, kind))


class _Pen:
    """Writes graphical primitives in coordinates relative to the corner of the symbol."""

    def __init__(self, corner: Point) -> None:
        self._corner = corner

    def _points(self, *points: tuple[int, int]) -> Code:
        x, y = self._corner.x, self._corner.y
        return Code("{%s}") % Code(", ").join(Point(x + dx, y + dy) for dx, dy in points)

    def line(self, *points: tuple[int, int], smooth: bool = False) -> Code:
        more = Code(", smooth = Smooth.Bezier" if smooth else "")
        return Code("Line(points = %s, color = %s%s)") % (self._points(*points), _DARK, more)

    def polygon(self, *points: tuple[int, int]) -> Code:
        return Code("Polygon(points = %s, %s)") % (self._points(*points), self._filled())

    def rectangle(self, a: tuple[int, int], b: tuple[int, int]) -> Code:
        return Code("Rectangle(extent = %s, %s)") % (self._points(a, b), self._filled())

    @staticmethod
    def _filled() -> Code:
        form = Code("lineColor = %s, fillColor = %s, fillPattern = FillPattern.Solid")
        return form % (_DARK, _FILL)


def _drive(pen: _Pen) -> Iterator[Code]:
    """Draws a motor, seen from the side."""
    yield pen.rectangle((2, 8), (22, 26))
    for y in (12, 17, 22):
        yield pen.line((5, y), (19, y))
    yield pen.rectangle((22, 14), (32, 20))
    yield pen.polygon((4, 4), (20, 4), (18, 8), (6, 8))


def _coupler(pen: _Pen) -> Iterator[Code]:
    """Draws a bus that continues on both sides."""
    yield pen.line((0, 8), (32, 8))
    for x in (2, 12, 22):
        yield pen.line((x + 4, 8), (x + 4, 16))
        yield pen.rectangle((x, 16), (x + 8, 26))


def _chip(pen: _Pen) -> Iterator[Code]:
    """Draws an electronic device."""
    for y in (10, 16, 22):
        yield pen.line((2, y), (30, y))
    yield pen.rectangle((7, 5), (25, 27))


def _can(pen: _Pen) -> Iterator[Code]:
    """Draws a node on two wires, which are terminated at both ends."""
    yield pen.line((2, 26), (30, 26))
    yield pen.line((2, 20), (30, 20))
    for x in (1, 27):
        yield pen.rectangle((x, 18), (x + 4, 28))
    yield pen.line((13, 26), (13, 14))
    yield pen.line((19, 20), (19, 14))
    yield pen.rectangle((9, 4), (23, 14))


def _waveform(pen: _Pen, kind: SlaveKind) -> Iterator[Code]:
    """Draws a waveform with an arrow: on the left for outputs, on the right for inputs."""
    if kind.startswith("digital"):
        points = ((7, 6), (11, 6), (11, 26), (18, 26), (18, 6), (25, 6), (25, 26))
        yield pen.line(*points)
    else:
        yield pen.line((8, 16), (11, 34), (15, 20), (19, 6), (22, 2), (24, 24), smooth=True)
    if "outputs" in kind:
        yield pen.polygon((0, 12), (0, 20), (6, 16))
    if "inputs" in kind:
        yield pen.polygon((26, 12), (26, 20), (32, 16))

"""Turns a graphical primitive of an annotation into outlines and labels.

The sizes of pens and arrows are in millimetres. One unit of a diagram is a millimetre.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from ecatgen import font

from .geometry import (
    Box,
    Outline,
    Point,
    Transform,
    arc,
    bezier,
    box_of,
    corners,
    moved,
    polyline,
    rounded,
)
from .instances import Instance
from .syntax import Call

Color = tuple[int, int, int]
BLACK: Color = (0, 0, 0)


@dataclass(frozen=True, slots=True)
class Fill:
    """The filling of an area.

    Attributes:
        pattern: Name of the fill pattern in Modelica.
        color: Colour of the filling.
        line: Colour of the lines in the filling, and of the dark sides of gradients.
        corners: Corners of the transformed box of the shape, which give the direction of gradients.
    """

    pattern: str
    color: Color
    line: Color
    corners: tuple[Point, ...]


@dataclass(frozen=True, slots=True)
class Shape:
    """An outline with a pen and a filling.

    Attributes:
        outline: The curve.
        color: Colour of the pen; None if the outline is not drawn.
        thickness: Thickness of the pen.
        dash: Name of the line pattern in Modelica.
        fill: Filling, or None.
    """

    outline: Outline
    color: Color | None
    thickness: float = 0.25
    dash: str = "Solid"
    fill: Fill | None = None


@dataclass(frozen=True, slots=True)
class Label:
    """A text.

    Attributes:
        text: The text, with its line breaks.
        at: Position of the text: its left edge, centre or right edge, at middle height.
        align: `Left`, `Center` or `Right`.
        angle: Direction in degrees.
        size: Size of the font.
        wanted: Size of the font that the height of the extent allows. `size` is smaller if the text
            would be too wide.
        color: Its colour.
        style: Names of text styles.
    """

    text: str
    at: Point
    align: str
    angle: float
    size: float
    wanted: float
    color: Color
    style: tuple[str, ...] = ()

    @property
    def bold(self) -> bool:
        """Whether it is bold."""
        return "Bold" in self.style

    @property
    def width(self) -> float:
        """Width of the widest line."""
        return self.size * max(font.width(line, bold=self.bold) for line in self.lines)

    @property
    def lines(self) -> list[str]:
        """Its lines."""
        return self.text.split("\n")

    @property
    def box(self) -> Box:
        """The box around it."""
        left = {"Left": 0.0, "Center": -0.5, "Right": -1.0}[self.align] * self.width
        half = self.size * font.LINE * len(self.lines) / 2
        local = Box(left, -half, left + self.width, half)
        return moved(self.at, self.angle).box(local)


Item = Shape | Label


def draw(primitive: Call, instance: Instance, to: Transform) -> Iterator[Item]:
    """Yields the outlines and labels of a primitive.

    Args:
        primitive: `Line(...)`, `Polygon(...)`, `Rectangle(...)`, `Ellipse(...)` or `Text(...)`;
            `Bitmap` draws nothing.
        instance: The instance whose parameters the primitive may show.
        to: Transformation of the coordinate system.
    """
    style = Style(primitive, instance)
    if style.value("visible", True) is False:
        return
    to = to.after(moved(style.point("origin"), style.number("rotation", 0)))
    match primitive.name:
        case "Line":
            yield from line(style, to)
        case "Polygon":
            points = style.points("points")
            smooth = style.word("smooth", "None") == "Bezier"
            outline = (bezier if smooth else polyline)(points, closed=True)
            yield _filled(style, outline, box_of(points), to)
        case "Rectangle":
            box = style.box("extent")
            yield _filled(style, rounded(box, style.number("radius", 0)), box, to)
        case "Ellipse":
            yield _ellipse(style, to)
        case "Text":
            yield from _text(style, to)


class Style:
    """The arguments of a primitive, with their values."""

    def __init__(self, primitive: Call, instance: Instance) -> None:
        self._arguments = primitive.named
        self.instance = instance

    def value(self, name: str, default: Any = None) -> Any:
        """Returns the value of an argument, or the default if it is missing or unknown."""
        given = self._arguments.get(name)
        value = None if given is None else self.instance.value(given.binding)
        return default if value is None else value

    def number(self, name: str, default: float) -> float:
        """Returns a number."""
        return float(self.value(name, default))

    def word(self, name: str, default: str) -> str:
        """Returns the name of a literal of an enumeration."""
        return str(self.value(name, default))

    def point(self, name: str) -> Point:
        """Returns a point, by default the origin."""
        return Point(*self.value(name, (0.0, 0.0)))

    def points(self, name: str) -> list[Point]:
        """Returns a list of points, by default none."""
        return [Point(*p) for p in self.value(name, [])]

    def box(self, name: str) -> Box:
        """Returns the box around a list of points."""
        return box_of(self.points(name))

    def color(self, name: str, default: Color = BLACK) -> Color:
        """Returns a colour."""
        r, g, b = (round(c) for c in self.value(name, default))
        return r, g, b


def line(style: Style, to: Transform) -> Iterator[Shape]:
    """Yields a line and its arrows."""
    points = style.points("points")
    if len(points) < 2 or style.word("pattern", "Solid") == "None":
        return
    color, thickness = style.color("color"), style.number("thickness", 0.25)
    smooth = style.word("smooth", "None") == "Bezier"
    outline = (bezier if smooth else polyline)(points).transformed(to)
    yield Shape(outline, color, thickness, style.word("pattern", "Solid"))
    arrows = style.value("arrow", ["None", "None"])
    size = style.number("arrowSize", 3)
    ends = [(to(points[0]), to(points[1])), (to(points[-1]), to(points[-2]))]
    for kind, (tip, other) in zip(arrows, ends, strict=True):
        if kind != "None" and tip != other:
            yield _arrow(kind, tip, other, size, color, thickness)


def _arrow(
    kind: str, tip: Point, other: Point, size: float, color: Color, thickness: float
) -> Shape:
    angle = math.degrees(math.atan2(other.y - tip.y, other.x - tip.x))
    to = moved(tip, angle)
    a, b = to(Point(size, size / 3)), to(Point(size, -size / 3))
    if kind == "Filled":
        outline = polyline((a, tip, b), closed=True)
        return Shape(outline, color, thickness, fill=Fill("Solid", color, color, ()))
    return Shape(polyline((a, tip) if kind == "Half" else (a, tip, b)), color, thickness)


def _filled(style: Style, outline: Outline, box: Box, to: Transform) -> Shape:
    pen, pattern = style.color("lineColor"), style.word("pattern", "Solid")
    fill = style.word("fillPattern", "None")
    return Shape(
        outline.transformed(to),
        None if pattern == "None" else pen,
        style.number("lineThickness", 0.25),
        pattern,
        None
        if fill == "None"
        else Fill(fill, style.color("fillColor"), pen, tuple(to(p) for p in corners(box))),
    )


def _ellipse(style: Style, to: Transform) -> Shape:
    box = style.box("extent")
    start, end = style.number("startAngle", 0), style.number("endAngle", 360)
    whole = abs(end - start) >= 360
    closure = "Chord" if whole else style.word("closure", "Chord")
    outline = arc(box, start, end)
    if closure == "Radial":
        outline = Outline(box.centre, ((outline.start,), *outline.segments), closed=True)
    elif closure == "Chord":
        outline = Outline(outline.start, outline.segments, closed=True)
    return _filled(style, outline, box, to)


_MACRO = re.compile(r"%(?:(%)|\{([\w.]+)\}|([A-Za-z_]\w*))")


def _text(style: Style, to: Transform) -> Iterator[Label]:
    text = _expanded(style.value("textString", style.value("string", "")), style.instance)
    if not text.strip():
        return
    box, (sx, sy) = style.box("extent"), to.scale
    styles = tuple(map(str, style.value("textStyle", ())))
    bold = "Bold" in styles
    wanted = font.fitted(text, 0, box.height * sy, bold=bold)
    size = font.fitted(text, box.width * sx, box.height * sy, bold=bold)
    if style.number("fontSize", 0) > 0:
        size = wanted = style.number("fontSize", 0) * _POINT * sx * 10
    align = style.word("horizontalAlignment", "Center")
    if to.a < -1e-9 and align != "Center":  # mirrors the place, but not the text
        align = "Left" if align == "Right" else "Right"
    x = {"Left": box.x1, "Center": box.centre.x, "Right": box.x2}[
        style.word("horizontalAlignment", "Center")
    ]
    color = style.color("textColor", style.color("lineColor"))
    at = to(Point(x, box.centre.y))
    yield Label(text, at, align, to.angle, size, wanted, color, styles)


_POINT = 0.3528  # millimetres


def _expanded(text: str, instance: Instance) -> str:
    def macro(match: re.Match[str]) -> str:
        percent, braced, plain = match.groups()
        if percent:
            return "%"
        name = braced or plain
        if name == "name":
            return instance.name
        if name == "class":
            return instance.found.path.rpartition(".")[2]
        return instance.text(name)

    return _MACRO.sub(macro, text)

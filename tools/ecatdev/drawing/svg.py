"""Writes scenes as SVG; the same scene always gives the same bytes."""

from __future__ import annotations

import math
from collections.abc import Iterable
from html import escape

from ecatgen import font

from .geometry import Box, Outline, Point
from .scene import Part, Scene
from .shapes import Color, Fill, Item, Label, Shape

_DASHES = {"Dash": (4, 2), "Dot": (1, 2), "DashDot": (4, 2, 1, 2), "DashDotDot": (4, 2, 1, 2, 1, 2)}
_CYLINDERS = {"HorizontalCylinder": (0, 3), "VerticalCylinder": (0, 1)}  # corners along a gradient
_HATCHES = {
    "Horizontal": ("h",),
    "Vertical": ("v",),
    "Cross": ("h", "v"),
    "Forward": ("f",),
    "Backward": ("b",),
    "CrossDiag": ("f", "b"),
}
_HATCH_LINES = {"h": "M0 1H2", "v": "M1 0V2", "f": "M0 0L2 2", "b": "M0 2L2 0"}
PIXELS = 4
"""Pixels per unit of a diagram."""


class Svg:
    """Collects the elements of a picture.

    Args:
        box: The visible area.
        title: Title of the picture, for readers who cannot see it.
    """

    def __init__(self, box: Box, title: str) -> None:
        self._box, self._title = box, title
        self._lines: list[str] = []
        self._definitions: dict[str, str] = {}

    def scene(self, scene: Scene) -> None:
        """Draws a scene: connections above the components, as editors do."""
        self.items(scene.items)
        for part in scene.parts.values():
            self.part(part)
        for line in scene.lines:
            self.items(line.items)

    def part(self, part: Part) -> None:
        """Draws a component."""
        self._lines.append(f"<g><title>{_text(part.name)}: {_text(part.path)}</title>")
        self.items(part.items)
        for inner in part.parts.values():
            self.items(inner.items)
        self._lines.append("</g>")

    def items(self, items: Iterable[Item]) -> None:
        """Draws outlines and labels."""
        for item in items:
            self._lines.append(self._label(item) if isinstance(item, Label) else self._shape(item))

    def write(self) -> str:
        """Returns the text of the SVG file."""
        box = self._box
        width, height = box.width * PIXELS, box.height * PIXELS
        view = f"{_number(box.x1)} {_number(-box.y2)} {_number(box.width)} {_number(box.height)}"
        definitions = "".join(f"{text}\n" for text in self._definitions.values())
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
            f'viewBox="{view}" font-family="{font.FAMILY}" stroke-linejoin="round">\n'
            f"<title>{_text(self._title)}</title>\n"
            f"<defs>\n{definitions}</defs>\n"
            f'<rect x="{_number(box.x1)}" y="{_number(-box.y2)}" width="{_number(box.width)}" '
            f'height="{_number(box.height)}" fill="#ffffff"/>\n' + "\n".join(self._lines)
        ) + "\n</svg>\n"

    def _shape(self, shape: Shape) -> str:
        attributes = [f'd="{_path(shape.outline)}"']
        attributes.append(f'fill="{"none" if shape.fill is None else self._fill(shape.fill)}"')
        if shape.color is not None:
            attributes.append(f'stroke="{_color(shape.color)}"')
            attributes.append(f'stroke-width="{_number(shape.thickness)}"')
            if shape.dash in _DASHES:
                dashes = " ".join(
                    _number(max(shape.thickness, 0.25) * n) for n in _DASHES[shape.dash]
                )
                attributes.append(f'stroke-dasharray="{dashes}"')
        return f"<path {' '.join(attributes)}/>"

    def _fill(self, fill: Fill) -> str:
        if fill.pattern in _CYLINDERS or fill.pattern == "Sphere":
            return self._define(_gradient(fill))
        if fill.pattern in _HATCHES:
            paths = "".join(_HATCH_LINES[name] for name in _HATCHES[fill.pattern])
            return self._define(
                '<pattern id="{}" width="2" height="2" patternUnits="userSpaceOnUse">'
                f'<rect width="2" height="2" fill="{_color(fill.color)}"/>'
                f'<path d="{paths}" stroke="{_color(fill.line)}" stroke-width="0.25"/></pattern>'
            )
        return _color(fill.color)

    def _define(self, template: str) -> str:
        if template not in self._definitions:
            name = f"d{len(self._definitions) + 1}"
            self._definitions[template] = template.replace("{}", name, 1)
        name = self._definitions[template].split('id="', 1)[1].split('"', 1)[0]
        return f"url(#{name})"

    def _label(self, label: Label) -> str:
        anchor = {"Left": "start", "Center": "middle", "Right": "end"}[label.align]
        style = "".join(
            f' {attribute}="{value}"'
            for name, attribute, value in (
                ("Bold", "font-weight", "bold"),
                ("Italic", "font-style", "italic"),
                ("UnderLine", "text-decoration", "underline"),
            )
            if name in label.style
        )
        x, y = label.at.x, -label.at.y
        turn = f' transform="rotate({_number(-label.angle)} {_number(x)} {_number(y)})"'
        first = y + font.MIDDLE * label.size - (len(label.lines) - 1) / 2 * font.LINE * label.size
        return "\n".join(
            f'<text x="{_number(x)}" y="{_number(first + n * font.LINE * label.size)}"'
            f' font-size="{_number(label.size)}" text-anchor="{anchor}"'
            f' fill="{_color(label.color)}"{style}{turn if label.angle else ""}'
            f' textLength="{_number(font.width(line, bold=label.bold) * label.size)}"'
            f' lengthAdjust="spacingAndGlyphs">{_text(line)}</text>'
            for n, line in enumerate(label.lines)
            if line.strip()
        )


def _gradient(fill: Fill) -> str:
    stops = (
        f'<stop offset="0" stop-color="{_color(fill.line)}"/>'
        f'<stop offset="0.5" stop-color="{_color(fill.color)}"/>'
        f'<stop offset="1" stop-color="{_color(fill.line)}"/>'
    )
    if fill.pattern == "Sphere":
        a, b = fill.corners[0], fill.corners[2]
        radius = max(abs(a.x - b.x), abs(a.y - b.y)) / 2
        return (
            f'<radialGradient id="{{}}" gradientUnits="userSpaceOnUse" '
            f'cx="{_number((a.x + b.x) / 2)}" cy="{_number(-(a.y + b.y) / 2)}" '
            f'r="{_number(radius)}"><stop offset="0" stop-color="{_color(fill.color)}"/>'
            f'<stop offset="1" stop-color="{_color(fill.line)}"/></radialGradient>'
        )
    a, b = (fill.corners[n] for n in _CYLINDERS[fill.pattern])
    return (
        f'<linearGradient id="{{}}" gradientUnits="userSpaceOnUse" x1="{_number(a.x)}" '
        f'y1="{_number(-a.y)}" x2="{_number(b.x)}" y2="{_number(-b.y)}">{stops}</linearGradient>'
    )


def _path(outline: Outline) -> str:
    parts = [f"M{_pair(outline.start)}"]
    for segment in outline.segments:
        parts.append(("L" if len(segment) == 1 else "C") + " ".join(_pair(p) for p in segment))
    return "".join(parts) + ("Z" if outline.closed else "")


def _pair(p: Point) -> str:
    return f"{_number(p.x)} {_number(-p.y)}"


def _number(value: float) -> str:
    text = f"{math.floor(value * 100 + 0.5) / 100:.2f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _color(color: Color) -> str:
    return "#{:02x}{:02x}{:02x}".format(*color)


def _text(text: str) -> str:
    return escape(text, quote=False)

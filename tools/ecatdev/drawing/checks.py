"""Finds errors in a picture, with one sentence for each finding."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import combinations, pairwise

from .geometry import Box, Point, around, box_of
from .scene import ConnectLine, Part, Scene
from .shapes import Label, Shape

_NEAR = 0.05  # largest distance of the end of a line from its connector, in units of a diagram
_SMALLEST = 0.6  # smallest size of a text, as a share of the size that its height allows
_EDGE = 1e-6


def check_diagram(scene: Scene) -> Iterator[str]:
    """Yields findings about the diagram of a class.

    Every line must begin and end in the middle of its connectors, as in an editor. Components must
    not overlap each other. Lines must not cross components or lie upon each other.
    """
    yield from _lines_meet(scene)
    yield from _overlaps(scene)
    yield from _lines_cross(scene)
    yield from _lines_coincide(scene)
    for part in scene.parts.values():
        yield from _labels(part.name, part)


def check_icon(scene: Scene) -> Iterator[str]:
    """Yields findings about the icon of a class.

    The icon must show something. Connectors must not overlap each other, nor must texts. Texts must
    not be squeezed.
    """
    name = scene.path.rpartition(".")[2]
    part = Part(name, scene.path, False, scene.box, scene.items, scene.parts)
    if not any(isinstance(item, Shape) for item in scene.items):
        yield f"{name} draws nothing"
    for a, b in combinations(scene.parts.values(), 2):
        if _overlapping(a.box, b.box):
            yield f"{name}: connectors {a.name} and {b.name} overlap"
    yield from _labels(name, part)


def _lines_meet(scene: Scene) -> Iterator[str]:
    for line in scene.lines:
        places = [_place(scene, connector) for connector in (line.a, line.b)]
        if len(line.points) < 2:
            if None not in places:  # a hidden connector has no place and needs no line
                yield f"{_name(line)} has no line"
            continue
        ends = (line.points[0], line.points[-1])
        for connector, place, end in zip((line.a, line.b), places, ends, strict=True):
            if place is None:
                yield f"{_name(line)}: {connector} has no place"
                continue
            middle = place.box.centre
            if max(abs(middle.x - end.x), abs(middle.y - end.y)) > _NEAR:
                yield (f"{_name(line)} ends at {_pair(end)}, but {connector} is at {_pair(middle)}")


def _place(scene: Scene, connector: str) -> Part | None:
    component, _, inner = _whole_array(connector).partition(".")
    part = scene.parts.get(component)
    return part.parts.get(inner) if part is not None and inner else part


def _whole_array(connector: str) -> str:
    """Removes subscripts, because all elements of an array are drawn at one place."""
    return re.sub(r"\[.*?\]", "", connector)


def _overlaps(scene: Scene) -> Iterator[str]:
    for a, b in combinations(scene.parts.values(), 2):
        if _overlapping(_whole(a), _whole(b)):
            yield f"{a.name} and {b.name} overlap"


def _whole(part: Part) -> Box:
    """Returns the box around a component with its connectors and texts."""
    boxes = [part.box, *(inner.box for inner in part.parts.values())]
    boxes += [item.box for item in part.items if isinstance(item, Label)]
    return around(boxes)


def _lines_cross(scene: Scene) -> Iterator[str]:
    blocks = [
        (part.name, part.box.grown(-_EDGE)) for part in scene.parts.values() if not part.connector
    ]
    texts = [
        (part.name, item.text, _ink(item))
        for part in scene.parts.values()
        for item in part.items
        if isinstance(item, Label)
    ]
    for line in scene.lines:
        for a, b in pairwise(line.points):
            segment = box_of((a, b))
            for name, box in blocks:
                if min(segment.overlap(box)) >= 0:
                    yield f"{_name(line)} crosses {name}"
            for name, text, box in texts:
                if min(segment.overlap(box)) >= 0:
                    yield f"{_name(line)} crosses the text {text!r} of {name}"


def _lines_coincide(scene: Scene) -> Iterator[str]:
    for one, other in combinations(scene.lines, 2):
        if set(map(_whole_array, (one.a, one.b))) & set(map(_whole_array, (other.a, other.b))):
            continue  # the same signal, or the same array
        for a, b in pairwise(one.points):
            for c, d in pairwise(other.points):
                width, height = box_of((a, b)).overlap(box_of((c, d)))
                flat = a.y == b.y and c.y == d.y and height == 0 and width > _EDGE
                upright = a.x == b.x and c.x == d.x and width == 0 and height > _EDGE
                if flat or upright:
                    yield f"{_name(one)} lies upon {_name(other)}"


def _labels(name: str, part: Part) -> Iterator[str]:
    labels = [item for item in part.items if isinstance(item, Label)]
    for label in labels:
        if label.size < _SMALLEST * label.wanted:
            yield f"{name}: {label.text!r} is squeezed to {label.size / label.wanted:.0%}"
    for one, other in combinations(labels, 2):
        if _overlapping(_ink(one), _ink(other)):
            yield f"{name}: {one.text!r} and {other.text!r} overlap"
    for label in labels:
        for inner in part.parts.values():
            if _overlapping(_ink(label), inner.box):
                yield f"{name}: {label.text!r} lies on the connector {inner.name}"


def _ink(label: Label) -> Box:
    """Returns the visible box of a text, without the space above and below its letters."""
    box = label.box
    if abs(label.angle) > _EDGE:
        return box
    rest = label.size * 0.2
    return Box(box.x1, box.y1 + rest, box.x2, box.y2 - rest)


def _overlapping(a: Box, b: Box) -> bool:
    return min(a.overlap(b)) > _EDGE


def _name(line: ConnectLine) -> str:
    return f"connect({line.a}, {line.b})"


def _pair(p: Point) -> str:
    return f"{{{p.x:g}, {p.y:g}}}"

"""Puts the icons of a library on one sheet, package by package."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from .geometry import Box, Point, Transform, box_of
from .library import Libraries
from .scene import Scene, icon
from .shapes import Color, Item, Label
from .svg import Svg

_SCALE = 0.15  # units of the sheet in a unit of an icon
_WIDTH = 250.0
_GAP = 8.0
_MARGIN = 6.0
_HEADING, _CAPTION = 5.0, 3.2  # sizes of the font
_DARK: Color = (40, 40, 40)
_GREY: Color = (90, 90, 90)


@dataclass(slots=True)
class _Tile:
    scene: Scene
    box: Box


def blocks(libraries: Libraries, package: str) -> Iterator[tuple[str, list[str]]]:
    """Blocks and models that users take, by package; examples are left out."""
    members = [f"{package}.{name}" for name in libraries.members(package)]
    definitions = [(path, libraries.get(path).definition) for path in members]
    yield (
        package,
        [
            path
            for path, definition in definitions
            if definition.kind in ("block", "model") and "partial" not in definition.prefixes
        ],
    )
    for path, definition in definitions:
        if definition.kind == "package" and definition.name != "Examples":
            yield from blocks(libraries, path)


def sheet(libraries: Libraries, library: str) -> str:
    """The sheet of a library, as SVG."""
    scenes: list[Scene] = []
    texts: list[Item] = []
    y = 0.0
    for package, paths in blocks(libraries, library):
        if not paths:
            continue
        y -= _HEADING
        texts.append(_text(package, Point(0, y), "Left", _HEADING, _DARK, bold=True))
        y -= _HEADING
        for row in _rows([_tile(libraries, path) for path in paths]):
            y = _place(libraries, row, y, scenes, texts) - _GAP
    svg = Svg(
        Box(-_MARGIN, y + _GAP - _MARGIN, _WIDTH + _MARGIN, _MARGIN / 2), f"Icons of {library}"
    )
    for scene in scenes:
        svg.scene(scene)
    svg.items(texts)
    return svg.write()


def _tile(libraries: Libraries, path: str) -> _Tile:
    scene = icon(libraries, path, to=Transform(_SCALE, 0, 0, _SCALE))
    boxes = [part.box for part in scene.parts.values()]
    boxes += [item.box for item in scene.items if isinstance(item, Label)]
    boxes.append(scene.box)
    caption = _text(path.rpartition(".")[2], Point(0, 0), "Center", _CAPTION, _GREY)
    middle = scene.box.centre.x
    half = caption.width / 2
    box = box_of(
        [
            *(Point(x, y) for b in boxes for x, y in ((b.x1, b.y1), (b.x2, b.y2))),
            Point(middle - half, 0),
            Point(middle + half, 0),
        ]
    )
    return _Tile(scene, box)


def _rows(tiles: list[_Tile]) -> Iterator[list[_Tile]]:
    row: list[_Tile] = []
    used = 0.0
    for tile in tiles:
        if row and used + tile.box.width > _WIDTH:
            yield row
            row, used = [], 0.0
        row.append(tile)
        used += tile.box.width + _GAP
    yield row


def _place(
    libraries: Libraries, row: list[_Tile], top: float, scenes: list[Scene], texts: list[Item]
) -> float:
    """Draws a row below `top`, and returns where it ends."""
    height = max(tile.box.height for tile in row)
    x, base = 0.0, top - height - _CAPTION * 1.6
    for tile in row:
        to = Transform(_SCALE, 0, 0, _SCALE, x - tile.box.x1, top - tile.box.y2)
        scene = icon(libraries, tile.scene.path, to=to)
        scenes.append(scene)
        at = Point(scene.box.centre.x, top - tile.box.height - _CAPTION * 0.8)
        name = tile.scene.path.rpartition(".")[2]
        texts.append(_text(name, at, "Center", _CAPTION, _GREY))
        x += tile.box.width + _GAP
    return base


def _text(
    text: str, at: Point, align: str, size: float, color: Color, *, bold: bool = False
) -> Label:
    return Label(text, at, align, 0, size, size, color, ("Bold",) if bold else ())

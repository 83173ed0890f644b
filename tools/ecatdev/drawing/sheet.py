"""Puts the icons of a library on one sheet, package by package."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from .geometry import Box, Point, Transform, around
from .library import Libraries
from .scene import Scene, drag_scale, icon
from .shapes import Color, Item, Label
from .svg import Svg

_SCALE = 1.2  # size of an icon on the sheet, relative to its size in a diagram (`drag_scale`)
_WIDTH = 250.0
_GAP = 6.0
_MARGIN = 6.0
_HEADING, _CAPTION = 4.5, 2.6  # sizes of the font
_DARK: Color = (40, 40, 40)
_GREY: Color = (90, 90, 90)


@dataclass(frozen=True, slots=True)
class _Tile:
    """An icon with its scale, the box around the icon and its texts, and its heading or ""."""

    path: str
    scale: float
    box: Box
    heading: str


def blocks(libraries: Libraries, package: str) -> Iterator[tuple[str, list[str]]]:
    """Yields each package with its blocks and models for users; leaves examples out."""
    members = [f"{package}.{name}" for name in libraries.members(package)]
    definitions = [(path, libraries.get(path).definition) for path in members]
    yield (
        package,
        [
            path
            for path, definition in definitions
            if definition.kind in ("block", "model") and not definition.partial
        ],
    )
    for path, definition in definitions:
        if definition.kind == "package" and definition.name != "Examples":
            yield from blocks(libraries, path)


def sheet(libraries: Libraries, library: str) -> str:
    """Returns the sheet of a library as SVG."""
    scenes: list[Scene] = []
    texts: list[Item] = []
    y = 0.0
    for row in _rows(_tiles(libraries, library)):
        y = _place(libraries, row, y, scenes, texts) - _GAP
    box = Box(-_MARGIN, y + _GAP - _MARGIN, _WIDTH + _MARGIN, _MARGIN)
    svg = Svg(box, f"Icons of {library}")
    for scene in scenes:
        svg.scene(scene)
    svg.items(texts)
    return svg.write()


def _tiles(libraries: Libraries, library: str) -> Iterator[_Tile]:
    for package, paths in blocks(libraries, library):
        for path in paths:
            scale = _SCALE * drag_scale(libraries, path)
            scene = icon(libraries, path, to=Transform(scale, 0, 0, scale))
            boxes = [scene.box, *(part.box for part in scene.parts.values())]
            boxes += [item.box for item in scene.items if isinstance(item, Label)]
            caption = _caption(path, scene.box.centre)
            boxes.append(Box(caption.box.x1, 0, caption.box.x2, 0))
            yield _Tile(path, scale, around(boxes), package if path == paths[0] else "")


def _rows(tiles: Iterable[_Tile]) -> Iterator[list[tuple[float, _Tile]]]:
    """Yields rows of tiles, each tile with its distance from the left."""
    row: list[tuple[float, _Tile]] = []
    x = free = 0.0  # place of the next tile, and end of the last heading
    for tile in tiles:
        if tile.heading:
            x = max(x + _GAP if row else 0, free)
        if row and max(x + tile.box.width, x + _heading(tile, 0, 0).box.width) > _WIDTH:
            yield row
            row, x = [], 0.0
        row.append((x, tile))
        if tile.heading:
            free = x + _heading(tile, 0, 0).width + _GAP
        x += tile.box.width + _GAP
    yield row


def _place(
    libraries: Libraries,
    row: list[tuple[float, _Tile]],
    top: float,
    scenes: list[Scene],
    texts: list[Item],
) -> float:
    """Draws a row below `top`, and returns the y coordinate of its lower end."""
    if any(tile.heading for _, tile in row):
        texts.extend(_heading(tile, x, top - _HEADING / 2) for x, tile in row if tile.heading)
        top -= 2 * _HEADING
    for x, tile in row:
        to = Transform(tile.scale, 0, 0, tile.scale, x - tile.box.x1, top - tile.box.y2)
        scene = icon(libraries, tile.path, to=to)
        scenes.append(scene)
        foot = Point(scene.box.centre.x, top - tile.box.height - _CAPTION * 0.8)
        texts.append(_caption(tile.path, foot))
    return top - max(tile.box.height for _, tile in row) - _CAPTION * 1.6


def _heading(tile: _Tile, x: float, y: float) -> Label:
    return _text(tile.heading or " ", Point(x, y), "Left", _HEADING, _DARK, bold=True)


def _caption(path: str, at: Point) -> Label:
    return _text(path.rpartition(".")[2], at, "Center", _CAPTION, _GREY)


def _text(
    text: str, at: Point, align: str, size: float, color: Color, *, bold: bool = False
) -> Label:
    return Label(text, at, align, 0, size, size, color, ("Bold",) if bold else ())

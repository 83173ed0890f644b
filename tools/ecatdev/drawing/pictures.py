"""Draws the pictures of the documentation: icons and diagrams of the libraries."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import ecatgen
from ecatgen.build import build_library
from ecatgen.render import render

from .. import checks, sample_buses
from ..files import write_files
from .geometry import around, box_of
from .library import Libraries
from .scene import Scene, diagram
from .shapes import Label
from .sheet import sheet
from .svg import Svg

STATIC, GENERATED = "EtherCAT", "TrollPlant"
SCREEN = "screen-"
"""How names of pictures begin that `make screens` draws: of commands, not of libraries."""
_MODELICA = Path(ecatgen.__file__).parent / "modelica"
_STAND_IN = Path(checks.__file__).parent
_MARGIN = 6


def libraries(folder: Path, standard_library: Path | None = None) -> Libraries:
    """Generates the library of the bus `troll`, and returns it with the library EtherCAT.

    Args:
        folder: Folder for the generated library.
        standard_library: Folder that has the Modelica Standard Library as `Modelica`. By default,
            the stand-in of the checks is used, so that the pictures are the same everywhere.
    """
    library = build_library(sample_buses.troll(), GENERATED)
    write_files(folder / GENERATED, render(library))
    return found_with(folder, standard_library)


def found_with(folder: Path, standard_library: Path | None = None) -> Libraries:
    """Returns the libraries in a folder, the library EtherCAT, and the Modelica Standard Library.

    Args:
        folder: The folder.
        standard_library: See `libraries`.
    """
    return Libraries([folder, _MODELICA, standard_library or _STAND_IN])


def models(found: Libraries, package: str) -> Iterator[str]:
    """Yields the full names of all models and blocks in a package and in the packages inside it."""
    for name in found.members(package):
        path = f"{package}.{name}"
        kind = found.get(path).definition.kind
        if kind == "package":
            yield from models(found, path)
        elif kind in ("block", "model"):
            yield path


def pictures(standard_library: Path | None = None) -> dict[str, str]:
    """Returns every picture as SVG, by its file name.

    Args:
        standard_library: See `libraries`.
    """
    with tempfile.TemporaryDirectory() as folder:
        found = libraries(Path(folder), standard_library)
        result = {f"{name}.svg": sheet(found, name) for name in (STATIC, GENERATED)}
        for name in (STATIC, GENERATED):
            for path in models(found, name):
                scene = diagram(found, path)
                partial = found.get(path).definition.partial
                if not partial and any(line.points for line in scene.lines):
                    result[f"{path}.svg"] = draw_diagram(scene)
        return result


def draw_diagram(scene: Scene) -> str:
    """Returns a diagram as SVG, cropped to its content."""
    boxes = [part.box for part in scene.parts.values()]
    items = [item for part in scene.parts.values() for item in part.items]
    boxes += [item.box for item in [*scene.items, *items] if isinstance(item, Label)]
    boxes += [box_of(line.points) for line in scene.lines if line.points]
    svg = Svg(around(boxes).grown(_MARGIN), f"{scene.path}: {scene.description}")
    svg.scene(scene)
    return svg.write()

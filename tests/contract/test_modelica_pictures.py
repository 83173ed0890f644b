"""How the libraries look in an editor: nothing overlaps, and lines end where they should."""

import os
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from ecatdev import checks, sample_buses
from ecatdev.drawing.checks import check_diagram, check_icon
from ecatdev.drawing.library import Libraries
from ecatdev.drawing.pictures import (
    GENERATED,
    SCREEN,
    STATIC,
    found_with,
    libraries,
    models,
    pictures,
)
from ecatdev.drawing.scene import diagram, icon
from ecatdev.files import write_files
from ecatgen import generate
from ecatgen.build import build_library
from ecatgen.render import render
from openmodelica import OpenModelica, needs_omc

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Libraries:
    return libraries(tmp_path_factory.mktemp("libraries"))


def partial(found: Libraries, path: str) -> bool:
    return found.get(path).definition.partial


def findings(found: Libraries, library: str) -> Iterator[str]:
    for path in models(found, library):
        yield from (f"{path}: {problem}" for problem in check_diagram(diagram(found, path)))
        if not partial(found, path):
            yield from (f"{path}: {problem}" for problem in check_icon(icon(found, path)))


@pytest.mark.parametrize("library", [STATIC, GENERATED])
def test_nothing_overlaps_and_every_line_meets_its_connectors(
    found: Libraries, library: str
) -> None:
    assert f"{STATIC}.EtherCATMaster" in models(found, STATIC)
    assert list(findings(found, library)) == []


@pytest.mark.long
def test_the_same_for_awkward_slaves(tmp_path: Path) -> None:
    library = build_library(sample_buses.awkward(), "Awkward")
    write_files(tmp_path / "Awkward", render(library))
    found = found_with(tmp_path)
    assert list(findings(found, "Awkward")) == []


def standard_libraries() -> list[Path]:
    folders = [Path(p) for p in os.environ.get("MODELICAPATH", "").split(":") if p]
    folders.append(Path.home() / ".openmodelica" / "libraries")
    return [path for folder in folders for path in sorted(folder.glob("Modelica 4.0.0*"))]


@pytest.mark.skipif(not standard_libraries(), reason="no Modelica Standard Library 4.0.0 is here")
def test_the_stand_in_has_its_connectors_where_the_standard_library_has_them(
    tmp_path: Path,
) -> None:
    (tmp_path / "Modelica").symlink_to(standard_libraries()[0])
    real = Libraries([tmp_path])
    ours = Libraries([Path(checks.__file__).parent])
    paths = list(models(ours, "Modelica.Blocks"))
    assert "Modelica.Blocks.Logical.Switch" in paths
    for path in paths:
        places = [
            {(part.name, part.path, part.box) for part in icon(libraries, path).parts.values()}
            for libraries in (ours, real)
        ]
        assert places[0] == places[1], path


PRIMITIVES = re.compile(r"\b(?:Line|Polygon|Rectangle|Ellipse|Text|Bitmap)\(")


@needs_omc
def test_openmodelica_reads_the_same_icons(found: Libraries, tmp_path: Path) -> None:
    generate(sample_buses.troll(), GENERATED, tmp_path / "libraries")
    omc = OpenModelica(tmp_path, tmp_path / "libraries", GENERATED)
    paths = [path for library in (STATIC, GENERATED) for path in models(found, library)]
    commands = [
        f'print("@@ {path} " + OpenModelica.Scripting.getErrorString() + "\\n"); '
        f"getIconAnnotation({path});"
        for path in paths
    ]
    answer = omc.run(*commands, 'print("@@ end " + getErrorString() + "\\n");')
    assert "Error" not in answer
    for path, part in re.findall(r"@@ (\S+)(.*?)(?=@@)", answer, re.DOTALL):
        own = found.get(path).definition.annotation.part("Icon").named.get("graphics")
        ours = [] if own is None else own.binding.elements
        assert len(PRIMITIVES.findall(part)) == len(ours), path
    assert f"@@ {STATIC}.EtherCATMaster" in answer


@pytest.fixture(scope="module")
def drawn() -> dict[str, str]:
    return pictures()


def test_pictures_of_the_documentation_are_those_of_the_libraries(drawn: dict[str, str]) -> None:
    committed = {
        file.name: file.read_text("utf-8")
        for file in (DOCS / "pictures").glob("*.svg")
        if not file.name.startswith(SCREEN)
    }
    changed = sorted(
        name for name in drawn.keys() | committed.keys() if drawn.get(name) != committed.get(name)
    )
    assert changed == [], "`make pictures` draws them again; look at them, then commit them"


def test_every_picture_is_shown(drawn: dict[str, str]) -> None:
    text = (DOCS / "modelica-blocks.md").read_text("utf-8")
    hidden = [name for name in drawn if f"](pictures/{name})" not in text]
    assert hidden == [], "docs/modelica-blocks.md shows all of docs/pictures"

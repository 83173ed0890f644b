"""How the libraries look in an editor: nothing overlaps, and lines end where they should."""

from collections.abc import Iterator

import pytest

from ecatgen.drawing.checks import check_diagram, check_icon
from ecatgen.drawing.library import Libraries
from ecatgen.drawing.pictures import STATIC, libraries, models
from ecatgen.drawing.scene import diagram, icon


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Libraries:
    return libraries(tmp_path_factory.mktemp("libraries"))


def partial(found: Libraries, path: str) -> bool:
    return "partial" in found.get(path).definition.prefixes


def findings(found: Libraries, library: str) -> Iterator[str]:
    for path in models(found, library):
        yield from (f"{path}: {problem}" for problem in check_diagram(diagram(found, path)))
        if not partial(found, path):
            yield from (f"{path}: {problem}" for problem in check_icon(icon(found, path)))


@pytest.mark.parametrize("library", [STATIC])
def test_nothing_overlaps_and_every_line_meets_its_connectors(
    found: Libraries, library: str
) -> None:
    assert f"{STATIC}.EtherCATMaster" in models(found, STATIC)
    assert list(findings(found, library)) == []

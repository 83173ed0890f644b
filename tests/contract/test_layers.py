"""Every import of the Python code is allowed by the table at the top of docs/architecture.md."""

import ast
import functools
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[2]
TREES = {"ecatd": "daemon", "ecatgen": "codegen", "ecatsim": "simulator", "ecatdev": "tools"}
EVERYTHING = "everything"


class Layer(NamedTuple):
    """A row of the table: files, and the folders that they may import from."""

    where: str
    allowed: frozenset[str]

    def has(self, file: str) -> bool:
        if self.where.endswith("/*.py"):
            return file.rpartition("/")[0] == self.where.removesuffix("/*.py")
        return file == self.where or file.startswith(self.where + "/")


def without_tree(folder: str) -> str:
    """`daemon/ecatd/model` as the last column writes it: `ecatd/model`."""
    first, _, rest = folder.partition("/")
    return rest if first in TREES.values() else folder


@functools.cache
def layers() -> tuple[Layer, ...]:
    """The table; the longest names first, so that the first that fits is the one."""
    text = (ROOT / "docs" / "architecture.md").read_text().partition("\n## ")[0]
    allowed: dict[str, frozenset[str]] = {}
    for row in re.findall(r"^\| `([^`]+)` \|.*\| ([^|]+) \|$", text, re.MULTILINE):
        where, last = without_tree(row[0].removesuffix("/")), row[1]
        found = {EVERYTHING} if EVERYTHING in last else set(re.findall(r"`([^`]+)`", last))
        for other in re.findall(r"`([^`]+)` and its row", last):
            found |= allowed[other]
        allowed[where] = frozenset(found)
    assert len(allowed) > 20
    found_layers = (Layer(*item) for item in allowed.items())
    return tuple(sorted(found_layers, key=lambda layer: -len(layer.where)))


def layer_of(file: str) -> Layer:
    for layer in layers():
        if layer.has(file):
            return layer
    raise AssertionError(f"{file} has no row in the table of docs/architecture.md")


def breaks(imports: Iterable[tuple[str, str]]) -> list[str]:
    """Those imports, as (importing file, imported file), that the table does not allow."""
    wrong = []
    for importing, imported in imports:
        here, there = layer_of(importing), layer_of(imported)
        if here != there and there.where not in here.allowed and EVERYTHING not in here.allowed:
            wrong.append(f"{importing} imports {imported}: {here.where} may not use {there.where}")
    return sorted(wrong)


def files() -> dict[str, str]:
    """All files by the name of their module."""
    found = {}
    for package, tree in TREES.items():
        for path in (ROOT / tree / package).rglob("*.py"):
            file = path.relative_to(ROOT / tree)
            parts = file.parent.parts if file.stem == "__init__" else file.with_suffix("").parts
            found[".".join(parts)] = file.as_posix()
    return found


def imports() -> Iterator[tuple[str, str]]:
    """All imports of ours, also those within functions and for type checkers only."""
    modules = files()
    for module, file in modules.items():
        tree = TREES[module.partition(".")[0]]
        package = module if file.endswith("__init__.py") else module.rpartition(".")[0]
        for node in ast.walk(ast.parse((ROOT / tree / file).read_text())):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                parts = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*(parts if node.level else []), *filter(None, [node.module])])
                names = [
                    name if (name := f"{base}.{alias.name}") in modules else base
                    for alias in node.names
                ]
            else:
                continue
            yield from ((file, modules[name]) for name in names if name in modules)


def test_imports_are_those_of_the_table() -> None:
    found = list(imports())
    assert len(found) > 1000
    assert breaks(found) == []


def test_every_row_is_about_something_that_exists() -> None:
    for layer in layers():
        folder = layer.where.removesuffix("/*.py")
        places = [ROOT / folder, *(ROOT / tree / folder for tree in TREES.values())]
        assert any(place.exists() for place in places), layer.where
        for name in layer.allowed - {EVERYTHING}:
            assert any(name == other.where for other in layers()), f"{layer.where}: `{name}`"


@pytest.mark.parametrize(
    ("importing", "imported"),
    [
        ("ecatd/bus/master/master.py", "ecatd/bus/start/bring_up.py"),
        ("ecatd/bus/master/master.py", "ecatd/bus/watch/rate_limiter.py"),
        ("ecatd/bus/start/bring_up.py", "ecatd/bus/requests/conversations.py"),
        ("ecatd/client/remote.py", "ecatd/gateway/publisher.py"),
        ("ecatd/bus/watch/outputs.py", "ecatd/shared_memory/reader.py"),
        ("ecatd/bus/__main__.py", "ecatsim/rig.py"),
        ("ecatd/model/bus.py", "ecatd/log.py"),
        ("ecatd/bus/server.py", "ecatd/client/remote.py"),
        ("ecatsim/rig.py", "ecatd/bus/frames/datagrams.py"),
        ("ecatgen/ir.py", "ecatsim/rig.py"),
    ],
)
def test_an_import_that_goes_up_is_named(importing: str, imported: str) -> None:
    (found,) = breaks([(importing, imported)])
    assert found.startswith(f"{importing} imports {imported}: ")


def test_a_folder_without_a_row_is_named() -> None:
    with pytest.raises(AssertionError, match="has no row"):
        breaks([("ecatd/bus/new/thing.py", "ecatd/log.py")])

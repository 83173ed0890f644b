"""The table at the top of docs/architecture.md allows every import.

An import is a statement of Python, an `#include` of C, or a string that names a module, to load the
module or to start it as a process.
"""

import ast
import functools
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[2]
TREES = {"ecatd": "daemon", "ecatgen": "codegen", "ecatsim": "simulator", "ecatdev": "tools"}
C_FOLDERS = ("client_c", "daemon/cyclic", "simulator/esc", "simulator/canbus", "codegen/ecatgen")
EVERYTHING = "everything"
BY_NAME = "by name "
UNIT = "ecatd.service"
"""This string is also the name of a systemd unit, so nobody can tell when it names the module."""


class Layer(NamedTuple):
    """A row of the table.

    Attributes:
        where: The files.
        allowed: The folders that they may import from.
        by_name: The folders whose modules they may also name by strings.
    """

    where: str
    allowed: frozenset[str]
    by_name: frozenset[str]

    def has(self, file: str) -> bool:
        if self.where.endswith("/*.py"):
            return file.rpartition("/")[0] == self.where.removesuffix("/*.py")
        return file == self.where or file.startswith(self.where + "/")


def without_tree(folder: str) -> str:
    """`daemon/ecatd/base` as the last column writes it: `ecatd/base`."""
    first, _, rest = folder.partition("/")
    return rest if first in TREES.values() else folder


@functools.cache
def layers() -> tuple[Layer, ...]:
    """The table; the longest names first, so that the first that fits is the one."""
    text = (ROOT / "docs" / "architecture.md").read_text().partition("\n## ")[0]
    allowed: dict[str, frozenset[str]] = {}
    found_layers = []
    for row in re.findall(r"^\| `([^`]+)` \|.*\| ([^|]+) \|$", text, re.MULTILINE):
        where = without_tree(row[0].removesuffix("/"))
        last, _, by_name = row[1].partition(BY_NAME)
        found = {EVERYTHING} if EVERYTHING in last else set(re.findall(r"`([^`]+)`", last))
        for other in re.findall(r"`([^`]+)` and its row", last):
            found |= allowed[other]
        allowed[where] = frozenset(found)
        named = frozenset(re.findall(r"`([^`]+)`", by_name))
        found_layers.append(Layer(where, allowed[where], named))
    assert len(found_layers) > 20
    return tuple(sorted(found_layers, key=lambda layer: -len(layer.where)))


def layer_of(file: str) -> Layer:
    for layer in layers():
        if layer.has(file):
            return layer
    raise AssertionError(f"{file} has no row in the table of docs/architecture.md")


def breaks(imports: Iterable[tuple[str, str]], *, by_name: bool = False) -> list[str]:
    """Those imports, as (importing file, imported file), that the table does not allow.

    Args:
        imports: The imports.
        by_name: Whether strings name the modules.
    """
    wrong = []
    for importing, imported in imports:
        here, there = layer_of(importing), layer_of(imported)
        allowed = here.allowed | (here.by_name if by_name else frozenset())
        if here != there and there.where not in allowed and EVERYTHING not in allowed:
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


def syntax_trees() -> Iterator[tuple[str, str, ast.Module]]:
    """Each file of ours, its package, and its syntax."""
    for module, file in files().items():
        path = ROOT / TREES[module.partition(".")[0]] / file
        package = module if file.endswith("__init__.py") else module.rpartition(".")[0]
        yield file, package, ast.parse(path.read_text())


def imports() -> Iterator[tuple[str, str]]:
    """All imports of ours, also those within functions and for type checkers only."""
    modules = files()
    for file, package, tree in syntax_trees():
        for node in ast.walk(tree):
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


def named_modules() -> Iterator[tuple[str, str]]:
    """Each string of ours that names a module, such as `"ecatd.server"` or `".client"`."""
    modules = files()
    for file, package, tree in syntax_trees():
        for node in ast.walk(tree):
            if not isinstance(node, ast.Constant) or not isinstance(node.value, str):
                continue
            name = package + node.value if node.value.startswith(".") else node.value
            if "." in name and name != UNIT and name in modules:
                yield file, modules[name]


def includes() -> Iterator[tuple[str, str]]:
    """Each `#include` line of a file of ours that names another one."""
    everything = [path for folder in C_FOLDERS for path in (ROOT / folder).rglob("*.*")]
    ours = [path for path in everything if path.suffix in (".c", ".h", ".hpp", ".def")]
    ours = [path for path in ours if "_client" not in path.parts]  # a copy, made by the build
    for path in ours:
        for name in re.findall(r'^ *# *include *[<"]([^">]+)[">]', path.read_text(), re.MULTILINE):
            found = [header for header in ours if header.as_posix().endswith(f"/{name}")]
            beside = path.parent / name
            for header in [beside] if beside in found else found:
                yield c_name(path), c_name(header)


def c_name(path: Path) -> str:
    return without_tree(path.relative_to(ROOT).as_posix())


def test_imports_are_those_of_the_table() -> None:
    found = list(imports())
    assert len(found) > 1000
    assert breaks(found) == []


def test_modules_named_by_strings_are_those_of_the_table() -> None:
    found = set(named_modules())
    assert found >= {
        ("ecatd/commands.py", "ecatd/service/main.py"),
        ("ecatd/commands.py", "ecatd/cli/main.py"),
        ("ecatd/commands.py", "ecatsim/cli/main.py"),
        ("ecatd/client/__init__.py", "ecatd/client/client.py"),
        ("ecatd/service/supervisor.py", "ecatd/server/__init__.py"),
    }
    assert breaks(found, by_name=True) == []


def test_includes_are_those_of_the_table() -> None:
    found = set(includes())
    assert found >= {
        ("cyclic/engine.h", "client_c/include/ecat/ecat_shm.h"),
        ("esc/frame.c", "esc/slave.h"),
        ("ecatgen/fmu/source/plant.h", "client_c/include/ecat/ecat_session.h"),
    }
    assert breaks(found) == []


def test_every_row_is_about_something_that_exists() -> None:
    for layer in layers():
        folder = layer.where.removesuffix("/*.py")
        places = [ROOT / folder, *(ROOT / tree / folder for tree in TREES.values())]
        assert any(place.exists() for place in places), layer.where
        for name in (layer.allowed | layer.by_name) - {EVERYTHING}:
            assert any(name == other.where for other in layers()), f"{layer.where}: `{name}`"


@pytest.mark.parametrize(
    ("importing", "imported"),
    [
        ("ecatd/master/master.py", "ecatd/server/start/bring_up.py"),
        ("ecatd/master/master.py", "ecatd/server/watch/reports.py"),
        ("ecatd/server/start/bring_up.py", "ecatd/server/requests/conversations.py"),
        ("ecatd/client/remote.py", "ecatd/gateway/publisher.py"),
        ("ecatd/server/requests/objects.py", "ecatd/server/watch/reports.py"),
        ("ecatd/server/watch/outputs.py", "ecatd/shm/statistics/reader.py"),
        ("ecatd/server/__main__.py", "ecatsim/rig.py"),
        ("ecatd/description/bus.py", "ecatd/config/config.py"),
        ("ecatd/server/server.py", "ecatd/client/remote.py"),
        ("ecatsim/rig.py", "ecatd/master/frames/datagrams.py"),
        ("ecatgen/ir.py", "ecatsim/rig.py"),
        ("ecatd/commands.py", "ecatd/service/main.py"),  # only by name
        ("client_c/src/client.c", "cyclic/engine.h"),
        ("cyclic/frames.c", "esc/esc.h"),
        ("esc/frame.c", "client_c/include/ecat/ecat_shm.h"),
    ],
)
def test_an_import_that_goes_up_is_named(importing: str, imported: str) -> None:
    (found,) = breaks([(importing, imported)])
    assert found.startswith(f"{importing} imports {imported}: ")


def test_a_module_that_is_named_against_the_table_is_found() -> None:
    (found,) = breaks([("ecatd/service/supervisor.py", "ecatd/cli/main.py")], by_name=True)
    assert found.startswith("ecatd/service/supervisor.py imports ecatd/cli/main.py: ")


def test_a_folder_without_a_row_is_named() -> None:
    with pytest.raises(AssertionError, match="has no row"):
        breaks([("ecatd/bus/new/thing.py", "ecatd/base/log.py")])

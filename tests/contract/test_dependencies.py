"""Foreign packages are used in few places. Our own imports: `test_layers.py`."""

import ast
import functools
import graphlib
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import test_layers

import ecatgen

ROOT = Path(__file__).parents[2]
ROOTS = {"ecatd": "daemon", "ecatgen": "codegen", "ecatsim": "simulator"}


@functools.cache
def imports() -> frozenset[tuple[str, str]]:
    """Every import of ours as (importing module, imported module or name in a module)."""
    return frozenset(_imports())


def _imports() -> Iterator[tuple[str, str]]:
    for package, folder in ROOTS.items():
        for file in sorted((ROOT / folder / package).rglob("*.py")):
            parts = file.relative_to(ROOT / folder).with_suffix("").parts
            module = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            for node in ast.walk(ast.parse(file.read_text())):
                if isinstance(node, ast.Import):
                    yield from ((module, alias.name) for alias in node.names)
                elif isinstance(node, ast.ImportFrom):
                    base = module.split(".")
                    if file.name != "__init__.py":
                        base = base[:-1]
                    base = base[: len(base) - node.level + 1] if node.level else []
                    name = ".".join([*base, *filter(None, [node.module])])
                    yield module, name
                    yield from ((module, f"{name}.{alias.name}") for alias in node.names)


def importers(prefix: str) -> set[str]:
    return {m for m, name in imports() if name == prefix or name.startswith(prefix + ".")}


def test_pysoem_is_known_in_one_module() -> None:
    assert importers("pysoem") == {"ecatd.master.frames.soem"}


def test_zenoh_is_known_to_those_who_speak_it_only() -> None:
    assert all(
        m.startswith(("ecatd.gateway", "ecatd.client", "ecatd.ros", "ecatd.operations.zenoh_keys"))
        for m in importers("zenoh")
    )


def test_jinja2_is_known_to_the_generator_only() -> None:
    assert all(m.startswith("ecatgen") for m in importers("jinja2"))


KNOWN_CIRCLES = frozenset({("ecatd/client/file_transfer.py", "ecatd/client/remote.py")})
"""Imports that close a circle. `who` is about to leave `remote.py`; then this set is empty."""


def test_modules_need_each_other_in_one_direction() -> None:
    """In all packages, also by imports within functions and for type checkers only."""
    found = {(file, other) for file, other in test_layers.imports() if file != other}
    assert {file.partition("/")[0] for file, _ in found} == set(test_layers.TREES)
    needed = defaultdict(set)
    for file, other in found - KNOWN_CIRCLES:
        needed[file].add(other)
    graphlib.TopologicalSorter(needed).prepare()  # raises for a circle, and names it


def test_every_module_of_the_generator_is_in_its_table_of_contents() -> None:
    text = str(ecatgen.__doc__)
    folder = ROOT / "codegen" / "ecatgen"
    modules = {file.stem for file in folder.glob("*.py")} - {"__init__"}
    packages = {file.parent.name for file in folder.glob("*/__init__.py")}
    assert {"ir", "output"} <= modules | packages
    assert {name for name in modules | packages if f"`{name}`" not in text} == set()


def test_the_client_is_standard_c_alone() -> None:
    for file in (ROOT / "client_c").rglob("*.[ch]"):
        text = file.read_text()
        assert not re.search(r"cyclic[_./]", text), "the engine"
        assert "Python.h" not in text

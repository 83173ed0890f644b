"""The generator as one function."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from ecatd.model.bus import Bus

from . import static_library
from .build import build_library
from .differences import compare
from .ir import Library
from .origin import dump_origin, essence, read_origin
from .output import Report, Tree, install
from .render import render

_ORIGIN = "Resources/bus.json"
"""What a library is made from."""


def generate(
    bus: Bus,
    name: str,
    out: Path,
    templates: Iterable[Path] = (),
    *,
    check: bool = False,
    force: bool = False,
) -> Report:
    """Writes the Modelica library for a bus, and a copy of the library EtherCAT beside it.

    The same bus and name give the same bytes. An earlier result in `out` is replaced; files that
    were not generated stay where they are.

    Args:
        bus: Description of the bus.
        name: Name of the library, a Modelica identifier.
        out: Directory that the folders `name` and `EtherCAT` are written to.
        templates: Folders with templates of the user; an earlier one wins.
        check: Write nothing, only report what would change.
        force: Replace generated files that the user has changed, and keep those under another
            name; without it they are an error.

    Raises:
        ConfigError: A template is wrong.
        UsageError: The name cannot be that of a Modelica library.
        StateError: Files of the user stand in the way of generated ones.
        NotPermittedError: The directory cannot be written.
        EcatError: The C client is not installed.
    """
    generator = _Generator(name, templates)
    made_from = essence(bus)
    library = generator.library(made_from)
    files = generator.files(made_from, library)
    before = _before(out / library.name)
    packages = {static_library.NAME: static_library.static_files(), library.name: files}
    report = install(out, packages, library.name, check=check, force=force)
    report = replace(report, notes=library.notes)
    if before is None or not report.is_change:
        return report
    old = generator.library(before)
    differences = compare((before, old), (made_from, library))
    again = generator.files(before, old) if differences else files
    return replace(report, differences=differences, otherwise=_otherwise(report, files, again))


class _Generator:
    """What a library depends on beside its origin."""

    def __init__(self, name: str, templates: Iterable[Path]) -> None:
        self._name = name
        self._templates = list(templates)

    def library(self, made_from: Bus) -> Library:
        return build_library(made_from, self._name)

    def files(self, made_from: Bus, library: Library) -> Tree:
        return render(library, self._templates) | {_ORIGIN: dump_origin(made_from)}


def _before(folder: Path) -> Bus | None:
    """What an earlier run has made a library of; None where that is not known."""
    with suppress(OSError):
        return read_origin((folder / _ORIGIN).read_bytes())
    return None


def _otherwise(report: Report, files: Tree, again: Tree) -> tuple[str, ...]:
    """Files that are generated otherwise than before, though the bus has no part in it.

    Args:
        report: What was written.
        files: The library.
        again: The library of the bus before, as it is generated now.
    """
    prefix = f"{report.library.name}/"
    return tuple(
        path
        for path in report.regenerated
        if not path.startswith(prefix)
        or files.get(path.removeprefix(prefix)) == again.get(path.removeprefix(prefix))
    )

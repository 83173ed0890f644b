"""Generates a Modelica library: the generator as one function."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from contextlib import nullcontext, suppress
from dataclasses import replace
from pathlib import Path

from ecatd.base.errors import StateError
from ecatd.description.bus import Bus

from . import can, names, static_library
from .build import build_library
from .differences import compare
from .ir import Library
from .origin import dump_origin, essence, read_origin
from .output import Report, Tree, install
from .output.failures import failures_in_words
from .output.folder import read_folder
from .render import render

_ORIGIN = "Resources/bus.json"
"""The file in the library that holds the bus it was made from."""

_CAN = f"Resources/{can.FILE}"
"""The file with the messages of CAN buses; only there if it has some."""


def generate(
    bus: Bus,
    name: str,
    out: Path,
    templates: Iterable[Path] = (),
    *,
    messages: Sequence[can.CanFile] | None = None,
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
        templates: Folders with templates of the user; an earlier folder takes precedence.
        messages: The messages of CAN buses behind slaves; None: those of the library before.
        check: Write nothing, only report what would change.
        force: Replace generated files that the user has changed, and keep these under another name.
            Without it they are an error.

    Raises:
        ConfigError: A template is wrong.
        UsageError: `name` cannot be the name of a Modelica library.
        StateError: Files of the user are in the places of generated ones; or a terminal with the
            CAN messages of the library before is gone, or these cannot be read.
        NotPermittedError: The directory cannot be written.
        EcatError: The C client is not installed.
    """
    generator = _Generator(name, templates)
    made_from = essence(bus)
    folder = out / names.library_name(name)
    before = _read(folder / _ORIGIN)
    earlier: Sequence[can.CanFile] = ()
    with nullcontext() if messages is None else suppress(StateError):
        earlier = _remembered(folder)
    messages = can.on_bus(earlier, made_from) if messages is None else messages
    library = generator.library(made_from, messages)
    files = generator.files(made_from, library, messages)
    packages = {static_library.NAME: static_library.static_files(), library.name: files}
    report = install(out, packages, library.name, check=check, force=force)
    report = replace(report, notes=library.notes)
    origin = read_origin(before)
    if origin is None or not report.is_change:
        return report
    old = generator.library(origin, earlier)
    differences = compare((origin, old), (made_from, library))
    again = generator.files(origin, old, earlier) if differences else files
    return replace(report, differences=differences, otherwise=_otherwise(report, files, again))


class _Generator:
    """Builds libraries from different buses with the same name and templates."""

    def __init__(self, name: str, templates: Iterable[Path]) -> None:
        self._name = name
        self._templates = list(templates)

    def library(self, made_from: Bus, messages: Sequence[can.CanFile]) -> Library:
        return build_library(made_from, self._name, messages)

    def files(self, made_from: Bus, library: Library, messages: Sequence[can.CanFile]) -> Tree:
        more = {_CAN: can.dump(messages)} if messages else {}
        return render(library, self._templates) | {_ORIGIN: dump_origin(made_from)} | more


def _read(path: Path) -> bytes | None:
    """Returns what an earlier run has written, or None if that is not known."""
    with suppress(OSError):
        return path.read_bytes()
    return None


def _remembered(folder: Path) -> tuple[can.CanFile, ...]:
    """The messages of CAN buses that an earlier run has read.

    Raises:
        StateError: There were some, but what the run has remembered cannot be read.
    """
    path = folder / _CAN
    with failures_in_words(folder, "read"):
        had_some = os.path.lexists(path) or _CAN in read_folder(folder).manifest
    return can.remembered(_read(path), str(path)) if had_some else ()


def _otherwise(report: Report, files: Tree, again: Tree) -> tuple[str, ...]:
    """Returns the files that a new version of ecatd or a new template has changed, not the bus.

    Args:
        report: The report of this run.
        files: The files of the library.
        again: The files of the library for the old bus, as this version generates them.
    """
    prefix = f"{report.library.name}/"
    return tuple(
        path
        for path in report.regenerated
        if not path.startswith(prefix)
        or files.get(path.removeprefix(prefix)) == again.get(path.removeprefix(prefix))
    )

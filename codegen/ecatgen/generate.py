"""The generator as one function."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ecatd.model.bus import Bus

from . import scan, static_library
from .build import build_library
from .output import Report, install
from .profiles import load_profiles
from .render import render


def generate(
    bus: Bus, name: str, out: Path, profiles: Iterable[Path] = (), templates: Iterable[Path] = ()
) -> Report:
    """Writes the Modelica library for a bus, and a copy of the library EtherCAT beside it.

    The same bus and name give the same bytes. An earlier result in `out` is replaced.

    Args:
        bus: Description of the bus.
        name: Name of the library, a Modelica identifier.
        out: Directory that the folders `name` and `EtherCAT` are written to.
        profiles: Folders with device profiles of the user; an earlier one wins.
        templates: Folders with templates of the user; an earlier one wins.

    Raises:
        ConfigError: A device profile or a template is wrong.
        UsageError: The name cannot be that of a Modelica library.
        StateError: The folders hold files that were not generated, or changed since.
        NotPermittedError: The directory cannot be written.
        EcatError: The C client is not installed.
    """
    made = scan.essence(bus)
    library = build_library(made, name, load_profiles(profiles))
    packages = {
        static_library.NAME: static_library.static_files(),
        library.name: render(library, templates) | {scan.PATH: scan.scan_file(made)},
    }
    return install(out, packages, library.name)

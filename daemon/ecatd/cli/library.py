"""Commands `generate` and `client-flags`: what programs and models are built from."""

from __future__ import annotations

import argparse
import shlex
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from ecatd.model.bus import Bus
from ecatd.model.errors import EcatError, UsageError

from .bus_source import get_bus
from .output import print_json

if TYPE_CHECKING:
    from ecatgen import Report
    from ecatgen.fmu import FmuReport


def generate(options: argparse.Namespace) -> None:
    """Writes a Modelica library, or an FMU, for the bus."""
    if options.fmi and not options.fmu:
        raise UsageError("--fmi is the version of an FMU: say --fmu, too")
    bus = get_bus(options)
    report = _write(bus, options)
    if options.json:
        print_json({"bus": bus.name, **report.to_dict()})
        return
    print(report.summary())


def _write(bus: Bus, options: argparse.Namespace) -> Report | FmuReport:
    from ecatgen import fmu, generate  # only this command needs the templates

    if options.fmu:
        return fmu.generate_fmu(bus, options.name, options.out, options.fmi or 2)
    return generate(bus, options.name, options.out)


def client_flags(options: argparse.Namespace) -> None:
    """Prints what a compiler, CMake or pkg-config needs to build a program with the client."""
    library = client_prefix() / "lib"
    folders = {"cmake_dir": library / "cmake" / "ecat", "pkg_config_dir": library / "pkgconfig"}
    if options.json:
        print_json({"flags": static_flags()} | {name: str(path) for name, path in folders.items()})
    elif options.folder:
        print(folders[options.folder])
    else:
        print(shlex.join(static_flags()))


def static_flags() -> list[str]:
    """Compiler flags for a program that carries the client in itself."""
    prefix = client_prefix()
    return [f"-I{prefix / 'include'}", str(prefix / "lib" / "libecat.a"), "-lm"]


def client_prefix() -> Path:
    """Where headers and libraries of the C client are installed.

    Raises:
        EcatError: The C client is not built.
    """
    for folder in import_module("ecatgen").__path__:
        prefix = Path(folder) / "_client"
        if prefix.is_dir():
            return prefix
    raise EcatError("the C client is not built: install the package (`pip install .`)")

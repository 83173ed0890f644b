"""Commands `generate`, `library` and `client-flags`: libraries and flags to build with."""

from __future__ import annotations

import argparse
import os
import shlex
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ecatd.base.errors import EcatError, NotPermittedError, UsageError
from ecatd.base.paths import user_config

from .arguments import slave
from .bus_source import add_options, get_bus
from .output import print_json, progress

if TYPE_CHECKING:
    from ecatd.description.bus import Bus
    from ecatgen import Report
    from ecatgen.can import CanFile
    from ecatgen.fmu import FmuReport, LsBusReport

COMMANDS = {
    "documents": {
        "generate": "Write a Modelica library, or an FMU, for the bus.",
        "library": "Install the Modelica library EtherCAT.",
        "client-flags": "Print compiler flags for C and C++ programs.",
    },
}

CHANGES = 1
"""Exit status of `--check` if something would change."""


def add_arguments(command: argparse.ArgumentParser, name: str) -> None:
    """Adds the arguments of a command."""
    {"generate": _add_generate, "library": _add_library, "client-flags": _add_client_flags}[name](
        command
    )


def _add_generate(command: argparse.ArgumentParser) -> None:
    command.add_argument("name", metavar="NAME", help="name of the library, such as TrollPlant")
    command.add_argument("out", metavar="DIR", type=Path, help="folder for the library")
    add_options(command)
    command.add_argument(
        "--templates",
        action="append",
        default=[],
        metavar="DIR",
        type=Path,
        help="folder with your own templates, which replace those of the same name in "
        "~/.config/ecatd/templates; can be given several times, the first one wins",
    )
    command.add_argument(
        "--can",
        action="append",
        metavar="SLAVE=FILE[@WHO]",
        help="make connectors of the CAN bus behind the terminal SLAVE (position or name): of a "
        "DBC file, in which the model is the nodes WHO (such as ECU or ECU,GATEWAY; without, it "
        "only receives), or of the PDOs of a CANopen device with the node ID WHO (EDS file); can "
        "be given several times; later runs remember all of it, and --can none forgets it",
    )
    command.add_argument(
        "--fmu", action="store_true", help="write DIR/NAME.fmu instead, an FMU for co-simulation"
    )
    command.add_argument(
        "--fmi", type=int, choices=(2, 3), help="with --fmu: version of FMI (default: 2)"
    )
    command.add_argument(
        "--ls-bus",
        metavar="SLAVE",
        type=slave,
        help="write DIR/NAME.fmu instead, an FMU whose bus terminal is the CAN bus behind this "
        "terminal, for virtual ECUs (FMI-LS-BUS)",
    )
    command.add_argument(
        "--ls-bus-ecus",
        type=int,
        metavar="N",
        help="with --ls-bus: number of virtual ECUs, each with a bus terminal (default: 1)",
    )
    command.add_argument(
        "--ls-bus-clock",
        choices=("countdown", "triggered"),
        help="with --ls-bus: kind of the clocks Tx_Clock; triggered is for tools that cannot do "
        "countdown (default)",
    )
    _add_rewrite(command)


def _add_library(command: argparse.ArgumentParser) -> None:
    command.description = (
        "Install the Modelica library EtherCAT, which generated libraries of all buses use."
    )
    command.add_argument("out", metavar="DIR", type=Path, nargs="?", help="folder for the library")
    command.add_argument(
        "--openmodelica",
        action="store_true",
        help="install it where OpenModelica finds it: in ~/.openmodelica/libraries, or in a "
        "folder of $OPENMODELICALIBRARY",
    )
    _add_rewrite(command)


def _add_client_flags(command: argparse.ArgumentParser) -> None:
    command.description = "Print the compiler flags for a C or C++ program that uses the client."
    which = command.add_mutually_exclusive_group()
    for option, tool in (("--cmake-dir", "CMake"), ("--pkg-config-dir", "pkg-config")):
        which.add_argument(
            option,
            dest="folder",
            action="store_const",
            const=option.strip("-").replace("-", "_"),
            help=f"print the folder in which {tool} finds the client instead",
        )


def _add_rewrite(command: argparse.ArgumentParser) -> None:
    """Adds the options for a library that exists already."""
    how = command.add_mutually_exclusive_group()
    how.add_argument(
        "--check",
        action="store_true",
        help="write nothing, and say what would change; the exit status is 1 if anything would",
    )
    how.add_argument(
        "--force",
        action="store_true",
        help="also replace generated files that were changed by hand, and keep the old ones as "
        "FILE.orig",
    )


def generate(options: argparse.Namespace) -> int:
    """Writes a Modelica library or an FMU for the bus, or with `--check` says what would change.

    Returns:
        The exit status.
    """
    if options.fmi and not options.fmu:
        raise UsageError("--fmi is the version of an FMU: give --fmu, too")
    if options.ls_bus is None and (options.ls_bus_ecus is not None or options.ls_bus_clock):
        raise UsageError("--ls-bus-ecus and --ls-bus-clock are about --ls-bus: give it, too")
    if options.fmu and options.ls_bus is not None:
        raise UsageError("--fmu has the values of the bus, --ls-bus a CAN bus: give one of them")
    if options.ls_bus is not None and options.can:
        raise UsageError("--can has the meaning of frames, and with --ls-bus ECUs know it")
    if options.ls_bus is not None and (options.force or options.templates):
        raise UsageError(
            "--force and --templates are about libraries: leave them out with --ls-bus"
        )
    if options.fmu and (options.force or options.templates):
        raise UsageError("--force and --templates are about libraries: leave them out with --fmu")
    bus, more = get_bus(options)
    return _print_report(options, _generate(bus, options), {"bus": bus.name, **more})


def _generate(bus: Bus, options: argparse.Namespace) -> Report | FmuReport | LsBusReport:
    from ecatgen import fmu, generate  # only this command needs the templates

    name, out, check = options.name, options.out, options.check
    messages = _messages(bus, options.can)
    if options.ls_bus is not None:
        ecus = 1 if options.ls_bus_ecus is None else options.ls_bus_ecus
        clock = options.ls_bus_clock or "countdown"
        return fmu.generate_ls_bus(bus, name, out, options.ls_bus, ecus, clock, check=check)
    standard = user_config("templates")
    templates = [*options.templates, *([standard] if standard.is_dir() else [])]
    signals = sum(len(message.signals) for file in messages or [] for message in file.messages)
    with progress() as show:
        if signals:  # many of them take some seconds
            show(f"making connectors of {signals} CAN signals")
        if options.fmu:
            fmi = options.fmi or 2
            return fmu.generate_fmu(bus, name, out, fmi, messages=messages, check=check)
        return generate(
            bus, name, out, templates, messages=messages, check=check, force=options.force
        )


def _messages(bus: Bus, texts: list[str] | None) -> list[CanFile] | None:
    """The messages of all files of `--can`; None without the option."""
    from ecatgen import can

    if texts is None:
        return None
    if texts == [can.NONE]:
        return []
    return [can.read_request(request, bus) for request in map(can.parse_option, texts)]


def library(options: argparse.Namespace) -> int:
    """Installs the Modelica library EtherCAT in a folder, or where OpenModelica finds it.

    Returns:
        The exit status.
    """
    from ecatgen.static_library import install_library

    if (options.out is None) != options.openmodelica:
        raise UsageError("say where to put the library: give either DIR or --openmodelica")
    out = options.out or _openmodelica_folder()
    report = install_library(out, check=options.check, force=options.force)
    return _print_report(options, report, {})


def _openmodelica_folder() -> Path:
    """A folder in which `loadModel` of OpenModelica looks, and which can be written.

    This is the user's folder, unless OPENMODELICALIBRARY names others.

    Raises:
        NotPermittedError: The variable names no folder that can be written.
    """
    usual = Path.home() / ".openmodelica" / "libraries"
    value = os.environ.get("OPENMODELICALIBRARY", "")
    named = [Path(folder) for folder in value.split(os.pathsep) if folder]
    if not named or usual in named:
        return usual
    for folder in named:
        if folder.is_dir() and os.access(folder, os.W_OK):
            return folder
    raise NotPermittedError(
        f"OPENMODELICALIBRARY names no folder that can be written ({value}), and OpenModelica "
        f"looks nowhere else: add {usual} to it, or give DIR"
    )


def _print_report(
    options: argparse.Namespace, report: Report | FmuReport | LsBusReport, more: dict[str, Any]
) -> int:
    last = report.would() if options.check else report.summary()
    _print(options, {**more, **report.to_dict()}, *report.details(), last)
    return CHANGES if options.check and report.is_change else 0


def _print(options: argparse.Namespace, data: dict[str, Any], *lines: str) -> None:
    if options.json:
        print_json(data)
    else:
        print("\n".join(lines))


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
    """Compiler flags for a program that links the client statically."""
    prefix = client_prefix()
    return [f"-I{prefix / 'include'}", str(prefix / "lib" / "libecat.a"), "-lm", "-pthread"]


def client_prefix() -> Path:
    """Folder in which headers and libraries of the C client are installed.

    Raises:
        EcatError: The C client is not built.
    """
    for folder in import_module("ecatgen").__path__:
        prefix = Path(folder) / "_client"
        if prefix.is_dir():
            return prefix
    raise EcatError("the C client is not built: install the package (`pip install .`)")

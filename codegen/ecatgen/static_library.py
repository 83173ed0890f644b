"""The files of the static library EtherCAT: Modelica, and the C client for this platform."""

from __future__ import annotations

import platform
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

from ecatd.base.errors import EcatError

from .output import Report, install

NAME = "EtherCAT"
VERSION = "0.1.0"

# Folders that Modelica tools search: the standard name, and the one that OpenModelica uses on ARM.
_PLATFORMS = {"x86_64": "linux64", "aarch64": "aarch64-linux"}


def static_files() -> dict[str, bytes]:
    """Returns the files of the library, by their path in it.

    Raises:
        EcatError: The C client is not installed, or there is none for this platform.
    """
    files = dict(_tree(built_folder("modelica", "the static library") / NAME, ""))
    client = built_folder("_client", "the C client for generated libraries")
    files |= _tree(client / "include", "Resources/Include/")
    files |= _tree(client / "src", "Resources/Source/")
    archive = client / "lib" / "libecat.a"
    files[f"Resources/Library/{_platform()}/libecat.a"] = archive.read_bytes()
    return files


def install_library(out: Path, *, check: bool = False, force: bool = False) -> Report:
    """Installs the library alone into a directory, in a folder named after its version.

    A tool that searches the directory finds the library by this name (Modelica 3.6, 13.2.4), also
    when it loads a generated library that uses this version.

    Args:
        out: The directory, which is made if it does not exist.
        check: See `install`.
        force: See `install`.

    Raises:
        StateError: Files of the user are in the way.
        NotPermittedError: The directory cannot be written.
        EcatError: The C client is not installed, or there is none for this platform.
    """
    folder = f"{NAME} {VERSION}"
    return install(out, {folder: static_files()}, folder, check=check, force=force)


def _platform() -> str:
    machine = platform.machine()
    if machine not in _PLATFORMS:
        raise EcatError(
            f"no Modelica library can be generated on a {machine} machine: "
            f"{' and '.join(_PLATFORMS)} are supported"
        )
    return _PLATFORMS[machine]


def built_folder(name: str, what: str) -> Path:
    """Returns a folder of the package that holds data or files made by the build.

    Raises:
        EcatError: The folder does not exist.
    """
    # A development install has the Python files and the built files in two different folders.
    for folder in import_module("ecatgen").__path__:
        path = Path(folder) / name
        if path.is_dir():
            return path
    raise EcatError(f"{what} is not built: install the package (`pip install .`, or `make`)")


def _tree(folder: Path, prefix: str) -> Iterator[tuple[str, bytes]]:
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            yield prefix + path.relative_to(folder).as_posix(), path.read_bytes()

"""The files that are the same in every FMU: binary, sources, icons and license."""

from __future__ import annotations

import platform
from pathlib import Path

from ecatd.base.errors import EcatError

from ..static_library import built_folder

# FMI 2.0 defines no name for ARM; importers search for one of these.
_PLATFORMS: dict[int, dict[str, tuple[str, ...]]] = {
    2: {"x86_64": ("linux64",), "aarch64": ("aarch64-linux", "linux64")},
    3: {"x86_64": ("x86_64-linux",), "aarch64": ("aarch64-linux",)},
}
_ICONS = {
    2: {"model.png": "icon.png"},
    3: {f"terminalsAndIcons/{name}": name for name in ("icon.png", "icon.svg")},
}
_SOURCES = Path(__file__).parent / "source"
_CLIENT_ONLY = ("layout.c",)  # needed by Python, not by an FMU


def fixed_files(fmi: int, name: str) -> dict[str, bytes]:
    """Returns binary, sources, headers, icons and license, by their path in the FMU.

    Raises:
        EcatError: The binary is not built, or there is none for this platform.
    """
    machine = platform.machine()
    if machine not in _PLATFORMS[fmi]:
        supported = " and ".join(_PLATFORMS[fmi])
        raise EcatError(f"no FMU can be made on a {machine} machine: {supported} are supported")
    binary = (built_folder("_fmu", "the binary of FMUs") / f"fmi{fmi}.so").read_bytes()
    client = built_folder("_client", "the C client for FMUs")
    files = {f"binaries/{place}/{name}.so": binary for place in _PLATFORMS[fmi][machine]}
    for path in sorted(_SOURCES.rglob("*")):
        if path.suffix in (".c", ".h") and _belongs(path, fmi):
            files[f"sources/{path.relative_to(_SOURCES).as_posix()}"] = path.read_bytes()
    for path in sorted((client / "src").glob("*.[ch]")):
        if path.name not in _CLIENT_ONLY:
            files[f"sources/client/{path.name}"] = path.read_bytes()
    for path in sorted((client / "include").rglob("*")):
        if path.suffix in (".h", ".def"):
            files[f"sources/{path.relative_to(client / 'include').as_posix()}"] = path.read_bytes()
    for place, icon in _ICONS[fmi].items():
        files[place] = (_SOURCES.with_name("icon") / icon).read_bytes()
    files["documentation/licenses/license.txt"] = _SOURCES.with_name("license.txt").read_bytes()
    return files


def _belongs(path: Path, fmi: int) -> bool:
    return not path.name.startswith("fmi") or path.name.startswith(f"fmi{fmi}")

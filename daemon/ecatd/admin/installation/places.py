"""Which file goes where.

The wheel has the files in `ecatd/_system`: `systemd`, `share` (as below `/usr/share`) and
`monitoring`.
"""

from __future__ import annotations

import sysconfig
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path, PurePosixPath

UNITS = tuple(f"{name}{at}.service" for name in ("ecatd", "ecatd-gateway") for at in ("", "@"))
"""The services of a single bus and of several; a bus has one, and its gateway another one."""
PROGRAMS = ("ecatd", "ecatctl", "ecatsim")
PACKAGED = Path("/usr/lib/ecatd/bin")
"""Where the Debian package has the programs."""
CONFIGURATION = PurePosixPath("/etc/ecatd")
STATE = PurePosixPath("/var/lib/ecatd")
LOGS = PurePosixPath("/var/log/ecatd")
SOCKETS = PurePosixPath("/run/ecatd")
MEMORY = PurePosixPath("/dev/shm/ecat")
ADMINISTRATION = PurePosixPath("/etc/systemd/system")
"""Where systemd keeps which units are enabled or masked, and changes of the administrator."""
_PROGRAM = b"/usr/local/bin/ecatd"
"""The path of ecatd in the units of the repository."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where to install.

    Attributes:
        root: The file system, `/` or the folder of an image. Commands are run only in `/`.
        programs: The folder with the program `ecatd` of this environment.
    """

    root: Path
    programs: Path

    def at(self, path: PurePosixPath) -> Path:
        """A path of the system, in the file system."""
        return self.root / path.relative_to("/")

    def seen(self, file: Path) -> PurePosixPath:
        """The path of a file as the system sees it."""
        return PurePosixPath("/") / file.relative_to(self.root)

    def holds(self, file: Path) -> bool:
        """Whether no link among the folders above a file leads out of the file system."""
        return file.parent.resolve().is_relative_to(self.root)

    @property
    def is_packaged(self) -> bool:
        """Whether a package of the distribution has put all files into place already."""
        return self.programs == PACKAGED

    @property
    def is_here(self) -> bool:
        """Whether it is this machine, and not an image of another one."""
        return self.root == Path("/")

    @property
    def is_running(self) -> bool:
        """Whether systemd runs there, so that it can read new units."""
        return self.is_here and Path("/run/systemd/system").is_dir()


def here(root: Path) -> Place:
    """The environment of this process, installed into a file system."""
    return Place(root, Path(sysconfig.get_path("scripts")))


@dataclass(frozen=True, slots=True)
class Layout:
    """Where one kind of installation puts its files.

    Attributes:
        units: Units of systemd.
        networks: Files of systemd-networkd.
        users: Files of systemd-sysusers.
        folders: Files of systemd-tmpfiles.
        rules: Rules of udev.
        catalog: Explanations for `journalctl -x`.
        share: Pages of the manual, completion, monitoring.
    """

    units: PurePosixPath
    networks: PurePosixPath
    users: PurePosixPath
    folders: PurePosixPath
    rules: PurePosixPath
    catalog: PurePosixPath
    share: PurePosixPath


LOCAL = Layout(
    units=PurePosixPath("/usr/local/lib/systemd/system"),
    networks=PurePosixPath("/etc/systemd/network"),
    users=PurePosixPath("/etc/sysusers.d"),
    folders=PurePosixPath("/etc/tmpfiles.d"),
    rules=PurePosixPath("/etc/udev/rules.d"),
    catalog=PurePosixPath("/usr/local/lib/systemd/catalog"),
    share=PurePosixPath("/usr/local/share"),
)
"""The layout for an installation by an administrator. Units are not in `/etc`, where they would
conflict with the administrator's own units and with the links of `systemctl mask`."""

DISTRIBUTION = Layout(
    units=PurePosixPath("/lib/systemd/system"),
    networks=PurePosixPath("/lib/systemd/network"),
    users=PurePosixPath("/usr/lib/sysusers.d"),
    folders=PurePosixPath("/usr/lib/tmpfiles.d"),
    rules=PurePosixPath("/lib/udev/rules.d"),
    catalog=PurePosixPath("/usr/lib/systemd/catalog"),
    share=PurePosixPath("/usr/share"),
)
"""The layout for a package of a distribution."""


def _word(program: Path) -> bytes:
    """A program as the first word of a command in a unit, see systemd.service(5)."""
    text = str(program).replace("%", "%%")
    return (f'"{text}"' if " " in text else text).encode()


def files(layout: Layout, program: Path) -> dict[PurePosixPath, bytes]:
    """The content of all files by their path.

    Args:
        layout: Where they go.
        program: The path of `ecatd`, for the units.
    """
    systemd = _folder() / "systemd"
    placed = {}
    for folder, names in (
        (layout.units, UNITS),
        (layout.networks, ("10-ecatd.network",)),
        (layout.rules, ("85-ecatd.rules",)),
        (layout.catalog, ("ecatd.catalog",)),
    ):
        for name in names:
            data = (systemd / name).read_bytes()
            placed[folder / name] = data.replace(_PROGRAM, _word(program))
    placed[layout.users / "ecatd.conf"] = (systemd / "ecatd.sysusers.conf").read_bytes()
    placed[layout.folders / "ecatd.conf"] = (systemd / "ecatd.tmpfiles.conf").read_bytes()
    placed[layout.share / "doc/ecatd/ecat0.toml"] = example()
    for name in ("share", "monitoring"):
        target = layout.share if name == "share" else layout.share / "ecatd/monitoring"
        for path, data in _tree(_folder() / name):
            placed[target / path] = data
    return placed


def example() -> bytes:
    """The commented configuration."""
    return (_folder() / "systemd/ecat0.toml").read_bytes()


def _folder() -> Traversable:
    return resources.files("ecatd") / "_system"


def _tree(folder: Traversable) -> Iterator[tuple[PurePosixPath, bytes]]:
    for item in sorted(folder.iterdir(), key=lambda item: item.name):
        if item.is_dir():
            yield from ((PurePosixPath(item.name) / path, data) for path, data in _tree(item))
        else:
            yield PurePosixPath(item.name), item.read_bytes()

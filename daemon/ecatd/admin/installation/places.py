"""Which file goes where, and what the service leaves in a system."""

from __future__ import annotations

import re
import sysconfig
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path, PurePosixPath

from ecatd.base.bus_name import BUS_NAME
from ecatd.linux.systemd_services import service

from .actions import Action, remove

PROGRAMS = ("ecatd", "ecatctl", "ecatsim")
PACKAGED = Path("/usr/lib/ecatd/bin")
"""Where the Debian package has the programs."""
CONFIGURATION = PurePosixPath("/etc/ecatd")
STATE = PurePosixPath("/var/lib/ecatd")
LOGS = PurePosixPath("/var/log/ecatd")
SOCKETS = PurePosixPath("/run/ecatd")
WEB = PurePosixPath("/run/ecatd-web")
WEB_OPTIONS = PurePosixPath("/etc/default/ecatd-web")
MEMORY = PurePosixPath("/dev/shm/ecat")
ADMINISTRATION = PurePosixPath("/etc/systemd/system")
"""Where systemd keeps which units are enabled or masked, and changes of the administrator."""

_FOLDERS = {
    # by an administrator; by a package of a distribution
    "units": ("/usr/local/lib/systemd/system", "/lib/systemd/system"),
    "catalog": ("/usr/local/lib/systemd/catalog", "/usr/lib/systemd/catalog"),
    "network": ("/etc/systemd/network", "/lib/systemd/network"),
    "sysusers": ("/etc/sysusers.d", "/usr/lib/sysusers.d"),
    "tmpfiles": ("/etc/tmpfiles.d", "/usr/lib/tmpfiles.d"),
    "rules": ("/etc/udev/rules.d", "/lib/udev/rules.d"),
    "share": ("/usr/local/share", "/usr/share"),
}
"""The folders of systemd, of udev and for data. An administrator's units are not in `/etc`, where
they would conflict with other units and with the links of `systemctl mask`."""
LOCAL, DISTRIBUTION = (
    {name: PurePosixPath(both[who]) for name, both in _FOLDERS.items()} for who in (0, 1)
)
"""The folders for an installation by an administrator, and for a package of a distribution."""

_FILES = {
    "systemd/ecatd.service": "units/",
    "systemd/ecatd@.service": "units/",
    "systemd/ecatd-gateway.service": "units/",
    "systemd/ecatd-gateway@.service": "units/",
    "systemd/ecatd-web.service": "units/",
    "systemd/ecatd-ros@.service": "units/",
    "systemd/10-ecatd.network": "network/",
    "systemd/85-ecatd.rules": "rules/",
    "systemd/ecatd.catalog": "catalog/",
    "systemd/ecatd.sysusers.conf": "sysusers/ecatd.conf",
    "systemd/ecatd.tmpfiles.conf": "tmpfiles/ecatd.conf",
    "systemd/ecat0.toml": "share/doc/ecatd/",
    "monitoring": "share/ecatd/monitoring",
    "share": "share",
}
"""The files and folders of the wheel in `ecatd/_system`, with the place of each. A file keeps its
name in a place that ends with a slash."""
_BIN = "/usr/local/bin"
"""The folder of the programs in the units of the repository."""
_OF_BUSES = re.compile(r"ecatd(@.+)?\.service")
_STARTED = re.compile(r"ecatd(-web|(-ros)?@.+)?\.service")


@dataclass(frozen=True, slots=True)
class Place:
    """Where to install.

    Attributes:
        root: The file system, `/` or the folder of an image. Commands are run only in `/`.
        programs: The folder with the program `ecatd` of this environment.
    """

    root: Path
    programs: Path

    def at(self, path: PurePosixPath | str) -> Path:
        """A path of the system, in the file system."""
        return self.root / PurePosixPath(path).relative_to("/")

    def seen(self, file: Path) -> str:
        """The path of a file as the system sees it."""
        return str(PurePosixPath("/") / file.relative_to(self.root))

    def holds(self, file: Path) -> bool:
        """Whether no link among the folders above a file leads out of the file system."""
        return file.parent.resolve().is_relative_to(self.root)

    def action(
        self, verb: str, file: Path, why: str = "", effect: Callable[[], object] | None = None
    ) -> Action:
        """An action on a file."""
        return Action(verb, self.seen(file), why, effect, file)

    def keep(self, file: Path, why: str) -> Action:
        """The action that leaves a file alone."""
        return self.action("keep", file, why)

    def remove(self, file: Path, why: str = "") -> Action:
        """The action that removes a file, a link, or a folder with its content."""
        return self.action("remove", file, why, partial(remove, file))

    def remove_or_keep(self, file: Path, what: str, *, purge: bool) -> Action:
        """The action on a file or folder that only a purge removes."""
        return self.remove(file, what) if purge else self.keep(file, what)

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

    def configured(self) -> list[str]:
        """The buses that have a configuration."""
        names = (file.stem for file in self.at(CONFIGURATION).glob("*.toml"))
        return sorted(name for name in names if BUS_NAME.fullmatch(name))

    def autostart_links(self) -> list[Path]:
        """The links by which systemd starts services of ecatd with the machine."""
        return sorted(
            link
            for link in self.at(ADMINISTRATION).glob("*.*/ecatd*.service")
            if link.parent.suffix in (".wants", ".requires") and _STARTED.fullmatch(link.name)
        )

    def enabled(self) -> set[str]:
        """The services of buses that start with the machine."""
        names = {link.name for link in self.autostart_links() if _OF_BUSES.fullmatch(link.name)}
        return {"ecatd.service" if name == "ecatd@ecat0.service" else name for name in names}

    def is_masked(self, name: str) -> bool:
        """Whether the administrator has forbidden a service to start."""
        link = self.at(ADMINISTRATION / name)
        return link.is_symlink() and link.readlink() == Path("/dev/null")

    def outdated(self) -> Iterator[str]:
        """The running services that were started before the program or their units were written."""
        units = filter(Path.is_file, self.at(LOCAL["units"]).glob("ecatd*.service"))
        changed = max([Path(__file__).stat().st_ctime, *(file.stat().st_mtime for file in units)])
        for socket in sorted(self.at(SOCKETS).glob("*/control")):
            if socket.stat().st_mtime < changed:
                yield unit(socket.parent.name)


def unit(bus: str) -> str:
    """The service of a bus."""
    return f"{service(bus)}.service"


def here(root: Path) -> Place:
    """The environment of this process, installed into a file system."""
    return Place(root, Path(sysconfig.get_path("scripts")))


def files(folders: dict[str, PurePosixPath], program: Path) -> dict[PurePosixPath, bytes]:
    """The content of all files by their path.

    Args:
        folders: Where they go: `LOCAL` or `DISTRIBUTION`.
        program: The path of `ecatd`, for the units.
    """
    placed: dict[PurePosixPath, bytes] = {}
    for source, place in _FILES.items():
        kind, _, rest = place.partition("/")
        target = folders[kind] / rest
        item = _system() / source
        if item.is_dir():
            placed |= {target / path: data for path, data in _tree(item)}
        else:
            path = target / item.name if place.endswith("/") else target
            data = item.read_bytes()
            for name in PROGRAMS:
                data = data.replace(f"{_BIN}/{name}".encode(), _word(program.with_name(name)))
            placed[path] = data
    return placed


def example() -> bytes:
    """The commented configuration."""
    return (_system() / "systemd/ecat0.toml").read_bytes()


def _system() -> Traversable:
    return resources.files("ecatd") / "_system"


def _tree(folder: Traversable) -> Iterator[tuple[PurePosixPath, bytes]]:
    for item in sorted(folder.iterdir(), key=lambda item: item.name):
        if item.is_dir():
            yield from ((PurePosixPath(item.name) / path, data) for path, data in _tree(item))
        else:
            yield PurePosixPath(item.name), item.read_bytes()


def _word(program: Path) -> bytes:
    """A program as the first word of a command in a unit, see systemd.service(5)."""
    text = str(program).replace("%", "%%")
    return (f'"{text}"' if " " in text else text).encode()

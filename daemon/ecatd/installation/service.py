"""Installs, upgrades and removes the service of systemd, and what belongs to it."""

from __future__ import annotations

import hashlib
import itertools
import json
import re
import shutil
import sys
import sysconfig
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from ecatd.model.bus_name import check_bus_name
from ecatd.model.config import load_config
from ecatd.model.errors import EcatError, StateError, UsageError
from ecatd.units import service
from ecatd.version import VERSION

from .places import LOCAL, example, files
from .steps import Link, Remove, RemoveTree, Step, Write, run

PACKAGED = Path("/usr/lib/ecatd/bin")
"""Where the Debian package has the programs."""
PROGRAMS = ("ecatd", "ecatctl", "ecatsim")
CONFIGURATION = PurePosixPath("/etc/ecatd")
_LIST = LOCAL.share / "ecatd/installed.json"
_BIN = PurePosixPath("/usr/local/bin")
_HIDDEN = ("/home", "/root", "/run/user", "/tmp", "/var/tmp")
"""Folders that the service does not see (`ProtectHome=`, `PrivateTmp=`)."""
_INTERFACE_NAME = re.compile(r"(?!\.{1,2}$)[A-Za-z0-9_.:@+-]{1,15}")
_PROGRAM_PATH = re.compile(r"[A-Za-z0-9_./+-]+")
_INTERFACE = re.compile(rb'^interface = "[^"\n]*"', re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Place:
    """Where to install.

    Attributes:
        root: The file system, `/` or the folder of an image. Only in `/` commands are run.
        programs: The folder with the program `ecatd` of this environment.
    """

    root: Path
    programs: Path

    def at(self, path: PurePosixPath) -> Path:
        """A path of the system, in the file system."""
        return self.root / path.relative_to("/")

    @property
    def is_packaged(self) -> bool:
        """Whether a package of the distribution has put all files into place already."""
        return self.programs == PACKAGED

    @property
    def is_running(self) -> bool:
        """Whether systemd runs there, so that it can be told."""
        return self.root == Path("/") and Path("/run/systemd/system").is_dir()


def here(root: Path) -> Place:
    """The environment of this process, installed into a file system."""
    return Place(root, Path(sysconfig.get_path("scripts")))


def install(place: Place, bus: str, interface: str | None) -> Iterator[Step]:
    """The steps that install the service of a bus, or bring what is installed up to date.

    Args:
        place: Where.
        bus: Name of the bus.
        interface: For a configuration that does not exist yet; without it none is written.

    Raises:
        UsageError: The service could not see the program, or a name is not possible.
    """
    check_bus_name(bus)
    if interface is not None and not _INTERFACE_NAME.fullmatch(interface):
        raise UsageError(f"{interface!r} is no name of a network interface: `ip link` lists them")
    if place.is_packaged:
        yield Step("keep", "/usr/lib/ecatd", "the package of the distribution has all other files")
    else:
        _check_visible(place)
        yield from _bring_up_to_date(place)
    yield from _configure(place, bus, interface)
    yield from _tell_system(place)
    if place.is_running:
        yield run("systemctl", "enable", unit(bus), why="it starts with the machine")


def upgrade(place: Place) -> Iterator[Step]:
    """The steps that bring what is installed up to date. A bus that runs goes on as it is.

    Raises:
        UsageError: The service could not see the program.
        StateError: Nothing is installed, or a package of the distribution has installed it.
    """
    _refuse_package(place, "upgrade")
    _check_visible(place)
    if not place.at(_LIST).exists():
        raise StateError("no service is installed: `ecatctl service install` does that")
    yield from _bring_up_to_date(place)
    yield from _tell_system(place)


def uninstall(place: Place, *, purge: bool) -> Iterator[Step]:
    """The steps that stop the services and remove what `install` has written.

    Args:
        place: Where.
        purge: Remove the configuration, the user and the group, too.

    Raises:
        StateError: Nothing is installed, or a package of the distribution has installed it.
    """
    _refuse_package(place, "purge" if purge else "remove")
    installed = _installed(place)
    if not installed and not purge:
        raise StateError("no service is installed, so there is nothing to remove")
    if place.is_running:
        stop = "the drives are stopped, and the slaves go to INIT"
        yield run("systemctl", "disable", "--now", "ecatd.service", why=stop, may_fail=True)
        yield run("systemctl", "stop", "ecatd@*.service", why=stop, may_fail=True)
    for path, digest in installed.items():
        yield from _remove(place, path, digest)
    if installed:
        yield Remove("remove", str(_LIST), "", place.at(_LIST))
    for bus_unit in place.at(LOCAL.units).glob("*.wants/ecatd@*.service"):
        yield Remove("remove", str(_seen(place, bus_unit)), "", bus_unit)
    if purge:
        yield from _purge(place)
    elif place.at(CONFIGURATION).is_dir():
        yield Step("keep", str(CONFIGURATION), "your configuration; --purge removes it")
    yield from _tell_system(place, users=False)


def unit(bus: str) -> str:
    """The service of a bus."""
    return f"{service(bus)}.service"


def running(place: Place) -> list[str]:
    """The services that run, from the sockets of their buses."""
    folder = place.at(PurePosixPath("/run/ecatd"))
    buses = sorted(path.parent.name for path in folder.glob("*/control"))
    return [unit(bus) for bus in buses]


def _refuse_package(place: Place, how: str) -> None:
    if place.is_packaged:
        raise StateError(f"a Debian package has installed ecatd: use `apt {how} ecatd`")


def _check_visible(place: Place) -> None:
    if not _PROGRAM_PATH.fullmatch(str(place.programs)):
        raise UsageError(
            f"ecatd is installed in '{place.programs}': a unit of systemd needs a path of letters, "
            "digits and . _ + - only, such as /opt/ecatd"
        )
    for path in (place.programs, Path(sys.base_prefix).resolve()):
        for folder in _HIDDEN:
            if path.is_relative_to(folder) and place.root == Path("/"):
                raise UsageError(
                    f"ecatd is installed in {path}, which the service cannot see, since it has no "
                    f"access to {folder}: install ecatd into another environment, such as one of "
                    "`sudo python3 -m venv /opt/ecatd`"
                )


def _bring_up_to_date(place: Place) -> Iterator[Step]:
    """The files, the links, and the list of both."""
    before = _installed(place)
    data_of, links = files(LOCAL, place.programs / "ecatd"), _links(place)
    kept = {path for path in data_of if _is_kept(place, path)}
    kept |= {path for path, target in links.items() if not _is_free(place, path, before, target)}
    content = {str(path): _digest(data) for path, data in data_of.items() if path not in kept}
    content |= {str(path): f"link:{to}" for path, to in links.items() if path not in kept}
    listed = {"version": VERSION, "files": content}
    data = json.dumps(listed, indent=1, sort_keys=True).encode() + b"\n"
    if _read(place.at(_LIST)) != data:  # first: what is interrupted can be removed
        yield Write("write", str(_LIST), "what is installed", place.at(_LIST), data)
    for path, wanted in data_of.items():
        if path in kept:
            yield Step("keep", str(path), "yours: a link or a folder, such as of a masked unit")
        else:
            yield from _write(place, path, wanted, before)
    for path, target in links.items():
        if path in kept:
            yield Step("keep", str(path), f"another program, which is not {target}")
        elif place.at(path).is_symlink() and place.at(path).readlink() == target:
            yield Step("keep", str(path), "up to date")
        else:
            yield Link("link", str(path), f"to {target}", place.at(path), target)
    for old, digest in before.items():
        if old not in content:
            yield from _remove(place, old, digest, "this version has no such file")


def _is_kept(place: Place, path: PurePosixPath) -> bool:
    """Whether there is something in the place of a file that must stay.

    Raises:
        StateError: A link among the folders above it leads out of the file system of the image.
    """
    file = place.at(path)
    if not file.parent.resolve().is_relative_to(place.root):
        raise StateError(f"{file.parent} leads out of {place.root}: remove the link")
    return file.is_symlink() or (file.exists() and not file.is_file())


def _write(
    place: Place, path: PurePosixPath, data: bytes, before: Mapping[str, str]
) -> Iterator[Step]:
    file = place.at(path)
    there = _read(file)
    if there == data:
        yield Step("keep", str(path), "up to date")
        return
    if there is not None and _digest(there) != before.get(str(path)):
        copy = file.with_name(file.name + ".before-ecatd")
        for number in itertools.count(2):
            if not copy.exists() and not copy.is_symlink():
                break
            copy = file.with_name(f"{file.name}.before-ecatd-{number}")
        why = "the file below as it was, since somebody else has written it"
        yield Write("write", str(_seen(place, copy)), why, copy, there)
    yield Write("write", str(path), "new" if there is None else "changed", file, data)


def _remove(place: Place, path: str, digest: str, why: str = "") -> Iterator[Step]:
    """Removes what is as it was installed, and nothing else."""
    file = place.at(PurePosixPath(path))
    if file.is_symlink():
        ours = digest == f"link:{file.readlink()}"
    elif not file.exists():
        return
    else:
        ours = _digest(_read(file) or b"") == digest and file.is_file()
    if ours and file.parent.resolve().is_relative_to(place.root):
        yield Remove("remove", path, why, file)
    else:
        yield Step("keep", path, "changed since it was installed: remove it yourself")


def _links(place: Place) -> dict[PurePosixPath, Path]:
    """Links from a folder on everybody's PATH to the programs, if they are elsewhere."""
    if place.programs in (Path("/usr/local/bin"), Path("/usr/bin"), Path("/bin")):
        return {}
    return {_BIN / name: place.programs / name for name in PROGRAMS}


def _is_free(place: Place, path: PurePosixPath, before: Mapping[str, str], target: Path) -> bool:
    """Whether a link can be made: nothing is there, or a link that we have made."""
    link = place.at(path)
    if link.is_symlink():
        return f"link:{link.readlink()}" in (before.get(str(path)), f"link:{target}")
    return not link.exists()


def _configure(place: Place, bus: str, interface: str | None) -> Iterator[Step]:
    path = CONFIGURATION / f"{bus}.toml"
    file = place.at(path)
    if file.is_symlink() and not file.exists():
        yield Step("keep", str(path), f"a link to {file.readlink()}, which does not exist")
    elif file.exists():
        yield Step("keep", str(path), _state(file))
    elif interface is None:
        why = f"--interface IF writes one; {unit(bus)} does not start before it exists"
        yield Step("skip", str(path), why)
    else:
        data = _INTERFACE.sub(b'interface = "' + interface.encode() + b'"', example(), count=1)
        data = data.replace(b'bus = "ecat0"', f'bus = "{bus}"'.encode(), 1)
        yield Write("write", str(path), f"the bus at {interface}", file, data)


def _state(file: Path) -> str:
    try:
        load_config(file)
    except EcatError as error:
        return f"it has a mistake: {error}"
    return "your configuration"


def _tell_system(place: Place, *, users: bool = True) -> Iterator[Step]:
    """Has the parts of the system read the files."""
    if place.root != Path("/"):
        yield Step("skip", "commands of the system", f"{place.root} is not the running system")
        return
    if users and shutil.which("systemd-sysusers"):
        yield run("systemd-sysusers", why="users ecatd, ecatd-gateway, group ecat")
    if not place.is_running:
        yield Step("skip", "systemctl, udevadm", "systemd does not run here")
        return
    yield run("systemctl", "daemon-reload")
    yield run("journalctl", "--update-catalog", why="explanations for journalctl -x")
    yield run("udevadm", "control", "--reload", may_fail=True)
    events = ("--subsystem-match=net", "--subsystem-match=misc")
    yield run("udevadm", "trigger", "--action=change", *events, may_fail=True)


def _purge(place: Place) -> Iterator[Step]:
    folder = place.at(CONFIGURATION)
    if folder.exists() or folder.is_symlink():
        yield RemoveTree("remove", str(CONFIGURATION), "", folder)
    if place.root == Path("/"):
        for user in ("ecatd", "ecatd-gateway"):
            yield run("userdel", user, may_fail=True)
        for group in ("ecat", "ecatd-gateway"):
            yield run("groupdel", group, may_fail=True)


def _installed(place: Place) -> dict[str, str]:
    """The files that are installed, by path, with a digest of their content.

    Raises:
        StateError: The list is damaged.
    """
    data = _read(place.at(_LIST))
    if data is None:
        return {}
    try:
        found = {str(path): str(digest) for path, digest in json.loads(data)["files"].items()}
        for path in found:
            path.encode()
            if not path.startswith("/") or ".." in PurePosixPath(path).parts:
                raise ValueError(path)
        return found
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise StateError(
            f"{_LIST} is damaged, so what is installed is not known: remove it, and install again"
        ) from error


def _read(file: Path) -> bytes | None:
    try:
        return file.read_bytes()
    except OSError:
        return None


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _seen(place: Place, file: Path) -> PurePosixPath:
    """The path of a file as the system sees it."""
    return PurePosixPath("/") / file.relative_to(place.root)

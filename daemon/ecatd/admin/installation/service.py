"""Installs and upgrades the service of systemd, and what belongs to it."""

from __future__ import annotations

import re
import shutil
import stat
import sys
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path, PurePosixPath

from ecatd.base.bus_name import check_bus_name
from ecatd.base.errors import EcatError, StateError, UsageError
from ecatd.config import load_config

from .actions import Action, run, write
from .installed_files import LIST, put
from .places import CONFIGURATION, LOCAL, PROGRAMS, Place, example, files, unit

_BIN = PurePosixPath("/usr/local/bin")
_HIDDEN = ("/home", "/root", "/run/user", "/tmp", "/var/tmp")
"""Folders that the service cannot see (`ProtectHome=`, `PrivateTmp=`)."""
_INTERFACE_NAME = re.compile(r"(?!\.{1,2}$)[A-Za-z0-9_.:@+-]{1,15}")
_INTERFACE = re.compile(rb'^interface = "[^"\n]*"', re.MULTILINE)


def install(place: Place, bus: str, interface: str | None) -> Iterator[Action]:
    """The actions that install the service of a bus, or bring what is installed up to date.

    Args:
        place: Where.
        bus: Name of the bus.
        interface: The interface for a new configuration; without it, none is written.

    Raises:
        UsageError: The service could not see the program, or a name is not valid.
    """
    check_bus_name(bus)
    if interface is not None and not _INTERFACE_NAME.fullmatch(interface):
        raise UsageError(f"{interface!r} is not a network interface: `ip link` lists them")
    if place.is_packaged:
        yield Action(
            "keep", "/usr/lib/ecatd", "the package of the distribution has all other files"
        )
    else:
        _check_visible(place)
        yield from _bring_up_to_date(place)
    yield from _configure(place, bus, interface)
    yield from tell_system(place)
    yield from _release(place, bus, interface)
    if place.is_masked(unit(bus)):
        why = f"it is masked: `systemctl unmask {unit(bus)}`, then install again"
        yield Action("skip", f"systemctl enable {unit(bus)}", why)
    elif place.is_running:
        yield run("systemctl", "enable", unit(bus), why="it starts with the machine")


def upgrade(place: Place) -> Iterator[Action]:
    """The actions that bring what is installed up to date. A bus that runs goes on as it is.

    Raises:
        UsageError: The service could not see the program.
        StateError: Nothing is installed, or a package of the distribution has installed it.
    """
    refuse_package(place, "upgrade")
    _check_visible(place)
    if not place.at(LIST).exists():
        raise StateError("no service is installed: `ecatctl service install` does that")
    yield from _bring_up_to_date(place)
    yield from tell_system(place)


def refuse_package(place: Place, how: str) -> None:
    """Refuses to change what a package has installed: that is up to the tools of the distribution.

    Raises:
        StateError: A package has installed ecatd.
    """
    if place.is_packaged:
        raise StateError(f"a Debian package has installed ecatd: use `apt {how} ecatd`")


def _check_visible(place: Place) -> None:
    programs = str(place.programs)
    if not programs.isprintable() or any(sign in programs for sign in "\"'\\"):
        raise UsageError(
            f"ecatd is installed in {programs!a}: a unit of systemd cannot name a program whose "
            "path has quotes, backslashes or control characters; install ecatd elsewhere, for "
            "example in /opt/ecatd"
        )
    if not place.is_here:
        return
    for what, path in (("ecatd", place.programs), ("the Python of ecatd", Path(sys.base_prefix))):
        for folder in _HIDDEN:
            if path.resolve().is_relative_to(folder):
                raise UsageError(
                    f"{what} is installed in {path}, but the service has no access to {folder}: "
                    "install ecatd into another environment, such as one of `sudo "
                    "/usr/bin/python3 -m venv /opt/ecatd`"
                )
    for file in (place.programs.resolve() / "ecatd", Path(__file__).resolve()):
        check_readable(file)


def check_readable(file: Path) -> None:
    """Refuses a program that only root can read, as after an installation with a umask of 077.

    Raises:
        UsageError: The file, or a folder above it, is closed to other users.
    """
    prefix = Path(sys.prefix).resolve()
    for path in (*reversed(file.parents), file):
        mode = path.stat().st_mode
        wanted = stat.S_IXOTH if stat.S_ISDIR(mode) else stat.S_IROTH
        if not mode & wanted:
            inside = path.is_relative_to(prefix)
            command = f"chmod -R go+rX {prefix}" if inside else f"chmod go+x {path}"
            raise UsageError(
                f"{path} has mode {stat.S_IMODE(mode):04o}, so the users of the service cannot "
                f"read ecatd: `sudo {command}`, or install ecatd into another environment"
            )


def _bring_up_to_date(place: Place) -> Iterator[Action]:
    """Writes the files of the service, and links to the programs where all users find them."""
    wanted: dict[PurePosixPath, bytes | Path] = {**files(LOCAL, place.programs / "ecatd")}
    if place.programs not in (Path("/usr/local/bin"), Path("/usr/bin"), Path("/bin")):
        wanted |= {_BIN / name: place.programs / name for name in PROGRAMS}
    return put(place, wanted)


def _configure(place: Place, bus: str, interface: str | None) -> Iterator[Action]:
    file = place.at(CONFIGURATION / f"{bus}.toml")
    if file.is_symlink() and not file.exists():
        yield place.keep(file, f"a link to {file.readlink()}, which does not exist")
    elif file.exists():
        why = "your configuration"
        try:
            load_config(file)
        except EcatError as error:
            why = f"it has a mistake: {error}"
        yield place.keep(file, why)
    elif interface is None:
        why = f"--interface IF writes it; {unit(bus)} does not start without it"
        yield place.action("skip", file, why)
    else:
        data = _INTERFACE.sub(b'interface = "' + interface.encode() + b'"', example(), count=1)
        data = data.replace(b'bus = "ecat0"', f'bus = "{bus}"'.encode(), 1)
        why = f"the bus at {interface}"
        yield place.action("write", file, why, partial(write, file, data))


def _release(place: Place, bus: str, interface: str | None) -> Iterator[Action]:
    """Takes the interfaces of a bus from NetworkManager.

    It finds the property of the udev rule (NM_UNMANAGED) when an interface appears. An interface
    that it manages already it releases only when it is told so.
    """
    if not place.is_running or not shutil.which("nmcli"):
        return
    names = [interface]
    with suppress(EcatError):
        config = load_config(place.at(CONFIGURATION / f"{bus}.toml"))
        names = [config.interface, config.second_interface]
    for name in filter(None, names):
        why = "NetworkManager leaves it alone at once"
        yield run("nmcli", "device", "set", name, "managed", "no", why=why, may_fail=True)


def tell_system(place: Place, *, users: bool = True) -> Iterator[Action]:
    """Makes the parts of the system read the new files.

    Args:
        place: Where they are.
        users: Make the users and groups that do not exist.
    """
    if not place.is_here:
        yield Action("skip", "commands of the system", f"{place.root} is not the running system")
        return
    if users and shutil.which("systemd-sysusers"):
        yield run("systemd-sysusers", why="users and groups ecat, ecatd and ecatd-…")
    elif users:
        why = (
            "it is not installed: make the users and groups of /etc/sysusers.d/ecatd.conf yourself"
        )
        yield Action("skip", "systemd-sysusers", why)
    if users and shutil.which("systemd-tmpfiles"):
        why = "/dev/shm/ecat, for the shared memory; /run/ecatd-web"
        yield run("systemd-tmpfiles", "--create", "ecatd.conf", why=why)
    if not place.is_running:
        yield Action("skip", "systemctl, udevadm", "systemd does not run here")
        return
    yield run("systemctl", "daemon-reload")
    yield run("journalctl", "--update-catalog", why="explanations for journalctl -x")
    yield run("udevadm", "control", "--reload", may_fail=True)
    events = ("--subsystem-match=net", "--subsystem-match=misc")
    yield run("udevadm", "trigger", "--action=change", *events, may_fail=True)

"""Paths of the sockets of a bus, and of the configuration of machine and user.

Each bus has its own folder for the socket of its bus server. In it is a folder for the sockets of
the gateway, which may run as another user. The folder of a bus is in `/run/ecatd` if the daemon
runs as root. Otherwise it is in `$XDG_RUNTIME_DIR/ecatd`, where `/run/user/UID` stands for a
variable that is not set, or in `/tmp/ecatd-UID` if this user has no such directory.
`$ECATD_RUNTIME_DIR` overrides all of them; the unit of systemd sets it to `/run/ecatd`.
"""

from __future__ import annotations

import grp
import os
import socket
import stat
from contextlib import suppress
from pathlib import Path

from .errors import NotPermittedError, StateError, UsageError
from .files import write_whole
from .namespaces import is_root, real_user

SYSTEM = Path("/run/ecatd")
MACHINE = Path("/etc/ecatd")
DOCTOR_CHANGES = "ecatd-doctor.json"
"""The list of what `ecatctl doctor --fix` has changed, beside the folders of the buses."""

_CONNECT_S = 1.0
_SOCKET_PATH_MAX = 107  # of a Unix socket in Linux
_OWN = "set ECATD_RUNTIME_DIR to a directory of your own"


def user_config(name: str) -> Path:
    """Returns a folder of the user's configuration, such as `~/.config/ecatd/profiles`."""
    base = Path(os.environ.get("XDG_CONFIG_HOME", ""))
    if not base.is_absolute():  # relative paths are ignored (XDG Base Directory Specification)
        base = Path(os.environ.get("HOME", "/nonexistent")) / ".config"
    return base / "ecatd" / name


def profile_folders() -> list[Path]:
    """Returns the folders with device profiles, of the machine and of the user; the first wins."""
    return [MACHINE / "profiles", user_config("profiles")]


def user_dir() -> Path:
    """Returns the folder for the buses of this user's daemons; it may not exist yet."""
    if override := os.environ.get("ECATD_RUNTIME_DIR"):
        return Path(override)
    return _usual_dirs()[0]


def _usual_dirs() -> list[Path]:
    """Returns where daemons of this user have their buses, best first.

    A daemon that was started without the user's session, as by cron, has them in the last one.
    """
    user = real_user()
    if user == 0:
        return [SYSTEM]
    # `su` keeps the variable of the user before.
    session = Path(os.environ.get("XDG_RUNTIME_DIR") or f"/run/user/{user}")
    rest = [Path(f"/tmp/ecatd-{user}")]
    return [session / "ecatd", *rest] if _is_own(session.resolve()) else rest


def _is_own(folder: Path) -> bool:
    """Whether a folder belongs to this user, who alone can write into it."""
    with suppress(OSError):
        found = folder.lstat()
        others = stat.S_IWGRP | stat.S_IWOTH
        if stat.S_ISDIR(found.st_mode) and not found.st_mode & others:
            return found.st_uid == os.geteuid()
    return False


def make_dir(bus: str, folder: Path) -> Path:
    """Returns `folder`; makes it and the folder of a bus in it if they do not exist.

    Args:
        bus: Name of the bus.
        folder: What `user_dir` returns. A process in a namespace of the daemon gets it from the
            service.

    Raises:
        NotPermittedError: A folder cannot be made, or belongs to another user.
        UsageError: Its path is too long for the sockets in it.
    """
    longest = zenoh_socket(folder, bus)
    if (length := len(os.fsencode(longest))) > _SOCKET_PATH_MAX:
        raise UsageError(
            f"{longest} has {length} characters, and Linux allows {_SOCKET_PATH_MAX} for a socket: "
            f"choose a shorter path ($ECATD_RUNTIME_DIR), or a shorter name for the bus"
        )
    for path in (folder, folder / bus):
        try:
            is_new = not path.exists()
            path.mkdir(mode=0o750, exist_ok=True, parents=True)
            owner = path.lstat().st_uid
        except OSError as error:
            raise NotPermittedError(f"cannot make {path}: {error.strerror}; {_OWN}") from error
        if owner != os.geteuid() and path != folder:
            raise NotPermittedError(
                f"{path} belongs to user {owner}, whose ecatd runs this bus, or tries to; stop "
                f"that one first, or give this one another name with --bus"
            )
        if owner not in (os.geteuid(), 0):  # systemd makes it as root
            raise NotPermittedError(f"{path} belongs to user {owner}; {_OWN}")
        # A folder that exists, such as one that systemd has made, keeps its mode and group.
        if is_new and path == folder and is_root():
            path.chmod(0o755)  # for the buses of all users, as systemd makes it
        elif is_new and give_to_group(path):
            path.chmod(0o2750)  # setgid: files made in it belong to the group as well
    return folder


def remove_dir(folder: Path, bus: str) -> None:
    """Removes the empty folders of a bus, and files that a killed gateway has left."""
    if not control_socket(folder, bus).exists():  # else another daemon runs this bus
        remove_zenoh_socket(folder, bus)
    with suppress(OSError):
        gateway_dir(folder, bus).rmdir()
    with suppress(OSError):
        (folder / bus).rmdir()


def give_to_group(target: int | Path) -> bool:
    """Gives a file to the group `ecat`; returns False if this is not root or there is no group."""
    if not is_root():
        return False
    try:
        os.chown(target, -1, grp.getgrnam("ecat").gr_gid)
    except (KeyError, OSError):
        return False
    return True


def search_dirs() -> list[Path]:
    """Returns the folders in which a client looks for a bus: of its user, then of the system.

    In a folder in `/tmp` that is not this user's own, somebody else could invent a bus.
    """
    if override := os.environ.get("ECATD_RUNTIME_DIR"):
        return list(dict.fromkeys((Path(override), SYSTEM)))
    return list(dict.fromkeys((*filter(_is_own, _usual_dirs()), SYSTEM)))


def control_socket(folder: Path, bus: str) -> Path:
    """Returns the path of the socket between gateway and bus server."""
    return folder / bus / "control"


def gateway_dir(folder: Path, bus: str) -> Path:
    """Returns the folder of the gateway's sockets; the gateway or systemd makes it."""
    return folder / bus / "gateway"


def zenoh_socket(folder: Path, bus: str) -> Path:
    """Returns the path of the socket on which the gateway serves Zenoh clients of this machine."""
    return gateway_dir(folder, bus) / "zenoh"


def remove_zenoh_socket(folder: Path, bus: str) -> None:
    """Removes the socket of `zenoh_socket`, its lock file, and the file of `write_host`."""
    path = zenoh_socket(folder, bus)
    for file in (path, path.with_name(f"{path.name}.lock"), _host_file(folder, bus)):
        with suppress(OSError):
            file.unlink()


def _host_file(folder: Path, bus: str) -> Path:
    return gateway_dir(folder, bus) / "host"


def write_host(folder: Path, bus: str, host: str) -> None:
    """Writes, for clients of this machine, the name of the machine in the keys of a bus.

    Args:
        folder: The folder with the folder of the bus.
        bus: Name of the bus.
        host: The name of the machine; if it is empty, nothing is written.

    Raises:
        StateError: The file cannot be written.
    """
    path = _host_file(folder, bus)
    try:
        if host:
            write_whole(path, host.encode(), ".host")
            path.chmod(0o644)  # the folder says who may read it
    except OSError as error:
        raise StateError(f"cannot write {path}: {error.strerror}") from error


def read_host(folder: Path, bus: str) -> str:
    """Returns the name of the machine in the keys of a bus; empty if they have none."""
    try:
        return _host_file(folder, bus).read_text()
    except OSError:
        return ""


def takes_connections(bus: str) -> bool:
    """Whether a gateway takes connections on this machine, as far as this user can see."""
    for folder in search_dirs():
        with socket.socket(socket.AF_UNIX) as there, suppress(OSError):
            there.settimeout(_CONNECT_S)
            try:
                there.connect(str(zenoh_socket(folder, bus)))
            except (PermissionError, TimeoutError):  # it listens, but not for us, or it hangs
                return True
            return True
    return False


def closed_buses(folder: Path) -> list[str]:
    """Returns the buses in whose folders this user may not look."""
    with suppress(OSError):
        return [
            path.name
            for path in folder.iterdir()
            if path.is_dir() and not os.access(path, os.R_OK | os.X_OK)
        ]
    return []


def served_buses(folder: Path) -> list[str]:
    """Returns the buses whose gateways serve Zenoh clients of this machine."""
    return sorted(path.parents[1].name for path in folder.glob(str(zenoh_socket(Path(), "*"))))

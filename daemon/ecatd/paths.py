"""Paths of the sockets of a bus, and of the configuration of machine and user.

Each bus has a folder of its own for the socket of its bus server, and in it one for the sockets of
its gateway, which may have another user. A daemon that runs as root has it in `/run/ecatd`,
one of an ordinary user in `$XDG_RUNTIME_DIR/ecatd`, or in `/tmp/ecatd-UID` if that variable is not
set. `$ECATD_RUNTIME_DIR` overrides all of them; the unit of systemd sets it to `/run/ecatd`.
"""

from __future__ import annotations

import grp
import os
from contextlib import suppress
from pathlib import Path

from .model.atomic_write import write_whole
from .model.errors import NotPermittedError, StateError, UsageError

SYSTEM = Path("/run/ecatd")
MACHINE = Path("/etc/ecatd")

_SOCKET_PATH_MAX = 107  # of a Unix socket in Linux
_OWN = "set ECATD_RUNTIME_DIR to a directory of your own"


def user_config(name: str) -> Path:
    """A folder of the user's configuration, such as `~/.config/ecatd/profiles`."""
    base = Path(os.environ.get("XDG_CONFIG_HOME", ""))
    if not base.is_absolute():  # relative paths are ignored (XDG Base Directory Specification)
        base = Path(os.environ.get("HOME", "/nonexistent")) / ".config"
    return base / "ecatd" / name


def profile_folders() -> list[Path]:
    """Folders with device profiles of the machine and of the user; the first one wins."""
    return [MACHINE / "profiles", user_config("profiles")]


def user_dir() -> Path:
    """The folder for the buses of this process; it may not exist yet."""
    if override := os.environ.get("ECATD_RUNTIME_DIR"):
        return Path(override)
    if os.geteuid() == 0:
        return SYSTEM
    if session := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(session) / "ecatd"
    return Path(f"/tmp/ecatd-{os.geteuid()}")


def make_dir(bus: str) -> Path:
    """Returns `user_dir()` with a folder for a bus, which is made if it does not exist.

    Raises:
        NotPermittedError: A folder cannot be made, or belongs to another user.
        UsageError: Its path is too long for the sockets in it.
    """
    folder = user_dir()
    longest = zenoh_socket(folder, bus)
    if (length := len(os.fsencode(longest))) > _SOCKET_PATH_MAX:
        raise UsageError(
            f"{longest} has {length} characters, and Linux allows {_SOCKET_PATH_MAX} for a socket: "
            f"choose a shorter path ($ECATD_RUNTIME_DIR), or a shorter name for the bus"
        )
    for path in (folder, folder / bus):
        is_new = not path.exists()
        try:
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
        # What is there already, such as a folder that systemd has made, stays as it is.
        if is_new and path == folder and os.geteuid() == 0:
            path.chmod(0o755)  # for the buses of all users, as systemd makes it
        elif is_new and give_to_group(path):
            path.chmod(0o2750)  # setgid: files made in it belong to the group as well
    return folder


def remove_dir(folder: Path, bus: str) -> None:
    """Removes the folders of a bus that are empty, and what a killed gateway has left."""
    if not control_socket(folder, bus).exists():  # which another daemon of this bus would have
        remove_zenoh_socket(folder, bus)
    with suppress(OSError):
        gateway_dir(folder, bus).rmdir()
    with suppress(OSError):
        (folder / bus).rmdir()


def give_to_group(target: int | Path) -> bool:
    """Gives a file to the group `ecat`, if this is root and the group exists; returns whether."""
    if os.geteuid() != 0:
        return False
    try:
        os.chown(target, -1, grp.getgrnam("ecat").gr_gid)
    except (KeyError, OSError):
        return False
    return True


def search_dirs() -> list[Path]:
    """Where a client looks for the folder of a bus: with its user first, then with the system."""
    return list(dict.fromkeys((user_dir(), SYSTEM)))


def control_socket(folder: Path, bus: str) -> Path:
    """Path of the socket between gateway and bus server."""
    return folder / bus / "control"


def gateway_dir(folder: Path, bus: str) -> Path:
    """The folder of the gateway's sockets: the gateway makes it, or systemd for it."""
    return folder / bus / "gateway"


def zenoh_socket(folder: Path, bus: str) -> Path:
    """Path of the socket on which the gateway serves Zenoh clients of this machine."""
    return gateway_dir(folder, bus) / "zenoh"


def remove_zenoh_socket(folder: Path, bus: str) -> None:
    """Removes the socket of `zenoh_socket`, the lock that Zenoh leaves beside it, and the host."""
    path = zenoh_socket(folder, bus)
    for file in (path, path.with_name(f"{path.name}.lock"), _host_file(folder, bus)):
        with suppress(OSError):
            file.unlink()


def _host_file(folder: Path, bus: str) -> Path:
    return gateway_dir(folder, bus) / "host"


def write_host(folder: Path, bus: str, host: str) -> None:
    """Tells clients of this machine the name of the machine in the keys of a bus; empty: none.

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
    """The name of the machine in the keys of a bus; empty: none."""
    try:
        return _host_file(folder, bus).read_text()
    except OSError:
        return ""


def served_buses(folder: Path) -> list[str]:
    """The buses whose gateways serve Zenoh clients of this machine."""
    return sorted(path.parents[1].name for path in folder.glob(str(zenoh_socket(Path(), "*"))))

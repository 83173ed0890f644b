"""Paths of the sockets of a bus, and of the configuration of machine and user.

A daemon that runs as root keeps its sockets in `/run/ecatd`, one of an ordinary user in
`$XDG_RUNTIME_DIR/ecatd`, or in `/tmp/ecatd-UID` if that variable is not set. `$ECATD_RUNTIME_DIR`
overrides all of them; the unit of systemd sets it to `/run/ecatd`.
"""

from __future__ import annotations

import grp
import os
from pathlib import Path

from .model.errors import NotPermittedError

SYSTEM = Path("/run/ecatd")
MACHINE = Path("/etc/ecatd")

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
    """The directory for the sockets of this process; it may not exist yet."""
    if override := os.environ.get("ECATD_RUNTIME_DIR"):
        return Path(override)
    if os.geteuid() == 0:
        return SYSTEM
    if session := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(session) / "ecatd"
    return Path(f"/tmp/ecatd-{os.geteuid()}")


def make_dir() -> Path:
    """Returns `user_dir()`, and makes the directory if it does not exist.

    Raises:
        NotPermittedError: The directory cannot be made, or belongs to another user.
    """
    folder = user_dir()
    try:
        folder.mkdir(mode=0o750, exist_ok=True, parents=True)
        owner = folder.lstat().st_uid
    except OSError as error:
        raise NotPermittedError(f"cannot make {folder}: {error.strerror}; {_OWN}") from error
    if owner != os.geteuid():
        raise NotPermittedError(f"{folder} belongs to user {owner}; {_OWN}")
    if give_to_group(folder):
        folder.chmod(0o2750)  # setgid: files made in it belong to the group as well
    return folder


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
    """Folders in which a client looks for a daemon: that of its user first, then the system's."""
    return list(dict.fromkeys((user_dir(), SYSTEM)))


def control_socket(folder: Path, bus: str) -> Path:
    """Path of the socket between gateway and bus server."""
    return folder / f"{bus}.control"


def zenoh_socket(folder: Path, bus: str) -> Path:
    """Path of the socket on which the gateway serves Zenoh clients of this machine."""
    return folder / f"{bus}.zenoh"

"""Where the sockets of a bus are, and the files of machine and user.

A daemon of the system (root, systemd) keeps them in `/run/ecatd`, one of an ordinary user in
`$XDG_RUNTIME_DIR/ecatd`, or in `/tmp/ecatd-UID` where there is no such directory.
`$ECATD_RUNTIME_DIR` overrides all of them.
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
    if not base.is_absolute():  # is to be ignored (XDG Base Directory Specification)
        base = Path(os.environ.get("HOME", "/nonexistent")) / ".config"
    return base / "ecatd" / name


def profile_folders() -> list[Path]:
    """Where device profiles of the machine and of the user are, the first one wins."""
    return [MACHINE / "profiles", user_config("profiles")]


def user_dir() -> Path:
    """The directory in which this process would make its sockets."""
    if override := os.environ.get("ECATD_RUNTIME_DIR"):
        return Path(override)
    if os.geteuid() == 0:
        return SYSTEM
    if session := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(session) / "ecatd"
    return Path(f"/tmp/ecatd-{os.geteuid()}")


def make_dir() -> Path:
    """The same directory, made if need be.

    Raises:
        NotPermittedError: It cannot be made, or belongs to somebody else.
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
        folder.chmod(0o2750)  # what is made in it belongs to the group, too
    return folder


def give_to_group(target: int | Path) -> bool:
    """Lets the members of the group `ecat` in, where there is such a group and root decides."""
    if os.geteuid() != 0:
        return False
    try:
        os.chown(target, -1, grp.getgrnam("ecat").gr_gid)
    except (KeyError, OSError):
        return False
    return True


def search_dirs() -> list[Path]:
    """Where a client looks for a daemon: its own user's first, then the system's."""
    return list(dict.fromkeys((user_dir(), SYSTEM)))


def control_socket(folder: Path, bus: str) -> Path:
    """Socket between gateway and bus server."""
    return folder / f"{bus}.control"


def zenoh_socket(folder: Path, bus: str) -> Path:
    """Socket on which the gateway speaks Zenoh with this machine's users."""
    return folder / f"{bus}.zenoh"

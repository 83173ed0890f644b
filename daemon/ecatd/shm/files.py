"""The files of the shared memory of a bus: in which folder they are, and opening them.

A daemon of root or of the user `ecatd` has them in `/dev/shm/ecat`, one of another user in
`/dev/shm/ecat-UID`; if somebody else has taken this name, in `/run/user/UID/ecat`. Only the owner
can write into these folders, so nobody else can take the name of a bus. `client_c/src/files.c`
knows the folders and decides whom a client believes; this module asks it, and makes the folder of
a daemon.
"""

from __future__ import annotations

import ctypes
import os
import pwd
import shutil
import stat
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ecatd.base.errors import EcatError, NotPermittedError, StateError, UsageError
from ecatd.base.file_locks import held
from ecatd.base.namespaces import is_root
from ecatd.linux.systemd_services import service

from . import contract as shm

MEMORY = Path("/dev/shm")
"""The file system of all shared memory."""
MACHINE = MEMORY / "ecat"
"""The folder of root and of the service."""
SERVICE_USER = "ecatd"

_PATH, _TEXT = 64, 512  # ECAT_SHM_PATH, ECAT_SHM_TEXT
_DOWN, _DENIED = shm.Errno.EDOWN, shm.Errno.EPERM
_ERRORS: dict[int, type[EcatError]] = {
    shm.Errno.EARG: UsageError,
    shm.Errno.EPERM: NotPermittedError,
    shm.Errno.ELAYOUT: StateError,
}
_TRIES = 5  # to make a folder, while others make and remove things of its name

_find, _open, _folder = (
    getattr(shm.LIBRARY, f"ecat_shm_{name}") for name in ("find", "open", "folder")
)


def folders() -> list[Path]:
    """Returns the folders in which this process looks for a bus.

    The first is that of its own user, in which its daemon makes files, and the second, if this is
    an ordinary user, is where it makes them if somebody else has taken the name of the first. Then
    come that of the user in `ECAT_TRUSTED_OWNER`, if it is set, and that of the machine.
    """
    found: list[Path] = []
    path = ctypes.create_string_buffer(_PATH)
    while _folder(len(found), path) == 0:
        found.append(Path(os.fsdecode(path.value)))
    return found


def find(bus: str) -> tuple[int, Path]:
    """Opens the shared memory of a bus to read it: of a living daemon, else a leftover.

    Returns:
        File descriptor, and the path of the file.

    Raises:
        FileNotFoundError: There is none.
        PermissionError: This user may not read it.
        EcatError: It belongs to a user who is not trusted, or cannot be opened for another reason.
    """
    folder, text = ctypes.create_string_buffer(_PATH), ctypes.create_string_buffer(_TEXT)
    fd = _checked(_find(bus.encode(), folder, text), text)
    return fd, Path(os.fsdecode(folder.value), bus)


def open_out(path: Path) -> int:
    """Opens the `.out` file beside the shared memory at `path` to read it; raises as `find`."""
    text = ctypes.create_string_buffer(_TEXT)
    name = f"{path.name}.out".encode()
    return _checked(_open(os.fsencode(path.parent), name, 0, text), text)


def _checked(result: int, text: ctypes.Array[ctypes.c_char]) -> int:
    if result >= 0:
        return result
    if result == _DOWN:
        raise FileNotFoundError
    if result == _DENIED and not text.value:
        raise PermissionError
    raise _ERRORS.get(result, EcatError)(text.value.decode("utf-8", "replace"))


def buses() -> list[str]:
    """Names of the buses with shared memory on this machine, that of killed daemons included."""
    found: set[str] = set()
    for folder in folders():
        with suppress(OSError):
            found |= {path.stem for path in folder.glob("*.out")}
    return sorted(found)


def exists(bus: str) -> bool:
    """Whether there is shared memory of a bus, even if it is left over from a killed daemon."""
    # A folder of another user says nothing, and `Path.exists` would raise.
    return any(os.path.exists(folder / bus) for folder in folders())  # noqa: PTH110


def problem(folder: Path) -> str:
    """Returns why clients do not believe what lies in a folder; empty if they do."""
    text = ctypes.create_string_buffer(_TEXT)
    try:
        os.close(_checked(_open(os.fsencode(folder), b"?", 0, text), text))  # no bus has this name
    except OSError:
        return ""
    except EcatError as error:
        return str(error)
    return ""


def may_own(user: int) -> bool:
    """Whether a daemon of this machine, or of this user, can have made a file of this user's."""
    return user in (0, os.geteuid(), _service_user())


def make_folder(tell: Callable[[str], None]) -> Path:
    """Returns the folder for the shared memory of this user's daemons; makes or mends it.

    Root replaces what somebody else has put in its place. An ordinary user cannot, and goes on in
    the directory of their session.

    Args:
        tell: Called with a sentence, if something is in its place.

    Raises:
        NotPermittedError: Something of another user is in its place, or it cannot be made.
    """
    folder, *others = folders()
    try:
        return _made(folder, tell)
    except NotPermittedError as error:
        if folder == MACHINE or not others[0].parent.is_dir():
            raise
        try:
            found = _made(others[0], tell)
        except NotPermittedError:
            raise error from None
        tell(f"{error}. Until then the shared memory is in {found}, where your programs find it")
        return found


def _made(folder: Path, tell: Callable[[str], None]) -> Path:
    mode = 0o755 if folder == MACHINE else 0o700
    for _ in range(_TRIES):
        try:
            folder.mkdir(mode)
        except FileExistsError:
            if _is_usable(folder, mode):
                return folder
            _put_aside(folder, tell)
        except OSError as error:
            raise NotPermittedError(f"cannot make {folder}: {error.strerror}") from error
        else:
            folder.chmod(mode)  # whatever the umask is
            _give_to_service(folder)
            return folder
    raise NotPermittedError(f"cannot make {folder}: others put something there again and again")


def _is_usable(folder: Path, mode: int) -> bool:
    """Whether a folder belongs to whom it should; then it gets its mode."""
    found = folder.lstat()
    is_ours = may_own(found.st_uid) if folder == MACHINE else found.st_uid == os.geteuid()
    if not stat.S_ISDIR(found.st_mode) or not is_ours:
        return False
    if is_root():
        _give_to_service(folder)
    elif found.st_uid != os.geteuid():
        raise NotPermittedError(
            f"{folder} belongs to root, and this user cannot make files in it: "
            f"'sudo systemd-tmpfiles --create ecatd.conf', or 'sudo chown {SERVICE_USER} {folder}'"
        )
    if stat.S_IMODE(found.st_mode) != mode:
        folder.chmod(mode)
    for name in os.listxattr(folder):
        if name.startswith("system.posix_acl"):  # rights of more users, also to new files in it
            os.removexattr(folder, name)
    return True


def _put_aside(folder: Path, tell: Callable[[str], None]) -> None:
    """Removes what is in the place of the folder; raises `NotPermittedError` without rights."""
    found = folder.lstat()
    is_folder = stat.S_ISDIR(found.st_mode)
    kind = "" if is_folder else "is no directory and "
    what = f"{folder} {kind}belongs to user {_named(found.st_uid)}"
    refused = NotPermittedError(
        f"{what}: what is in it, or comes into it, cannot be trusted. Have root remove it "
        f"('sudo rm -r {folder}'), then start again"
    )
    if not is_root() and found.st_uid != os.geteuid():
        raise refused
    aside = folder.with_name(f".{folder.name}-{os.getpid()}-{os.urandom(4).hex()}")
    try:
        folder.rename(aside)
        if is_folder:
            shutil.rmtree(aside, ignore_errors=True)  # does not follow links
        else:
            aside.unlink()
    except OSError as error:
        raise refused from error
    tell(f"{what}: ecatd has removed it, and makes the directory anew")


def _give_to_service(folder: Path) -> None:
    """Root gives the folder to the user of the service, who has to make files in it, too."""
    if folder == MACHINE and is_root() and (service := _service_user()) is not None:
        with suppress(OSError):  # in a container without that user
            os.chown(folder, service, -1, follow_symlinks=False)


def _service_user() -> int | None:
    try:
        return pwd.getpwnam(SERVICE_USER).pw_uid
    except KeyError:
        return None


def _named(user: int) -> str:
    try:
        return f"{user} ({pwd.getpwuid(user).pw_name})"
    except KeyError:
        return str(user)


def check_free(bus: str) -> None:
    """Checks that no daemon serves a bus, as far as this user may open its shared memory.

    Raises:
        StateError: A daemon serves it.
    """
    try:
        fd, _ = find(bus)
    except (OSError, NotPermittedError, StateError):
        return  # there is none, or it is of somebody who is not believed
    try:
        if held(fd, shm.LOCK_DAEMON):
            raise already_served(bus, fd)
    finally:
        os.close(fd)


def already_served(bus: str, fd: int) -> StateError:
    """Returns the error for a bus that another daemon serves.

    Args:
        bus: Name of the bus.
        fd: File descriptor of its shared memory.
    """
    header = os.pread(fd, shm.size("ecat_shm_header"), 0)
    pid = ""  # unknown while that daemon is still starting
    if len(header) == shm.size("ecat_shm_header"):
        pid = f" (pid {shm.struct('ecat_shm_header').from_buffer_copy(header).pid})"
    return StateError(
        f"another ecatd{pid} already runs bus '{bus}'; stop it first ('systemctl stop "
        f"{service(bus)}' if it is the service), or give this bus another name with --bus"
    )

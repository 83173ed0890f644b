"""The actions of an installation. Each can say what it would do."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ecatd.base.errors import NotPermittedError, StateError
from ecatd.base.files import write_whole


@dataclass(frozen=True, slots=True)
class Action:
    """One action.

    Attributes:
        verb: What it does: `save`, `write`, `remove`, `restore`, `link`, `run`, `keep` or `skip`.
        what: The file as the system sees it, or the command.
        why: Why, or empty.
        effect: Does it; None if there is nothing to do.
        file: The file that it changes.
    """

    verb: str
    what: str
    why: str = ""
    effect: Callable[[], object] | None = None
    file: Path = Path()

    def do(self) -> None:
        """Does it.

        Raises:
            EcatError: The action fails.
        """
        try:
            if self.effect is not None:
                self.effect()
        except PermissionError as error:
            raise NotPermittedError(
                f"{self.file} cannot be written: {error.strerror}; run it with sudo"
            ) from error
        except OSError as error:
            raise StateError(f"{self.file}: {error.strerror}") from error


def run(*command: str, why: str = "", may_fail: bool = False) -> Action:
    """The action that runs a command. If it may fail, the installation goes on then."""
    return Action("run", shlex.join(command), why, partial(_run, command, may_fail=may_fail))


def _run(command: tuple[str, ...], *, may_fail: bool) -> None:
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        if not may_fail:
            raise StateError(f"{command[0]} cannot be run: {error.strerror}") from error
        return
    if done.returncode and not may_fail:
        said = (done.stderr.strip() or done.stdout.strip()).replace("\n", "; ")
        raise StateError(f"`{shlex.join(command)}` failed: {said}")


def write(file: Path, data: bytes) -> None:
    """Writes a file that all may read, and makes the folders that it needs."""
    _make_folder(file.parent)
    write_whole(file, data, ".ecatd-")
    file.chmod(0o644)


def link(file: Path, target: Path) -> None:
    """Makes a symbolic link, in place of another link."""
    _make_folder(file.parent)
    file.unlink(missing_ok=True)
    file.symlink_to(target)


def copy(file: Path, to: Path) -> None:
    """Copies a file as it is, with its owner and its rights."""
    shutil.copy2(file, to)
    state = file.stat()
    os.chown(to, state.st_uid, state.st_gid)


def remove(file: Path) -> None:
    """Removes a file, a link, or a folder with its content, also what has come meanwhile."""
    if file.is_dir() and not file.is_symlink():
        shutil.rmtree(file)
    else:
        file.unlink(missing_ok=True)


def remove_empty(folder: Path) -> None:
    """Removes a folder if it is empty."""
    with suppress(OSError):
        folder.rmdir()


def _make_folder(folder: Path) -> None:
    """Makes a folder and those above it, readable for all whatever the umask is."""
    if not folder.exists():
        _make_folder(folder.parent)
        folder.mkdir()
        folder.chmod(0o755)

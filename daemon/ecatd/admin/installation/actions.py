"""The actions of an installation. Each can say what it would do."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ecatd.base.atomic_write import write_whole
from ecatd.base.errors import NotPermittedError, StateError


@dataclass(frozen=True, slots=True)
class Action:
    """One action. This class does nothing.

    Attributes:
        verb: What it does: `save`, `write`, `remove`, `restore`, `link`, `run`, `keep` or `skip`.
        what: The file or the command.
        why: Why, or empty.
    """

    verb: str
    what: str
    why: str = ""

    def do(self) -> None:
        """Does it.

        Raises:
            EcatError: The action fails.
        """


@dataclass(frozen=True, slots=True)
class Write(Action):
    """Writes a file, and makes the folders that it needs."""

    path: Path = Path()
    data: bytes = b""

    def do(self) -> None:
        """Writes it, readable for all."""
        with _Refusals(self.path):
            _make_folder(self.path.parent)
            write_whole(self.path, self.data, ".ecatd-")
            self.path.chmod(0o644)


@dataclass(frozen=True, slots=True)
class Link(Action):
    """Makes a symbolic link, in place of another link."""

    path: Path = Path()
    target: Path = Path()

    def do(self) -> None:
        """Makes it."""
        with _Refusals(self.path):
            _make_folder(self.path.parent)
            self.path.unlink(missing_ok=True)
            self.path.symlink_to(self.target)


@dataclass(frozen=True, slots=True)
class Save(Action):
    """Copies a file as it is, with its owner and its rights."""

    path: Path = Path()
    copy: Path = Path()

    def do(self) -> None:
        """Copies it."""
        with _Refusals(self.copy):
            shutil.copy2(self.path, self.copy)
            state = self.path.stat()
            os.chown(self.copy, state.st_uid, state.st_gid)


@dataclass(frozen=True, slots=True)
class Restore(Action):
    """Moves a copy back to its place."""

    path: Path = Path()
    copy: Path = Path()

    def do(self) -> None:
        """Moves it."""
        with _Refusals(self.path):
            self.copy.replace(self.path)


@dataclass(frozen=True, slots=True)
class Remove(Action):
    """Removes a file or a link."""

    path: Path = Path()

    def do(self) -> None:
        """Removes it."""
        with _Refusals(self.path):
            self.path.unlink(missing_ok=True)


@dataclass(frozen=True, slots=True)
class RemoveFolder(Action):
    """Removes a folder if it is empty."""

    path: Path = Path()

    def do(self) -> None:
        """Removes it."""
        with suppress(OSError):
            self.path.rmdir()


@dataclass(frozen=True, slots=True)
class RemoveTree(Action):
    """Removes a folder with its content, also files that have come meanwhile."""

    path: Path = Path()

    def do(self) -> None:
        """Removes it."""
        with _Refusals(self.path):
            shutil.rmtree(self.path)


@dataclass(frozen=True, slots=True)
class Run(Action):
    """Runs a command of the system.

    Attributes:
        command: The command.
        may_fail: The installation goes on if it fails.
    """

    command: Sequence[str] = ()
    may_fail: bool = False

    def do(self) -> None:
        """Runs it.

        Raises:
            StateError: The command is not there, or fails.
        """
        try:
            done = subprocess.run(self.command, capture_output=True, text=True, check=False)
        except OSError as error:
            if not self.may_fail:
                raise StateError(f"{self.command[0]} cannot be run: {error.strerror}") from error
            return
        if done.returncode and not self.may_fail:
            said = (done.stderr.strip() or done.stdout.strip()).replace("\n", "; ")
            raise StateError(f"`{shlex.join(self.command)}` failed: {said}")


def run(*command: str, why: str = "", may_fail: bool = False) -> Run:
    """The action that runs a command."""
    return Run("run", shlex.join(command), why, command, may_fail)


def _make_folder(folder: Path) -> None:
    """Makes a folder and those above it, readable for all whatever the umask is."""
    if not folder.exists():
        _make_folder(folder.parent)
        folder.mkdir()
        folder.chmod(0o755)


class _Refusals:
    """Turns errors of the file system into those of the command line."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> None:
        pass

    def __exit__(self, _kind: object, error: object, _traceback: object) -> None:
        if isinstance(error, PermissionError):
            raise NotPermittedError(
                f"{self._path} cannot be written: {error.strerror}; run it with sudo"
            ) from error
        if isinstance(error, OSError):
            raise StateError(f"{self._path}: {error.strerror}") from error

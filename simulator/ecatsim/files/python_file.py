"""Loads Python files of users and reports their errors with file and line."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from ecatd.base.errors import ConfigError, EcatError, UsageError

T = TypeVar("T")

_loaded: dict[Path, ModuleType] = {}
_names: dict[str, Path] = {}
"""The path as the user wrote it, by the file name in code objects."""


def load(path: Path) -> ModuleType:
    """Loads a file as a module, once; it may import files beside it.

    Raises:
        ConfigError: There is no such file, or an error occurs in it.
    """
    try:
        found = path.is_file()
    except OSError as error:  # for example, a name that is too long
        raise ConfigError(f"'{path}' cannot be read: {error.strerror}") from error
    if not found:
        raise ConfigError(f"there is no file '{path}'")
    place = path.resolve()
    if place in _loaded:
        return _loaded[place]
    spec = importlib.util.spec_from_file_location(f"ecatsim_file_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    _names[str(spec.origin)] = path
    module = importlib.util.module_from_spec(spec)
    folder = str(place.parent)
    if folder not in sys.path:
        sys.path.insert(0, folder)
    loader = spec.loader
    explained(path, lambda: loader.exec_module(module))
    _loaded[place] = module
    return module


def get(path: Path, name: str) -> Any:
    """Returns the object that a file defines by a name.

    Raises:
        ConfigError: As for `load`, or the file does not define the name.
    """
    module = load(path)
    if not hasattr(module, name):
        raise ConfigError(f"{path}: the file does not define '{name}'")
    return getattr(module, name)


def explained(path: Path, call: Callable[[], T]) -> T:
    """Calls a function that a file defines.

    Raises:
        ConfigError: The call fails; the message names the line.
    """
    try:
        return call()
    except UsageError:
        raise
    except (Exception, SystemExit) as error:
        raise ConfigError(_words(error), *(_place(error) or (str(path), 0))) from error


def _place(error: BaseException) -> tuple[str, int] | None:
    """Returns file and line of the last place in a user's file that an error passed."""
    found = None
    trace = error.__traceback__
    while trace is not None:
        path = _names.get(trace.tb_frame.f_code.co_filename)
        if path is not None:
            found = str(path), trace.tb_lineno
        trace = trace.tb_next
    if isinstance(error, SyntaxError) and error.filename in _names and error.lineno:
        found = str(_names[error.filename]), error.lineno
    return found


def report(error: Exception) -> str:
    """Describes an error in one line, with its place if that is in a file of the user.

    Returns:
        The line, or "" for an unexpected error elsewhere, which is a defect.
    """
    where = _place(error)
    if isinstance(error, ConfigError) and error.file:
        return str(error)
    text = str(error) if isinstance(error, EcatError) else _words(error) if where else ""
    return str(ConfigError(text, *where)) if where else text


def reply(error: Exception) -> dict[str, Any] | None:
    """The map of an error for programs; None for an unexpected error, which is a defect."""
    text = report(error)
    facts = error.to_reply() if isinstance(error, EcatError) else {"name": EcatError.name}
    return facts | {"message": text} if text else None


def _words(error: BaseException) -> str:
    text = error.msg if isinstance(error, SyntaxError) else str(error)
    return f"{type(error).__name__}: {text}"

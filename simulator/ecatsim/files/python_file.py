"""Python files that a user names: loaded, and their mistakes reported with file and line."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from ecatd.model.errors import ConfigError, UsageError

T = TypeVar("T")

_loaded: dict[Path, ModuleType] = {}


def load(path: Path) -> ModuleType:
    """The module of a file, which may import files beside it; loaded once.

    Raises:
        ConfigError: There is no such file, or it fails.
    """
    try:
        found = path.is_file()
    except OSError as error:  # a name that is too long, for example
        raise ConfigError(f"'{path}' cannot be read: {error.strerror}") from error
    if not found:
        raise ConfigError(f"there is no file '{path}'")
    place = path.resolve()
    if place in _loaded:
        return _loaded[place]
    spec = importlib.util.spec_from_file_location(f"ecatsim_file_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    folder = str(place.parent)
    if folder not in sys.path:
        sys.path.insert(0, folder)
    loader = spec.loader
    explained(path, lambda: loader.exec_module(module))
    _loaded[place] = module
    return module


def get(path: Path, name: str) -> Any:
    """What a file calls by a name.

    Raises:
        ConfigError: As `load`, or it has no such name.
    """
    module = load(path)
    if not hasattr(module, name):
        raise ConfigError(f"{path}: the file does not define '{name}'")
    return getattr(module, name)


def explained(path: Path, call: Callable[[], T]) -> T:
    """Calls what a file defines; its failure names the line.

    Raises:
        ConfigError: It fails.
    """
    try:
        return call()
    except UsageError:
        raise
    except Exception as error:
        line = _last_line(error, path)
        where = f"{path}:{line}" if line else str(path)
        raise ConfigError(f"{where}: {type(error).__name__}: {error}") from error


def _last_line(error: BaseException, path: Path) -> int:
    """The line of the file in which an error came up, 0 if in none."""
    line = error.lineno or 0 if isinstance(error, SyntaxError) else 0
    trace = error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == str(path):
            line = trace.tb_lineno
        trace = trace.tb_next
    return line

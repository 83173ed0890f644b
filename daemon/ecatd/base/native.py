"""Finds and loads the C libraries that are installed inside the packages of this project."""

from __future__ import annotations

import ctypes
import importlib
from pathlib import Path


def load(package: str, name: str) -> ctypes.CDLL:
    """Loads `lib<name>.so` from the folder `_native` of a package.

    A development install keeps Python files and built files in two folders; both are in the
    `__path__` of the package.

    Raises:
        ImportError: The library is not installed; the message says how to build it.
    """
    for folder in importlib.import_module(package).__path__:
        file = Path(folder) / "_native" / f"lib{name}.so"
        if file.exists():
            return ctypes.CDLL(str(file), use_errno=True)
    raise ImportError(
        f"lib{name}.so is not built: install the package (`pip install .`, or `make` in a checkout)"
    )

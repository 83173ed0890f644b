"""Builds the C parts of the benchmarks."""

from __future__ import annotations

import subprocess
from pathlib import Path

from ecatd.base.errors import StateError

_FLAGS = (
    *("-O2", "-D_GNU_SOURCE", "-fvisibility=hidden"),
    *("-Wall", "-Wextra", "-Wshadow", "-Werror"),
)
_COMPILERS = {
    ".c": ("gcc", "-std=c11", "-Wstrict-prototypes", "-Wmissing-prototypes"),
    ".cpp": ("g++", "-std=c++17"),
}


def build(folder: Path, name: str, *more: str, library: bool = False) -> Path:
    """Compiles `benchmarks/c/NAME.c`, or `.cpp`, into a program or a shared library in `folder`.

    Args:
        folder: Where the output goes.
        name: Name of the source file, without its suffix.
        more: Further arguments for the compiler.
        library: Whether to build a shared library.

    Returns:
        The path of the program or library.

    Raises:
        StateError: There is no compiler, or it reports an error.
    """
    output = folder / (f"lib{name}.so" if library else name)
    kind = ("-shared", "-fPIC") if library else ()
    stem = Path(__file__).parent / "c" / name
    source = next(file for kind in _COMPILERS if (file := stem.with_suffix(kind)).exists())
    compiler = _COMPILERS[source.suffix]
    try:
        subprocess.run([*compiler, *_FLAGS, *kind, source, *more, "-o", output], check=True)
    except FileNotFoundError as error:
        raise StateError(f"{compiler[0]} is needed for the benchmarks") from error
    except subprocess.CalledProcessError as error:
        raise StateError(f"{compiler[0]} refused {source}") from error
    return output

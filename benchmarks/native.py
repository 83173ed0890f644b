"""Builds the C parts of the benchmarks."""

from __future__ import annotations

import subprocess
from pathlib import Path

from ecatd.model.errors import StateError

_FLAGS = (
    *("-std=c11", "-O2", "-D_GNU_SOURCE", "-fvisibility=hidden"),
    *("-Wall", "-Wextra", "-Wshadow", "-Wstrict-prototypes", "-Wmissing-prototypes", "-Werror"),
)


def build(folder: Path, name: str, *more: str, library: bool = False) -> Path:
    """Compiles `benchmarks/c/NAME.c` into a program or a shared library in `folder`.

    Args:
        folder: Where to.
        name: What.
        more: Further arguments for gcc.
        library: Whether to make a library.

    Raises:
        StateError: There is no gcc, or it refused.
    """
    output = folder / (f"lib{name}.so" if library else name)
    kind = ("-shared", "-fPIC") if library else ()
    source = Path(__file__).parent / "c" / f"{name}.c"
    try:
        subprocess.run(["gcc", *_FLAGS, *kind, source, *more, "-o", output], check=True)
    except FileNotFoundError as error:
        raise StateError("gcc is needed for the benchmarks") from error
    except subprocess.CalledProcessError as error:
        raise StateError(f"gcc refused {source}") from error
    return output

"""`python -m ecatdev.drawing FOLDER` writes the pictures of the documentation."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from pymoca.parser import ModelicaSyntaxError

from .library import NoSuchClassError
from .pictures import SCREEN, pictures


def main(arguments: list[str]) -> int:
    """Writes all pictures to a folder, and removes old ones that no longer exist."""
    parser = argparse.ArgumentParser(prog="python -m ecatdev.drawing", description=main.__doc__)
    parser.add_argument("folder", type=Path, help="where the pictures go")
    parser.add_argument(
        "--standard-library",
        metavar="DIR",
        type=Path,
        help="folder with the Modelica Standard Library, to draw its own icons; "
        "the pictures of the documentation are made without it",
    )
    options = parser.parse_args(arguments)
    try:
        files = pictures(options.standard_library)
    except (NoSuchClassError, ModelicaSyntaxError) as error:
        print(f"nothing is drawn: {error}", file=sys.stderr)
        return 1
    options.folder.mkdir(parents=True, exist_ok=True)
    for old in options.folder.glob("*.svg"):
        if old.name not in files and not old.name.startswith(SCREEN):
            old.unlink()
    for name, text in files.items():
        (options.folder / name).write_text(text, "utf-8")
        print(options.folder / name)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

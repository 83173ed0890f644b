"""`python -m ecatgen.drawing FOLDER` writes the pictures of the documentation."""

from __future__ import annotations

import sys
from pathlib import Path

from .pictures import pictures


def main(arguments: list[str]) -> int:
    """Writes all pictures to a folder, and removes those that are no more."""
    if len(arguments) != 1:
        print("usage: python -m ecatgen.drawing FOLDER", file=sys.stderr)
        return 2
    folder = Path(arguments[0])
    folder.mkdir(parents=True, exist_ok=True)
    files = pictures()
    for old in folder.glob("*.svg"):
        if old.name not in files:
            old.unlink()
    for name, text in files.items():
        (folder / name).write_text(text, "utf-8")
        print(folder / name)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

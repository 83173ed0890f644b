"""The files of the page, as they were built from `web/` of the sources."""

from __future__ import annotations

from pathlib import Path

from ecatd.base.errors import StateError

_FOLDER = Path(__file__).parent / "_page"
_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".txt": "text/plain; charset=utf-8",
    ".woff2": "font/woff2",
}


def read_files(folder: Path = _FOLDER) -> dict[str, tuple[str, bytes]]:
    """Type and content of each file of the page, by its path in the address.

    They are read once, so that no path of a request ever reaches the file system.

    Raises:
        StateError: The page was not built.
    """
    found = {
        f"/{path.relative_to(folder).as_posix()}": (_TYPES[path.suffix], path.read_bytes())
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.suffix in _TYPES
    }
    if "/index.html" not in found:
        raise StateError(
            "the page is not in this installation: it was built from a checkout without Node.js. "
            "Install Node.js 20 or newer with npm and build again with `make web`; packages of "
            "ecatd have the page"
        )
    found["/"] = found["/index.html"]
    return found

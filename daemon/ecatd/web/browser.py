"""Opens the page in the browser of the user."""

from __future__ import annotations

import html
import tempfile
import threading
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def open_browser() -> Iterator[Callable[[str], None]]:
    """Yields what opens an address in the browser.

    All users of the machine see the arguments of programs. So the browser gets the name of a file
    that only this user can read, which leads to the address with the token.
    """
    with tempfile.TemporaryDirectory(prefix="ecatctl-web-") as folder:

        def show(address: str) -> None:
            path = Path(folder, "open.html")
            target = html.escape(address)
            path.write_text(
                f'<!doctype html><meta charset="utf-8"><title>ecatctl web</title>'
                f'<meta http-equiv="refresh" content="0;url={target}">'
                f'<a href="{target}">ecatctl web</a>'
            )
            threading.Thread(target=webbrowser.open, args=(path.as_uri(),), daemon=True).start()

        yield show

"""Pages in Chromium that watch a bus, in a process of their own (`masters.worker`)."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from ecatd.base.errors import StateError

from ..machine import used

_SIZE: Any = {"width": 1280, "height": 800}
_PATIENCE_MS = 60_000
_EMPTY = "about:blank"


class Pages:
    """Windows of a browser. Each has a page, or shows nothing.

    Args:
        address: The address that `ecatctl web` prints.
        count: Number of windows.
        signals: Texts that find the signals of the scope, one for each.

    Raises:
        StateError: There is no Chromium.
    """

    def __init__(self, address: str, count: int, signals: Sequence[str]) -> None:
        from playwright.sync_api import sync_playwright

        chromium = shutil.which("chromium")
        if chromium is None:
            raise StateError("the benchmark of the live view needs chromium")
        self._address = address
        self._playwright = sync_playwright().start()
        options = ["--no-sandbox", "--disable-gpu"]
        browser = self._playwright.chromium.launch(executable_path=chromium, args=options)
        self._version = browser.version
        first = browser.new_context(viewport=_SIZE)
        page = first.new_page()
        page.set_default_timeout(_PATIENCE_MS)
        page.goto(address)
        for signal in signals:
            box = page.get_by_role("combobox", name="Add a signal")
            box.click()
            box.fill(signal)
            box.press("Enter")
        page.wait_for_function(_DRAWS, arg=len(signals))
        state = first.storage_state()  # the cookie, and the layout of the scope
        first.close()
        self._signals = len(signals)
        self._windows = [
            browser.new_context(viewport=_SIZE, storage_state=state).new_page()
            for _ in range(count)
        ]
        for window in self._windows:
            window.set_default_timeout(_PATIENCE_MS)

    def __call__(self, *, shown: bool) -> dict[str, Any]:
        """Opens all pages and waits until each draws, or leaves them.

        Returns:
            `used`: seconds of processors that the browser has had so far. `drawing`: of each page
            that is left, the milliseconds of JavaScript for a picture, as its scope says; and
            `frames`, pictures in a second; `reports` is all that they say. `version` is that of
            the browser.
        """
        reports = []
        # Before windows are left, since their processes end then.
        before = sum(map(used, descendants(os.getpid())))
        for window in self._windows:
            if shown:
                window.goto(self._address)
            elif window.url != _EMPTY:
                reports.append(_status(window))
                window.goto(_EMPTY)
        if shown:
            for window in self._windows:
                window.wait_for_function(_DRAWS, arg=self._signals)
        return {
            "used": sum(map(used, descendants(os.getpid()))) if shown else before,
            "reports": reports,
            "drawing": [report["drawing"] for report in reports],
            "frames": [report["frames"] for report in reports],
            "version": self._version,
        }

    def wait(self, seconds: float) -> None:
        """Lets the pages run for a while."""
        self._windows[0].wait_for_timeout(1000 * seconds)


_DRAWS = """count => {
  const found = document.querySelector('.scope-status')?.dataset.view;
  const rows = document.querySelectorAll('.scope-legend tbody tr').length;
  return found && rows >= count && JSON.parse(found).rows > 1000;
}"""


def _status(page: Any) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(page.locator(".scope-status").get_attribute("data-view"))
    return found


def descendants(pid: int, name: str = "") -> Iterator[int]:
    """The processes that a process has started, and those that they have.

    Args:
        pid: The process.
        name: Only those whose names have this text.
    """
    try:
        tasks = [*Path(f"/proc/{pid}/task").iterdir()]
        children = [
            int(child) for task in tasks for child in (task / "children").read_text().split()
        ]
    except (FileNotFoundError, ProcessLookupError):  # it has ended
        return
    for child in children:
        with suppress(FileNotFoundError, ProcessLookupError):
            if name in Path(f"/proc/{child}/comm").read_text():
                yield child
        yield from descendants(child, name)

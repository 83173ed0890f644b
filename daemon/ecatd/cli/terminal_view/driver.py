"""The terminal: Textual's driver for Linux, which bytes that are not UTF-8 do not end."""

from __future__ import annotations

import codecs
from functools import partial
from typing import Any

from textual.drivers import linux_driver


class LenientDriver(linux_driver.LinuxDriver):
    """Ignores what is not UTF-8: line noise, or a paste from a terminal with another encoding."""

    def run_input_thread(self) -> None:
        """Waits for input."""
        found: Any = linux_driver
        found.getincrementaldecoder = _lenient  # the only place where the driver takes one from
        super().run_input_thread()

    def _run_input_thread(self) -> None:
        try:
            self.run_input_thread()
        except Exception as error:
            self._app.call_later(self._app._handle_exception, error)


def _lenient(encoding: str) -> Any:
    return partial(codecs.getincrementaldecoder(encoding), errors="ignore")

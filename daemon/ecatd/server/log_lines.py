"""Lines of the log for the gateway, which publishes them."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

_MOST, _PAUSE = 100, 0.25
"""Most lines that wait, and seconds for which they do: so at most 400 a second are published."""


class LogLines:
    """Numbers the lines of a log, and passes them on from the event loop.

    A line is never waited for: of too many, the oldest are dropped, and their numbers are missing.

    Args:
        send: Called with each line, as a map.
    """

    def __init__(self, send: Callable[[dict[str, Any]], None]) -> None:
        self._send = send
        self._loop = asyncio.get_running_loop()
        self._lock = threading.Lock()
        self._waiting: list[dict[str, Any]] = []
        self._next = 1

    def note(self, level: str, part: str, text: str, event: str, slaves: list[int]) -> None:
        """Takes a line, on any thread; see `Log`."""
        line = {
            "time_ns": time.time_ns(),
            "level": level,
            "part": part,
            "text": text,
            "event": event,
            "slaves": slaves,
        }
        with self._lock:
            first = not self._waiting
            self._waiting.append({"sequence": self._next, **line})
            self._next += 1
            del self._waiting[:-_MOST]
        if first:
            with suppress(RuntimeError):  # the loop has ended, and with it the gateway
                self._loop.call_soon_threadsafe(self._loop.call_later, _PAUSE, self._pass_on)

    def _pass_on(self) -> None:
        with self._lock:
            lines, self._waiting = self._waiting, []
        for line in lines:
            self._send({"line": line})

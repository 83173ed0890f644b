"""Writes one line per event to stderr: in the journal with a priority, else with a name."""

from __future__ import annotations

import os
import sys

_PREFIX = {"error": "<3>", "warning": "<4>", "info": "<6>", "debug": "<7>"}
_LEVELS = list(_PREFIX)


def _stderr_is_journal() -> bool:
    """Whether stderr is the socket of the journal.

    $JOURNAL_STREAM alone does not say so: processes whose stderr was redirected inherit it as well.
    """
    status = os.fstat(2)
    return os.environ.get("JOURNAL_STREAM") == f"{status.st_dev}:{status.st_ino}"


class Log:
    """Writes events of one process.

    Args:
        name: Name in front of each line.
        level: Least important kind of event that is written.
    """

    def __init__(self, name: str, level: str = "info") -> None:
        self._name = name
        self._level = _LEVELS.index(level)
        self._journal = _stderr_is_journal()

    def _write(self, level: str, text: str) -> None:
        if _LEVELS.index(level) > self._level:
            return
        if self._journal:
            line = f"{_PREFIX[level]}{text}\n"
        else:
            line = f"{self._name}: {'' if level == 'info' else level + ': '}{text}\n"
        sys.stderr.write(line)
        sys.stderr.flush()

    def error(self, text: str) -> None:
        """Something that ends or cripples the service."""
        self._write("error", text)

    def warning(self, text: str) -> None:
        """Something that the user should know."""
        self._write("warning", text)

    def info(self, text: str) -> None:
        """A normal step."""
        self._write("info", text)

    def debug(self, text: str) -> None:
        """A detail."""
        self._write("debug", text)

"""Requests about the levels of the log."""

from __future__ import annotations

from ecatd.base.errors import UsageError
from ecatd.base.log_levels import LEVELS, PARTS

from .operation import Request


class ReadLogLevels(Request):
    """Asks for the levels of the log in force, and for those of the configuration."""

    op = "log_levels"
    key = "ro/log"


class SetLogLevel(Request):
    """Asks for another level of the log, until the configuration is read again.

    Attributes:
        level: `error`, `warning`, `info` or `debug`.
        part: A part of the log, as the answer names it, or None for all of them.
        by: The name that the client gives itself, for the log.
    """

    op = "set_log_level"
    key = "rw/log/{part}"
    level: str
    part: str | None = None
    by: str = ""

    def _check(self) -> None:
        if self.level not in LEVELS:
            raise UsageError(f"{self.level!r} is not a level: use {', '.join(LEVELS)}")
        if self.part is not None and self.part not in PARTS:
            raise UsageError(f"{self.part!r} is not a part of the log: use {', '.join(PARTS)}")

"""Operations about the levels of the log, and its lines."""

from __future__ import annotations

from ecatd.base.errors import UsageError
from ecatd.base.log_levels import LEVELS, PARTS

from .fields import ClientName
from .operation import Map, Operation


class LogLevels(Map):
    """Levels of the log."""

    levels: dict[str, str]  #: Those in force, by part.
    configured: dict[str, str]  #: Those of the configuration, by part.


class LogLine(Map):
    """A line of the log of the bus server."""

    sequence: int  #: Its number: each line has the next one, so a gap is a loss.
    time_ns: int  #: Unix time in ns.
    level: str  #: `error`, `warning` or `notice`.
    part: str  #: The part of the daemon; see LogLevels.
    text: str  #: What has happened.
    event: str  #: Kind of the event that tells the same; may be empty.
    slaves: list[int]  #: Positions of the slaves concerned.


class ReadLogLevels(Operation[LogLevels]):
    """Asks for the levels of the log in force, and for those of the configuration."""

    op = "log_levels"
    key = "ro/log"


class SetLogLevel(Operation[LogLevels]):
    """Asks for another level of the log, until the configuration is read again."""

    op = "set_log_level"
    key = "rw/log/{part}"
    level: str  #: `error`, `warning`, `info` or `debug`.
    part: str | None = None  #: A part of the log, as the answer names it, or None for all of them.
    by: ClientName = ""  #: The name that the client gives itself, for the log.

    def _check(self) -> None:
        if self.level not in LEVELS:
            raise UsageError(f"{self.level!r} is not a level: use {', '.join(LEVELS)}")
        if self.part is not None and self.part not in PARTS:
            raise UsageError(f"{self.part!r} is not a part of the log: use {', '.join(PARTS)}")

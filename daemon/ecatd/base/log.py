"""The log: writes one line per event, to the journal with fields, or to stderr with the level.

The fields of the journal are ECAT_BUS, ECAT_PART (see `ecatd.base.log_levels`), ECAT_EVENT (the
name of the event in Zenoh), ECAT_SLAVE (the position, once for each slave concerned), and
MESSAGE_ID, by which `journalctl -x` finds the explanation in `systemd/ecatd.catalog`; kinds of
events are in `ecatd.operations.events`.
"""

from __future__ import annotations

import os
import socket
import sys
import threading
import time
import uuid
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

from .log_levels import DEFAULTS, PARTS, Levels, level_of
from .sanitized_output import error_text, printable, sanitized

_PRIORITIES = {"error": 3, "warning": 4, "notice": 5, "info": 6, "debug": 7}
_PASSED_ON = _PRIORITIES["notice"]
"""Lines that are at least as important are passed on."""
_JOURNAL = Path("/run/systemd/journal/socket")
_NAMESPACE = uuid.UUID("6f0a7f6e-2c0c-4c6e-9a51-3d6a1e5f7b10")

STORM_MAX, STORM_S = 1000, 5.0
"""Most messages of one part and level, and the seconds in which they may come; further ones are
only counted, except errors and requested changes. By default, the journal takes 10000 messages of a
service in 30 s, and then drops errors as well, so one part alone must not have as many."""


def message_id(event: str) -> str:
    """Returns the MESSAGE_ID of an event for the journal; it is always the same."""
    return uuid.uuid5(_NAMESPACE, event).hex


def _stderr_is_journal() -> bool:
    """Whether stderr is the socket of the journal.

    $JOURNAL_STREAM alone does not say so: processes whose stderr was redirected inherit it as well.
    """
    try:
        status = os.fstat(2)
    except OSError:  # closed: `2>&-`
        return False
    return os.environ.get("JOURNAL_STREAM") == f"{status.st_dev}:{status.st_ino}"


class Log:
    """Writes events of one part of one process; `of` gives the log of another part.

    Args:
        name: Name in front of each line.
        levels: The level of each part: the least important kind of event that is written.
        bus: Name of the bus.
        journal: Socket of the journal; by default the usual one, if stderr goes to the journal.
    """

    def __init__(
        self,
        name: str,
        levels: Levels = DEFAULTS,
        bus: str = "",
        journal: Path | None = None,
    ) -> None:
        self._part = "service"
        self._writer = _Writer(name, levels, bus, journal)

    def of(self, part: str) -> Log:
        """Returns the log of another part. All parts share the levels and the bus."""
        assert part in PARTS, part
        log = Log.__new__(Log)
        log._part, log._writer = part, self._writer
        return log

    @property
    def levels(self) -> Levels:
        """The level of each part: the least important kind of event that is written."""
        return self._writer.levels

    @levels.setter
    def levels(self, levels: Levels) -> None:
        self._writer.levels = levels

    def set_audit_file(self, path: str) -> None:
        """Sets a file into which requested changes are written, too; empty for no file."""
        self._writer.audit_file = path

    def pass_on(self, take: Callable[[str, str, str, str, list[int]], None]) -> None:
        """Has each written line from level notice up passed on, too.

        Args:
            take: Gets level, part, text, event and slaves, on the thread that writes the line. It
                must not wait, and must not write to the log.
        """
        self._writer.take = take

    def set_bus(self, bus: str) -> None:
        """Sets the name of the bus, once it is known."""
        self._writer.bus = bus

    def error(self, text: str, event: str = "", slaves: Iterable[int] = ()) -> None:
        """Reports something that ends or cripples the service.

        Args:
            text: What has happened, and what to do.
            event: Name of the event in Zenoh.
            slaves: Positions of the slaves concerned.
        """
        self._write("error", text, event, slaves)

    def warning(self, text: str, event: str = "", slaves: Iterable[int] = ()) -> None:
        """Reports something that the user should know; arguments as for `error`."""
        self._write("warning", text, event, slaves)

    def notice(self, text: str, *, failed: bool = False, redacted: str = "") -> None:
        """Reports a requested change, in the audit file too. It is written whatever the level is.

        Args:
            text: What has changed.
            failed: Whether that has failed, which is a warning.
            redacted: What is passed on instead, if the text contains a value that may be a secret.
        """
        self._writer.write("warning" if failed else "notice", self._part, text, redacted=redacted)
        self._writer.audit(text)

    def info(self, text: str, event: str = "", slaves: Iterable[int] = ()) -> None:
        """Reports a normal step; arguments as for `error`."""
        self._write("info", text, event, slaves)

    def debug(self, text: str, event: str = "", slaves: Iterable[int] = ()) -> None:
        """Reports a detail, with the name of its part in front; arguments as for `error`."""
        self._write("debug", text, event, slaves)

    @property
    def writes_debug(self) -> bool:
        """Whether `debug` writes anything, for a text that takes a while to make."""
        return self._writes("debug")

    def _writes(self, level: str) -> bool:
        return _PRIORITIES[level] <= _PRIORITIES[level_of(self._writer.levels, self._part)]

    def _write(self, level: str, text: str, event: str, slaves: Iterable[int]) -> None:
        writer = self._writer
        if self._writes(level):
            if level == "debug":
                text = f"{self._part}: {text}"
            if level == "error" or writer.lets_pass(self._part, level):
                writer.write(level, self._part, text, event, slaves)


class _Writer:
    """The part of a log that all parts of a process share; for all threads. See `Log`."""

    def __init__(self, name: str, levels: Levels, bus: str, journal: Path | None) -> None:
        self.levels = levels
        self.bus = bus
        self.audit_file = ""
        self.take: Callable[[str, str, str, str, list[int]], None] | None = None
        self._audited = True  # whether the last change could be written to the audit file
        self._name = name
        self._left_out = 0  # messages that the journal did not take
        self._journal = journal or (_JOURNAL if _stderr_is_journal() else None)
        self._lock = threading.Lock()
        self._since: dict[tuple[str, str], tuple[float, int]] = {}  # begin and number of messages

    def lets_pass(self, part: str, level: str) -> bool:
        """Counts a message; whether there have not been too many. If so, their number is told."""
        now = time.monotonic()
        with self._lock:
            begin, count = self._since.get((part, level), (now, 0))
            if count <= STORM_MAX and now - begin > STORM_S:
                begin, count = now, 0
            self._since[part, level] = begin, count + 1
        if count == STORM_MAX:
            wait = max(begin + STORM_S - now, 0)
            timer = threading.Timer(wait, self._report_left_out, (part, level))
            timer.daemon = True
            timer.start()
        return count < STORM_MAX

    def _report_left_out(self, part: str, level: str) -> None:
        with self._lock:
            _, count = self._since.pop((part, level))
        more = f"{count - STORM_MAX} more messages of level {level} within {STORM_S:g} s"
        self.write(level, part, f"{part}: {more} are left out")

    def write(
        self,
        level: str,
        part: str,
        text: str,
        event: str = "",
        slaves: Iterable[int] = (),
        *,
        redacted: str = "",
    ) -> None:
        """Writes a message, whatever the level of its part is."""
        text, redacted, slaves = sanitized(text), sanitized(redacted), [*slaves]
        if self.take is not None and _PRIORITIES[level] <= _PASSED_ON:
            self.take(level, part, redacted or text, event, slaves)
        if self._journal is not None:
            try:
                self._send(self._journal, level, part, text, event, slaves)
            except BlockingIOError:
                self._left_out += 1  # a journal that hangs must not stop the control of a bus
                return
            except OSError:
                line = f"<{_PRIORITIES[level]}>{error_text(text)}\n"
            else:
                return
        else:
            line = f"{self._name}: {'' if level == 'info' else level + ': '}{error_text(text)}\n"
        with suppress(OSError):  # a full disk or a closed pipe: the bus goes on without its log
            sys.stderr.write(line)
            sys.stderr.flush()

    def audit(self, text: str) -> None:
        """Adds a line to the audit file, if there is one. Opens it each time: it may be rotated."""
        if not self.audit_file:
            return
        now = time.time()
        stamp = time.strftime("%Y-%m-%dT%H:%M:%S", time.localtime(now))
        zone = time.strftime("%z", time.localtime(now))
        one = printable(text.replace("\n", " "))
        line = f"{stamp}.{int(now * 1000) % 1000:03d}{zone} {self.bus}: {one}\n"
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK
        try:
            descriptor = os.open(self.audit_file, flags, 0o640)
            try:
                os.write(descriptor, line.encode(errors="replace"))
            finally:
                os.close(descriptor)
        except OSError as error:
            if self._audited:
                self.write(
                    "error",
                    "service",
                    f"changes cannot be written to {self.audit_file} (audit_file): "
                    f"{error.strerror}; until that is corrected they are only in this log",
                )
            self._audited = False
        else:
            self._audited = True

    def _send(
        self, journal: Path, level: str, part: str, text: str, event: str, slaves: Iterable[int]
    ) -> None:
        fields = [
            ("MESSAGE", text),
            ("PRIORITY", str(_PRIORITIES[level])),
            ("SYSLOG_IDENTIFIER", self._name),
            *((("ECAT_BUS", self.bus),) if self.bus else ()),
            ("ECAT_PART", part),
            *((("ECAT_EVENT", event), ("MESSAGE_ID", message_id(event))) if event else ()),
            *(("ECAT_SLAVE", str(slave)) for slave in slaves),
        ]
        if self._left_out:
            fields.append(("ECAT_LEFT_OUT", str(self._left_out)))  # messages before this one
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            sender.setblocking(False)
            sender.sendto(b"".join(_encode(*field) for field in fields), str(journal))
        self._left_out = 0


def _encode(name: str, value: str) -> bytes:
    """Encodes a field for the journal. A value with several lines is preceded by its length."""
    data = value.encode(errors="replace")
    if b"\n" not in data:
        return b"%b=%b\n" % (name.encode(), data)
    return b"%b\n%b%b\n" % (name.encode(), len(data).to_bytes(8, "little"), data)

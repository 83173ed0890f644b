"""Writes one line per event: to the journal with fields, else to stderr with the name of the level.

The fields of the journal are ECAT_BUS, ECAT_EVENT (the name of the event as over Zenoh), ECAT_SLAVE
(the position, once for each slave concerned), and MESSAGE_ID, by which `journalctl -x` finds the
explanation in `systemd/ecatd.catalog`.
"""

from __future__ import annotations

import os
import socket
import sys
import uuid
from collections.abc import Iterable
from pathlib import Path

_PRIORITIES = {"error": 3, "warning": 4, "info": 6, "debug": 7}
_JOURNAL = Path("/run/systemd/journal/socket")
_NAMESPACE = uuid.UUID("6f0a7f6e-2c0c-4c6e-9a51-3d6a1e5f7b10")


def message_id(event: str) -> str:
    """MESSAGE_ID of the journal for an event: always the same."""
    return uuid.uuid5(_NAMESPACE, event).hex


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
        bus: Name of the bus.
        journal: Socket of the journal; by default it is used if stderr goes there.

    Attributes:
        level: As above.
        bus: As above.
    """

    def __init__(
        self, name: str, level: str = "info", bus: str = "", journal: Path | None = None
    ) -> None:
        self.level = level
        self.bus = bus
        self._name = name
        self._left_out = 0  # messages that the journal did not take
        self._journal = journal or (_JOURNAL if _stderr_is_journal() else None)

    def _write(self, level: str, text: str, event: str, slaves: Iterable[int]) -> None:
        if _PRIORITIES[level] > _PRIORITIES[self.level]:
            return
        if self._journal is not None:
            try:
                self._send(self._journal, level, text, event, slaves)
            except BlockingIOError:
                self._left_out += 1  # a journal that hangs must not hang those who control a bus
                return
            except OSError:
                line = f"<{_PRIORITIES[level]}>{text}\n"
            else:
                return
        else:
            line = f"{self._name}: {'' if level == 'info' else level + ': '}{text}\n"
        sys.stderr.write(line)
        sys.stderr.flush()

    def _send(
        self, journal: Path, level: str, text: str, event: str, slaves: Iterable[int]
    ) -> None:
        fields = [
            ("MESSAGE", text),
            ("PRIORITY", str(_PRIORITIES[level])),
            ("SYSLOG_IDENTIFIER", self._name),
            *((("ECAT_BUS", self.bus),) if self.bus else ()),
            *((("ECAT_EVENT", event), ("MESSAGE_ID", message_id(event))) if event else ()),
            *(("ECAT_SLAVE", str(slave)) for slave in slaves),
        ]
        if self._left_out:
            fields.append(("ECAT_LEFT_OUT", str(self._left_out)))  # messages before this one
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            sender.setblocking(False)
            sender.sendto(b"".join(_encode(*field) for field in fields), str(journal))
        self._left_out = 0

    def error(self, text: str, event: str = "", slaves: Iterable[int] = ()) -> None:
        """Something that ends or cripples the service.

        Args:
            text: What has happened, and what to do.
            event: Name of the event as over Zenoh.
            slaves: Positions of the slaves concerned.
        """
        self._write("error", text, event, slaves)

    def warning(self, text: str, event: str = "", slaves: Iterable[int] = ()) -> None:
        """Something that the user should know; arguments as of `error`."""
        self._write("warning", text, event, slaves)

    def info(self, text: str, event: str = "", slaves: Iterable[int] = ()) -> None:
        """A normal step; arguments as of `error`."""
        self._write("info", text, event, slaves)

    def debug(self, text: str, event: str = "", slaves: Iterable[int] = ()) -> None:
        """A detail; arguments as of `error`."""
        self._write("debug", text, event, slaves)


def _encode(name: str, value: str) -> bytes:
    """A field in the protocol of the journal: with its length if it has several lines."""
    data = value.encode(errors="replace")
    if b"\n" not in data:
        return b"%b=%b\n" % (name.encode(), data)
    return b"%b\n%b%b\n" % (name.encode(), len(data).to_bytes(8, "little"), data)

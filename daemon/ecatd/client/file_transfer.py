"""A transfer of a file to or from a slave (FoE), as a client sees it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ecatd.base.errors import EcatError
from ecatd.operations.files import FILE_PART, CancelFoe, PutFoe, ReadFoe, TakeFoe, Transfer

if TYPE_CHECKING:
    from .remote import Remote


class FileTransfer:
    """A transfer of a file, which the daemon carries out.

    Args:
        remote: The session.
        progress: The answer of the daemon at its start.
        data: The file, if it is to be written.

    Attributes:
        step: `receiving` (the daemon has not got the whole file), `to boot`, `transferring`,
            `from boot`, `done` or `failed`.
        moved: Bytes that have gone over the bus.
        size: Bytes of the file; None while it is read.
        busy: The text of a slave that is busy; else empty.
        note: A remark about a transfer that is done.
    """

    def __init__(self, remote: Remote, progress: Transfer, data: bytes = b"") -> None:
        self._remote = remote
        self._data = data
        self.number = int(progress["transfer"])
        self._take(progress)

    def _take(self, progress: Transfer) -> None:
        self._failure = progress["failure"]
        self._received = int(progress["received"])
        self.step = str(progress["step"])
        self.moved = int(progress["moved"])
        self.size: int | None = progress["size"]
        self.busy = str(progress["busy"])
        self.note = str(progress["note"])

    @property
    def has_failed(self) -> bool:
        """Whether the daemon has said that it has failed."""
        return self._failure is not None

    def send(self) -> None:
        """Sends the next part of the file to the daemon, as long as `step` is `receiving`."""
        part = self._data[self._received : self._received + FILE_PART]
        self._take(self._remote.request(PutFoe(self.number, self._received, part)))

    def look(self) -> bool:
        """Asks how far it is; returns whether it is done.

        Raises:
            EcatError: It has failed.
        """
        self._take(self._remote.request(ReadFoe(self.number)))
        if self._failure is not None:
            raise EcatError.from_reply(self._failure)
        return self.step == "done"

    def cancel(self) -> None:
        """Cancels it."""
        self._take(self._remote.request(CancelFoe(self.number)))

    def result(self) -> bytes:
        """The file, after it has been read.

        Raises:
            StateError: It is not done.
        """
        found = bytearray()
        while part := self._remote.request(TakeFoe(self.number, len(found)))["data"]:
            found += part
        return bytes(found)

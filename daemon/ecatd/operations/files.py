"""Requests about files of slaves (FoE)."""

from __future__ import annotations

from ecatd.base.errors import UsageError

from .operation import Request

_FILE_NAME_MAX, _DIGEST_DIGITS, _NAME_SHOWN = 255, 64, 40
FILE_MAX = 64 << 20
"""Bytes of a file that is transferred."""
TRANSFER_MAX = 1 << 53
"""Highest number of a transfer."""
FILE_PART = 32 * 1024
"""Bytes of a file in one request or answer."""


class StartFoe(Request):
    """Starts to transfer a file (FoE). The daemon goes on without the client, and keeps the file.

    A file that is written is sent to the daemon first, in parts. If the same file is on its way to
    the slave already, the answer is about that transfer.

    Attributes:
        slave: Position or name.
        file: Name of the file, as the slave knows it.
        write: Whether to write the file to the slave, and not to read it.
        size: For writing: its size in bytes.
        digest: For writing: its SHA-256, in hex.
        password: Password of the slave for it, 0 for none.
        boot: Whether to bring the slave to BOOT before, and back afterwards.
        by: The name that the client gives itself, for the log.
        only_find: Whether to start nothing, but only to find a transfer that is on its way.
    """

    op = "start_foe"
    key = "rw/foe/{slave}"
    slave: int | str
    file: str
    write: bool = False
    size: int = 0
    digest: str = ""
    password: int = 0
    boot: bool = False
    by: str = ""
    only_find: bool = False

    def _check(self) -> None:
        try:
            length = len(self.file.encode("latin-1"))
        except UnicodeEncodeError:
            length = 0
        if not 1 <= length <= _FILE_NAME_MAX or not self.file.isprintable():
            raise UsageError(
                f"{self.file[:_NAME_SHOWN]!r} is not a valid name of a file: a slave takes 1 to "
                f"{_FILE_NAME_MAX} printable letters of Latin-1, and this has {len(self.file)}"
            )
        if self.write and len(self.digest) != _DIGEST_DIGITS:
            raise UsageError(f"'digest' of {self.op} must be the SHA-256 of the file in hex")


class PutFoe(Request):
    """Sends a part of a file that is to be written; the slave gets it when all parts are there.

    Attributes:
        transfer: Number of the transfer.
        offset: Where the part begins: how much of the file the daemon has.
        data: The part, at most 32 KiB.
    """

    op = "put_foe"
    key = "rw/foe/{transfer}/put"
    transfer: int
    offset: int
    data: bytes


class TakeFoe(Request):
    """Asks for a part of a file that has been read.

    Attributes:
        transfer: Number of the transfer, a secret of the client that has started it.
        offset: Where the part begins.
    """

    op = "take_foe"
    key = "ro/foe/{transfer}/{offset}"
    transfer: int
    offset: int


class ReadFoe(Request):
    """Asks how far a transfer is.

    Attributes:
        transfer: Its number.
    """

    op = "read_foe"
    key = "ro/foe/{transfer}"
    transfer: int


class CancelFoe(Request):
    """Ends a transfer. What the slave does with a part of a file depends on the slave.

    Attributes:
        transfer: Its number.
        by: The name that the client gives itself, for the log.
    """

    op = "cancel_foe"
    key = "rw/foe/{transfer}/cancel"
    transfer: int
    by: str = ""

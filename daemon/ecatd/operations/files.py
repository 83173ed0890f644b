"""Operations about files of slaves (FoE)."""

from __future__ import annotations

from ecatd.base.errors import UsageError

from .fields import ClientName, FileSize, Password, SlaveReference, TransferNumber
from .operation import Error, Map, Operation
from .registers import Data

_FILE_NAME_MAX, _DIGEST_DIGITS, _NAME_SHOWN = 255, 64, 40
FILE_PART = 32 * 1024
"""Bytes of a file in one request or answer."""


class Transfer(Map):
    """A transfer of a file."""

    transfer: int  #: Its number, which only the client knows that has started it.
    #: `receiving` from the client, `to boot`, `transferring`, `from boot`, `done`, `failed`.
    step: str
    received: int  #: Bytes that have come from the client.
    size: int | None  #: Bytes of a file that is written; None for one that is read.
    moved: int  #: Bytes that have gone over the bus.
    busy: str  #: What a busy slave says; empty if it is not busy.
    failure: Error | None  #: The error, after a failure.
    note: str  #: A remark about the end; may be empty.


class StartFoe(Operation[Transfer]):
    """Starts to transfer a file (FoE). The daemon goes on without the client, and keeps the file.

    A file that is written is sent to the daemon first, in parts. If the same file is on its way to
    the slave already, the answer is about that transfer.
    """

    op = "start_foe"
    key = "rw/foe/{slave}"
    slave: SlaveReference  #: Position or name.
    file: str  #: Name of the file, as the slave knows it.
    write: bool = False  #: Whether to write the file to the slave, and not to read it.
    size: FileSize = 0  #: For writing: its size in bytes.
    digest: str = ""  #: For writing: its SHA-256, in hex.
    password: Password = 0  #: Password of the slave for it, 0 for none.
    boot: bool = False  #: Whether to bring the slave to BOOT before, and back afterwards.
    by: ClientName = ""  #: The name that the client gives itself, for the log.
    #: Whether to start nothing, but only to find a transfer that is on its way.
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


class PutFoe(Operation[Transfer]):
    """Sends a part of a file that is to be written; the slave gets it when all parts are there."""

    op = "put_foe"
    key = "rw/foe/{transfer}/put"
    is_repeatable = True
    transfer: TransferNumber  #: Number of the transfer.
    offset: FileSize  #: Where the part begins: how much of the file the daemon has.
    data: bytes  #: The part, at most 32 KiB.


class TakeFoe(Operation[Data]):
    """Asks for a part of a file that has been read."""

    op = "take_foe"
    key = "ro/foe/{transfer}/{offset}"
    transfer: TransferNumber  #: Number of the transfer, a secret of the client that has started it.
    offset: FileSize  #: Where the part begins.


class ReadFoe(Operation[Transfer]):
    """Asks how far a transfer is."""

    op = "read_foe"
    key = "ro/foe/{transfer}"
    transfer: TransferNumber  #: Its number.


class CancelFoe(Operation[Transfer]):
    """Ends a transfer. What the slave does with a part of a file depends on the slave."""

    op = "cancel_foe"
    key = "rw/foe/{transfer}/cancel"
    transfer: TransferNumber  #: Its number.
    by: ClientName = ""  #: The name that the client gives itself, for the log.

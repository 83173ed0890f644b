"""Writes numbers to objects of a slave, with errors for refused writes."""

from __future__ import annotations

import struct

from ecatd.base.errors import SdoAbortError, StateError
from ecatd.description.bus import Slave
from ecatd.etg.error_codes import abort_error
from ecatd.master.mailbox.coe import Coe
from ecatd.master.mailbox.talks import Talk


class RefusedError(StateError):
    """A slave refuses its configuration, so another try is useless.

    Attributes:
        slave: The slave.
        why: What it does or has, as a sentence without its subject, the slave.
        where: File, line and key of what it refuses; empty if it is not from one place.
    """

    def __init__(self, slave: Slave, why: str, where: str = "") -> None:
        super().__init__(f"{where}: {slave.label} {why}" if where else f"{slave.label} {why}")
        self.slave, self.why, self.where = slave, why, where

    @property
    def of_it(self) -> str:
        """The sentence about a slave that has been named already."""
        return f"{self.where}: it {self.why}" if self.where else f"it {self.why}"


def write(
    slave: Slave, coe: Coe, address: tuple[int, int], form: str, value: int, what: str
) -> Talk[None]:
    """Writes a number to an object, as a part of a conversation.

    Args:
        slave: The slave.
        coe: CoE of the slave.
        address: Index and subindex.
        form: Format of the number, as in `struct`.
        value: The number.
        what: The meaning of the number, for messages.

    Raises:
        RefusedError: The slave refuses it.
    """
    try:
        yield from coe.download(*address, struct.pack(f"<{form}", value))
    except SdoAbortError as abort:
        where = f"0x{address[0]:04X}:{address[1]:02X}"
        raise RefusedError(slave, f"refuses {what} ({where}): {reason(abort)}") from abort


def reason(abort: SdoAbortError) -> str:
    """Returns code and text of an abort without its object, which the message has already."""
    return str(abort_error(abort.code))

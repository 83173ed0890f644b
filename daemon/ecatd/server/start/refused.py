"""Writes numbers to objects of a slave, with errors for refused writes."""

from __future__ import annotations

import struct

from ecatd.base.errors import SdoAbortError, StateError
from ecatd.description.bus import Slave
from ecatd.etg.abort_codes import abort_error
from ecatd.master.mailbox.coe import Coe
from ecatd.master.mailbox.talks import Talk


class RefusedError(StateError):
    """A slave refuses its configuration, so another try is useless."""


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
        raise RefusedError(
            f"{slave.label} refuses {what} (0x{address[0]:04X}:{address[1]:02X}): {reason(abort)}"
        ) from abort


def reason(abort: SdoAbortError) -> str:
    """Returns code and text of an abort without its object, which the message has already."""
    return str(abort_error(abort.code))

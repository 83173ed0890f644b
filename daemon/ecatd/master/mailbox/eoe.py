"""Ethernet over EtherCAT (ETG.1000.6, "EoE"): frames to a slave, and its IP parameters."""

from __future__ import annotations

from collections.abc import Callable

from ecatd.base.errors import StateError, UsageError
from ecatd.etg.eoe import (
    HEADER_BYTES,
    EoeType,
    IpParameters,
    fragments,
    message,
    result_of,
    result_text,
    type_of,
)

from .coe import Coe
from .conversation import Conversation
from .mailbox import HEADER_BYTES as MAILBOX_HEADER_BYTES
from .mailbox import Mailbox, Protocol

EOE_LEAST = MAILBOX_HEADER_BYTES + HEADER_BYTES + 32
"""Least number of bytes of a mailbox for EoE: a fragment has at least 32 bytes."""

_READ_AT_ONCE = 16
"""Most messages that are read in a row, if a slave sends many."""


def set_ip(mailbox: Mailbox, parameters: IpParameters) -> Conversation[None]:
    """Gives a slave its IP parameters.

    Args:
        mailbox: The mailbox, open.
        parameters: The parameters; one at least has a MAC address.

    Raises:
        StateError: The slave refuses them or has no room for them, or its answer is malformed.
        NoAnswerError: It does not answer.
    """
    request = message(EoeType.SET_IP, data=parameters.pack())
    room = mailbox.size - MAILBOX_HEADER_BYTES
    if any(request[room:]):
        raise StateError(
            f"its mailbox of {mailbox.size} bytes has no room for all of them: "
            f"{'shorten the name' if parameters.name else 'leave out the DNS server'}"
        )
    request = request[:room]
    body = yield from mailbox.ask(Protocol.EOE, request, _answer(EoeType.SET_IP_ANSWER))
    if result := result_of(body):
        raise StateError(result_text(result))


def get_ip(mailbox: Mailbox) -> Conversation[IpParameters]:
    """Asks a slave for its IP parameters; raises as `set_ip`."""
    request = message(EoeType.GET_IP, data=bytes(4))
    body = yield from mailbox.ask(Protocol.EOE, request, _answer(EoeType.GET_IP_ANSWER))
    if len(body) == HEADER_BYTES and (result := result_of(body)):
        raise StateError(result_text(result))
    try:
        return IpParameters.unpack(body[HEADER_BYTES:])
    except UsageError as error:
        raise StateError(f"the slave answered with a wrong frame: {error}") from error


def _answer(wanted: EoeType) -> Callable[[bytes], bytes | None]:
    return lambda body: body if type_of(body) == wanted else None


def send_frame(mailbox: Mailbox, frame: bytes, number: int) -> Conversation[None]:
    """Sends a frame to a slave.

    Args:
        mailbox: The mailbox, open.
        frame: The frame.
        number: See `fragments`.

    Raises:
        NoAnswerError: The slave does not take the frame.
    """
    for body in fragments(frame, mailbox.size - MAILBOX_HEADER_BYTES, number):
        yield from mailbox.send(Protocol.EOE, body)


def read_messages(coe: Coe) -> Conversation[int]:
    """Reads what a slave has sent; returns the number of messages that were no fragments.

    Raises:
        NoAnswerError: The slave does not answer any more.
    """
    found = yield from coe.mailbox.collect(_READ_AT_ONCE)
    for protocol, body in found:
        coe.note(protocol, body)
    return len(found)

"""EoE server: Ethernet frames and IP parameters over the mailbox (ETG.1000.6)."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Protocol as Interface

from ecatd.base.errors import UsageError
from ecatd.etg.eoe import (
    HEADER_BYTES,
    EoeType,
    IpParameters,
    Reassembly,
    fragments,
    message,
    type_of,
)

from .mailbox import HEADER_SIZE, MailboxError, RefusedMailError

_UNSPECIFIED, _UNSUPPORTED_TYPE = 0x0001, 0x0002


class EthernetHost(Interface):
    """What is behind the EoE of a device.

    Attributes:
        sends_unasked: Whether `poll` may return frames.
    """

    sends_unasked: bool

    def set_ip(self, parameters: IpParameters) -> None:
        """Takes other IP parameters."""

    @property
    def ip(self) -> IpParameters:
        """The IP parameters in force."""

    def receive(self, frame: bytes) -> list[bytes]:
        """Takes a frame of the master; returns its own frames in answer."""

    def poll(self) -> list[bytes]:
        """Returns frames that nobody has asked for."""

    def close(self) -> None:
        """Ends, as without power."""


class EoeServer:
    """Answers EoE messages, and cuts the frames of the host.

    Args:
        host: What is behind it.
        send: Puts a message into the mailbox.
    """

    def __init__(self, host: EthernetHost, send: Callable[[bytes], None]) -> None:
        self._host = host
        self._send = send
        self._outgoing = 0
        self._numbers = itertools.cycle(range(16))
        self._received = Reassembly()

    def start(self, send_size: int) -> None:
        """Sets the size of the mailbox that the master reads, and discards parts of a frame."""
        self._outgoing = send_size - HEADER_SIZE
        self._received = Reassembly()

    def handle(self, body: bytes) -> list[bytes]:
        """Answers one mail; see `mailbox.Handler`."""
        if len(body) < HEADER_BYTES:
            raise RefusedMailError(MailboxError.SIZE_TOO_SHORT)
        match type_of(body):
            case EoeType.FRAGMENT:
                frame = self._received.take(body)
                frames = [] if frame is None else self._host.receive(frame)
                return [part for answer in frames for part in self._cut(answer)]
            case EoeType.SET_IP:
                try:
                    self._host.set_ip(IpParameters.unpack(body[HEADER_BYTES:]))
                except UsageError:
                    return [message(EoeType.SET_IP_ANSWER, _UNSPECIFIED)]
                return [message(EoeType.SET_IP_ANSWER)]
            case EoeType.GET_IP:
                ip = self._host.ip
                data = ip.pack() if ip.mac else bytes(4)
                return [message(EoeType.GET_IP_ANSWER, data=data)[: self._outgoing]]
            case kind:
                return [bytes([kind | 1, 1]) + _UNSUPPORTED_TYPE.to_bytes(2, "little")]

    def run(self) -> None:
        """Sends the frames that nobody has asked for."""
        for frame in self._host.poll():
            for part in self._cut(frame):
                self._send(part)

    def _cut(self, frame: bytes) -> list[bytes]:
        return list(fragments(frame, self._outgoing, next(self._numbers)))

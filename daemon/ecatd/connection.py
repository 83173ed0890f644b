"""The connection between gateway and bus server: messages in both directions over a Unix socket."""

from __future__ import annotations

import asyncio
from typing import Any

from ecatd.encoding import LENGTH, MAX_REPLY, frame, unpack

from .model.errors import UsageError

_UNSENT_MAX = MAX_REPLY
"""Bytes: an end is not stuck because it has not read the whole of one reply yet."""


class Connection(asyncio.Protocol):
    """One end of it. Subclasses handle messages as they come, on the thread of the event loop.

    asyncio's streams would do the same, but wake a task for each part of a message: that was a
    third of what a request cost.

    Args:
        limit: Most bytes of a message from the other end.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._received = bytearray()
        self._held = False
        self._problem: UsageError | None = None
        self._transport: asyncio.Transport | None = None

    def message_received(self, message: dict[str, Any]) -> None:
        """Called with each message."""
        raise NotImplementedError

    def ended(self, problem: UsageError | None) -> None:
        """Called when the other end has closed, or was disconnected for what it has sent."""
        raise NotImplementedError

    @property
    def is_open(self) -> bool:
        """Whether messages can be sent."""
        return self._transport is not None and not self._transport.is_closing()

    @property
    def is_stuck(self) -> bool:
        """Whether the other end does not read what it is sent."""
        return self._transport is not None and (
            self._transport.get_write_buffer_size() > _UNSENT_MAX
        )

    def send(self, message: dict[str, Any]) -> None:
        """Sends a message; one for an end that has gone is dropped."""
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(frame(message))

    def hold(self) -> None:
        """Takes no further messages for now."""
        self._held = True
        if self._transport is not None:
            self._transport.pause_reading()

    def go_on(self) -> None:
        """Takes messages again."""
        self._held = False
        if self._transport is not None and not self._transport.is_closing():
            self._transport.resume_reading()
            self._take()

    def close(self) -> None:
        """Disconnects, when all is sent."""
        if self._transport is not None:
            self._transport.close()

    def abort(self) -> None:
        """Disconnects at once."""
        if self._transport is not None:
            self._transport.abort()

    # --- asyncio ---------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """See `asyncio.Protocol`."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        """See `asyncio.Protocol`."""
        self._received += data
        self._take()

    def connection_lost(self, exc: Exception | None) -> None:
        """See `asyncio.Protocol`."""
        del exc  # whatever it is: it has gone
        self.ended(self._problem)

    def _take(self) -> None:
        """Hands over all messages that are complete."""
        while not self._held and self.is_open:
            try:
                message = self._next()
            except UsageError as error:  # there is no way to find the next one
                self._problem = error
                self.abort()
                return
            if message is None:
                return
            self.message_received(message)

    def _next(self) -> dict[str, Any] | None:
        received = self._received
        if len(received) < LENGTH.size:
            return None
        (length,) = LENGTH.unpack_from(received)
        if length > self._limit:
            raise UsageError(f"a message of {length} bytes is too long: {self._limit} are allowed")
        end = LENGTH.size + length
        if len(received) < end:
            return None
        data = bytes(received[LENGTH.size : end])
        del received[:end]
        return unpack(data, self._limit)

"""The connection between gateway and bus server: messages in both directions over a Unix socket."""

from __future__ import annotations

import asyncio
from typing import Any

from ecatd.base.errors import UsageError

from .encoding import LENGTH, MAX_REPLY, frame, unpack

_UNSENT_MAX = MAX_REPLY
"""With more unsent bytes than this, the other end counts as not reading: one largest reply."""


class Connection(asyncio.Protocol):
    """One end of the connection. Subclasses handle messages on the thread of the event loop.

    The streams of asyncio would do the same, but they wake a task for each part of a message. That
    took a third of the time of a request.

    Args:
        limit: Most bytes of a message that is received.
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
        """Called when the connection has ended.

        Args:
            problem: The error in a received message, if the connection ended because of it.
        """
        raise NotImplementedError

    @property
    def is_open(self) -> bool:
        """Whether messages can be sent."""
        return self._transport is not None and not self._transport.is_closing()

    @property
    def is_stuck(self) -> bool:
        """Whether the other end does not read: too many bytes wait to be sent."""
        return self._transport is not None and (
            self._transport.get_write_buffer_size() > _UNSENT_MAX
        )

    @property
    def is_held(self) -> bool:
        """Whether `hold` was called, and `go_on` not yet."""
        return self._held

    def send(self, message: dict[str, Any]) -> None:
        """Sends a message; drops it if the connection has ended."""
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(frame(message))

    def hold(self) -> None:
        """Stops receiving messages until `go_on`."""
        self._held = True
        if self._transport is not None:
            self._transport.pause_reading()

    def go_on(self) -> None:
        """Receives messages again."""
        self._held = False
        if self._transport is not None and not self._transport.is_closing():
            self._transport.resume_reading()
            self._take()

    def close(self) -> None:
        """Disconnects after everything has been sent."""
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
        del exc  # the reason does not matter: the other end is gone
        self.ended(self._problem)

    def _take(self) -> None:
        """Handles all messages that have been received completely."""
        while not self._held and self.is_open:
            try:
                message = self._next()
            except UsageError as error:  # the start of the next message is unknown
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

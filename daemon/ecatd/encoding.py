"""Messages as bytes: msgpack; on the control socket (`connection.py`) with its length in front."""

from __future__ import annotations

import struct
from typing import Any

import msgpack

from ecatd.model.errors import UsageError

LENGTH = struct.Struct(">I")
"""What stands in front of a message on the control socket."""

MAX_MESSAGE = 64 * 1024
"""Bytes of an encoded message; longer ones are refused before they are decoded."""

MAX_REPLY = 1 << 26
"""Bytes of a reply from a daemon that one has chosen to trust: a large bus has much to tell."""


def pack(message: dict[str, Any]) -> bytes:
    """A message as msgpack."""
    return bytes(msgpack.packb(message))


def unpack(data: bytes, limit: int = MAX_MESSAGE) -> dict[str, Any]:
    """The map in a msgpack message of at most `limit` bytes.

    Raises:
        UsageError: It is too long, no msgpack, or no map with string keys.
    """
    if len(data) > limit:
        raise UsageError(f"a message of {len(data)} bytes is too long: {limit} are allowed")
    try:
        message = msgpack.unpackb(data)
    except (ValueError, msgpack.UnpackException) as error:
        raise UsageError(f"this is no msgpack message: {error or type(error).__name__}") from error
    if not isinstance(message, dict) or not all(isinstance(key, str) for key in message):
        raise UsageError("a message is a map with string keys")
    return message


def frame(message: dict[str, Any]) -> bytes:
    """A message with its length in front."""
    data = pack(message)
    return LENGTH.pack(len(data)) + data

"""Encodes messages with msgpack; `connection.py` puts their length in front of them."""

from __future__ import annotations

import struct
from typing import Any

import msgpack

from ecatd.base.errors import UsageError

LENGTH = struct.Struct(">I")
"""The length of a message in bytes, in front of it on the control socket: 32 bits, big endian."""

MAX_MESSAGE = 64 * 1024
"""Most bytes of an encoded request. Longer requests are refused before they are decoded."""

MAX_REPLY = 1 << 26
"""Most bytes of a reply. This limit is higher, because a client trusts its daemon, and a large bus
has a long description."""


def pack(message: dict[str, Any]) -> bytes:
    """Encodes a message as msgpack."""
    return bytes(msgpack.packb(message))


def unpack(data: bytes, limit: int = MAX_MESSAGE) -> dict[str, Any]:
    """Decodes a msgpack message of at most `limit` bytes.

    Raises:
        UsageError: The message is too long, is not msgpack, or is not a map with string keys.
    """
    if len(data) > limit:
        raise UsageError(f"a message of {len(data)} bytes is too long: {limit} are allowed")
    try:
        message = msgpack.unpackb(data)
    except (ValueError, msgpack.UnpackException) as error:
        raise UsageError(
            f"this is not a msgpack message: {error or type(error).__name__}"
        ) from error
    if not isinstance(message, dict) or not all(isinstance(key, str) for key in message):
        raise UsageError("a message is a map with string keys")
    return message


def frame(message: dict[str, Any]) -> bytes:
    """Encodes a message, with its length in front."""
    data = pack(message)
    return LENGTH.pack(len(data)) + data

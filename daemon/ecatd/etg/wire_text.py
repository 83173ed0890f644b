"""Texts of slaves as bytes: names in EEPROMs and object dictionaries, values of VISIBLE_STRING.

The standards have Latin-1 (ISO 8859-1) for some and ASCII for others, and vendors write UTF-8, too.
Bytes that are UTF-8 are read as UTF-8, and others as Latin-1; what is written is read back as it
was.
"""

from __future__ import annotations


def decode_text(data: bytes) -> str:
    """Decodes a text of a slave, up to its first zero byte."""
    data = data.split(b"\0", 1)[0]
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def encode_text(text: str, most: int | None = None) -> bytes:
    """Encodes a text for a slave: in Latin-1, or in UTF-8 if it has other letters.

    Args:
        text: The text.
        most: Largest number of bytes, or None; the rest is cut off, between two letters.
    """
    try:
        data = text.encode("latin-1")
        if decode_text(data) != text:  # these bytes happen to be UTF-8, too
            data = text.encode()
    except UnicodeEncodeError:
        data = text.encode("utf-8", "replace")
    if most is None or len(data) <= most:
        return data
    return encode_text(text[: min(most, len(text) - 1)], most)

"""Recognises EEPROM images in Intel HEX, which programmers and some vendors' tools write.

Each line is a record `:LLAAAATT…CC`: number of data bytes, address, type, data, checksum. Type 0
has data, 1 ends the file, 2 and 4 give the upper part of the addresses that follow, and 3 and 5
tell where a program begins, which an EEPROM has not.
"""

from __future__ import annotations

import re
from codecs import BOM_UTF8
from collections.abc import Callable

from ecatd.base.errors import ConfigError

from .sii_check import MAX_IMAGE

_DATA, _END, _SEGMENT, _LINEAR = 0, 1, 2, 4
_STARTS = (3, 5)
_LEAST = 5  # bytes of a record without data
_COMMENTS = (b";", b"#", b"//")
_HEAD = 4096


def image_bytes(data: bytes, source: str, tell: Callable[[str], None]) -> bytes:
    """The bytes of an EEPROM image: of Intel HEX if the file is that, else those of the file.

    Bytes that no record has are 0xFF, as in an EEPROM that was never written: programs leave such
    blocks out. Records could also be missing, so blocks between others are told.

    Args:
        data: The content of the file.
        source: The file, for messages.
        tell: Called with the blocks that no record has.

    Raises:
        ConfigError: A record is malformed, or lies beyond the largest EEPROM.
    """
    if not _is_intel_hex(data):
        if data.lstrip().startswith((b"S0", b"S1", b"S2", b"S3")) and data.isascii():
            raise ConfigError(
                f"{source}: these are records of Motorola (S-records): convert them, for example "
                "with 'objcopy -I srec -O binary FILE OUT'"
            )
        return data
    image = bytearray()
    written = bytearray()  # 1 for each byte that a record has
    upper = 0
    for number, line in enumerate(data.removeprefix(BOM_UTF8).splitlines(), 1):
        text = line.strip()
        if not text or text.startswith(_COMMENTS):
            continue
        where = f"{source}:{number}: this record of Intel HEX"
        if not text.startswith(b":") or not _is_hex(text):
            raise ConfigError(f"{where} is not a colon and pairs of hexadecimal digits")
        record = bytes.fromhex(text[1:].decode("ascii"))
        if len(record) != _LEAST + record[0] or sum(record) & 0xFF:
            raise ConfigError(f"{where} is damaged: its length or its checksum is wrong")
        kind, content = record[3], record[4:-1]
        if kind == _END:
            if gaps := _gaps(written):
                tell(
                    f"{source}: no record of Intel HEX has the bytes {gaps}; they are taken as 0xFF"
                )
            return bytes(image)
        if kind in (_SEGMENT, _LINEAR) and len(content) == 2:
            upper = int.from_bytes(content, "big") << (4 if kind == _SEGMENT else 16)
        elif kind == _DATA:
            at = upper + int.from_bytes(record[1:3], "big")
            end = at + len(content)
            if end > MAX_IMAGE:
                raise ConfigError(f"{where} is for byte 0x{at:X}: an EEPROM has at most 512 KiB")
            image.extend(b"\xff" * (end - len(image)))
            written.extend(b"\0" * (end - len(written)))
            if any(written[at:end]) and image[at:end] != content:
                raise ConfigError(f"{where} is for byte 0x{at:X}, which has another value before")
            image[at:end] = content
            written[at:end] = b"\x01" * len(content)
        elif kind not in _STARTS:
            raise ConfigError(f"{where} has the unknown type {kind}")
    raise ConfigError(f"{source}: the Intel HEX file has no end (:00000001FF); it may be cut off")


def _is_intel_hex(data: bytes) -> bool:
    """Whether the first line that is no comment is a record."""
    lines = data[:_HEAD].removeprefix(BOM_UTF8).splitlines()
    texts = (line.strip() for line in lines)
    first = next((text for text in texts if text and not text.startswith(_COMMENTS)), b"")
    return first.startswith(b":") and _is_hex(first)


def _gaps(written: bytearray) -> str:
    """`0x40 to 0x5F, 0x80 to 0x8F`: the blocks that no record has; empty if there are none."""
    found = [item.span() for item in re.finditer(b"\0+", written)]
    return ", ".join(f"0x{begin:X} to 0x{end - 1:X}" for begin, end in found)


def _is_hex(line: bytes) -> bool:
    try:
        return len(bytes.fromhex(line[1:].decode("ascii"))) >= _LEAST
    except ValueError:
        return False

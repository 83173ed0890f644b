"""Recognises EEPROM images in Intel HEX, which programmers and some vendors' tools write.

Each line is a record `:LLAAAATT…CC`: number of data bytes, address, type, data, checksum. Type 0
has data, 1 ends the file, 2 and 4 give the upper part of the addresses that follow, and 3 and 5
tell where a program begins, which an EEPROM has not.
"""

from __future__ import annotations

from .errors import ConfigError
from .sii_check import MAX_IMAGE

_DATA, _END, _SEGMENT, _LINEAR = 0, 1, 2, 4
_STARTS = (3, 5)
_LEAST = 5  # bytes of a record without data


def image_bytes(data: bytes, source: str) -> bytes:
    """The bytes of an EEPROM image: of Intel HEX if the file is that, else those of the file.

    Bytes that no record has are 0xFF, as in an EEPROM that was never written.

    Args:
        data: The content of the file.
        source: The file, for messages.

    Raises:
        ConfigError: A record is malformed, or lies beyond the largest EEPROM.
    """
    lines = data.split()
    if not lines or not data.lstrip().startswith(b":") or not _is_hex(lines[0]):
        return data
    image = bytearray()
    upper = 0
    for number, line in enumerate(data.splitlines(), 1):
        text = line.strip()
        if not text:
            continue
        where = f"{source}:{number}: this record of Intel HEX"
        if not text.startswith(b":") or not _is_hex(text):
            raise ConfigError(f"{where} is not a colon and pairs of hexadecimal digits")
        record = bytes.fromhex(text[1:].decode("ascii"))
        if len(record) != _LEAST + record[0] or sum(record) & 0xFF:
            raise ConfigError(f"{where} is damaged: its length or its checksum is wrong")
        kind, content = record[3], record[4:-1]
        if kind == _END:
            return bytes(image)
        if kind in (_SEGMENT, _LINEAR) and len(content) == 2:
            upper = int.from_bytes(content, "big") << (4 if kind == _SEGMENT else 16)
        elif kind == _DATA:
            at = upper + int.from_bytes(record[1:3], "big")
            end = at + len(content)
            if end > MAX_IMAGE:
                raise ConfigError(f"{where} is for byte 0x{at:X}: an EEPROM has at most 512 KiB")
            image.extend(b"\xff" * (end - len(image)))
            image[at:end] = content
        elif kind not in _STARTS:
            raise ConfigError(f"{where} has the unknown type {kind}")
    raise ConfigError(f"{source}: the Intel HEX file has no end (:00000001FF); it may be cut off")


def _is_hex(line: bytes) -> bool:
    try:
        return len(bytes.fromhex(line[1:].decode("ascii"))) >= _LEAST
    except ValueError:
        return False

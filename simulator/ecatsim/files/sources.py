"""Reads the bytes that rig and device files need, from other files or from base64 text."""

from __future__ import annotations

import base64
import binascii
import struct

from ecatd.base.files import check_regular
from ecatd.base.toml_file import Table
from ecatd.etg.intel_hex import image_bytes
from ecatd.etg.sii_check import MAX_IMAGE, sii_checksum

from ..slave.device import Device
from .sii_image import device_from_sii

_PREFIX = "base64:"
_MAX_FILE = 1 << 30
_MAX_IMAGE_FILE = 4 * MAX_IMAGE  # in Intel HEX, a byte takes about three
_ALIAS, _CRC, _SERIAL = 8, 14, 28


def content(table: Table, key: str, most: int = _MAX_FILE) -> bytes:
    """Reads a file, or decodes the text after `base64:`.

    Args:
        table: The table with the key.
        key: The key.
        most: Largest number of bytes to read from a file.

    Raises:
        ConfigError: The file cannot be read, or the text is not base64.
    """
    text = table.text(key)
    if text.startswith(_PREFIX):
        try:
            return base64.b64decode("".join(text[len(_PREFIX) :].split()), validate=True)
        except (binascii.Error, ValueError) as error:
            table.fail(key, f"is not base64 text: {error}")
    path = table.file(key)
    try:
        check_regular(path)
        with path.open("rb") as file:
            return file.read(most)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        table.fail(key, f"'{path}' cannot be read: {reason}")


def sii(table: Table, key: str, *, strict: bool | None = None) -> Device:
    """Makes a device from an SII image.

    Args:
        table: The table with the key.
        key: The key: a path, or `base64:` and the image.
        strict: Whether to refuse an image that violates ETG.2010.

    Raises:
        ConfigError: The file cannot be read, or the image cannot be used.
    """
    inside = table.text(key).startswith(_PREFIX)
    source = table.where(key) if inside else str(table.file(key))
    told: list[str] = []
    image = image_bytes(content(table, key, _MAX_IMAGE_FILE), source, told.append)
    device = device_from_sii(image, source, strict=strict)
    device.remarks = [*told, *device.remarks]
    return device


def patched(image: bytes, alias: int, serial: int) -> bytes:
    """Returns an SII image with another alias and serial number, and a correct checksum."""
    if len(image) < _SERIAL + 4:
        return image  # too short on purpose: `strict = false`
    data = bytearray(image)
    if struct.unpack_from("<H", data, _ALIAS)[0] != alias:
        struct.pack_into("<H", data, _ALIAS, alias)
        struct.pack_into("<H", data, _CRC, sii_checksum(bytes(data[:_CRC])))
    struct.pack_into("<I", data, _SERIAL, serial)
    return bytes(data)

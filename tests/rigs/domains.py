"""Forty slaves that return their 32 bytes; slaves 1 and 10 say that they cannot do LRW."""

import struct

from ecatsim import Rig
from ecatsim.devices.generic import Loopback

WITHOUT_LRW = (1, 10)
_CATEGORIES, _GENERAL = 0x80, 30
_FLAGS, _NO_LRW = 0x0B, 0x02


class WithoutLrw(Loopback):
    order = "NoLRW32"

    def sii_image(self) -> bytes:
        image = bytearray(super().sii_image())
        at = _CATEGORIES
        while (head := struct.unpack_from("<HH", image, at))[0] != _GENERAL:
            at += 4 + 2 * head[1]
        image[at + 4 + _FLAGS] |= _NO_LRW
        return bytes(image)


def rig() -> Rig:
    return Rig("domains", [WithoutLrw() if n in WITHOUT_LRW else Loopback() for n in range(40)])

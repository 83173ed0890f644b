"""Forty slaves that return their 32 bytes; slaves 1 and 10 cannot do LRW.

The first of them says so in its SII, the other only in its controller.
"""

from ecatsim import Chip, Rig
from ecatsim.devices.generic import Loopback
from ecatsim.slave import sii


class WithoutLrw(Loopback):
    order = "NoLRW32"
    chip = Chip(fmmus=4, sync_managers=4, lrw=False)


class Silent(WithoutLrw):
    order = "Silent32"

    def sii_image(self) -> bytes:
        image = bytearray(super().sii_image())
        at = 0x80
        while int.from_bytes(image[at : at + 2], "little") != sii.Category.GENERAL:
            at += 4 + 2 * int.from_bytes(image[at + 2 : at + 4], "little")
        assert image[at + 4 + 0x0B] == 0x02
        image[at + 4 + 0x0B] = 0
        return bytes(image)


def rig() -> Rig:
    special = {1: WithoutLrw(), 10: Silent()}
    return Rig("domains", [special.get(n) or Loopback() for n in range(40)])

"""A generic slave without a mailbox."""

from __future__ import annotations

from ecatd.model.bus import Entry, Pdo
from ecatd.model.datatypes import DataType

from ..core import Chip
from ..slave.device import Device

_BYTES = 32


def _bytes(index: int, word: str) -> list[Entry]:
    return [Entry(index, i, f"{word} {i}", DataType.UNSIGNED8, 8) for i in range(1, _BYTES + 1)]


class Loopback(Device):
    """32 bytes out that come back as 32 bytes in."""

    vendor = 0x0000FFFF
    product = 0x00003232
    revision = 1
    order = "Loopback32"
    name = "32 bytes in and out"
    chip = Chip(fmmus=4, sync_managers=4)
    rx_pdos = (Pdo(0x1600, "Outputs", 0, _bytes(0x7000, "Output")),)
    tx_pdos = (Pdo(0x1A00, "Inputs", 1, _bytes(0x6000, "Input")),)

    _data = bytes(_BYTES)

    def receive(self, data: bytes) -> None:
        """Keeps the outputs as they are: a long line must not cost time."""
        self._data = data

    def give(self) -> bytes:
        """Returns the outputs."""
        return self._data

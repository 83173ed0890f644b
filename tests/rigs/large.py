"""Slaves with more process data than one datagram carries, and small ones between them.

All words that a large slave gives are one counter, except the last two: how often the outputs that
it took were not all equal, and what these were last.
"""

import struct

from ecatsim import Chip, DataType, Device, Entry, Pdo, Rig
from ecatsim.devices.generic import Loopback

WORD = 8
_PER_PDO = 100


def _pdos(first: int, name: str, sync_manager: int, index: int, words: int) -> tuple[Pdo, ...]:
    return tuple(
        Pdo(
            *(first + n, f"{name} {n}", sync_manager),
            [
                Entry(index + n, s, f"{name[0]}{n}_{s}", DataType.UNSIGNED64, 8 * WORD)
                for s in range(1, min(_PER_PDO, words - n * _PER_PDO) + 1)
            ],
        )
        for n in range(-(-words // _PER_PDO))
    )


class Large(Device):
    vendor, revision = 0xFFFF, 1
    outputs_of, inputs_of = 1, 1  # words

    def __init__(self) -> None:
        self.given = self.mixed = self.taken = 0
        super().__init__()

    def receive(self, data: bytes) -> None:
        words = struct.unpack(f"<{len(data) // WORD}Q", data)
        self.mixed += len(set(words)) > 1
        self.taken = words[0]

    def give(self) -> bytes:
        self.given += 1
        words = [*[self.given] * (self.inputs_of - 2), self.mixed, self.taken]
        return struct.pack(f"<{len(words)}Q", *words)


def large(product: int, outputs: int, inputs: int, *, lrw: bool) -> Device:
    class Made(Large):
        order = f"Large{product}"
        chip = Chip(fmmus=4, sync_managers=4, ram_kib=60, lrw=lrw)
        outputs_of, inputs_of = outputs, inputs
        rx_pdos = _pdos(0x1600, "Out", 0, 0x7000, outputs)
        tx_pdos = _pdos(0x1A00, "In", 1, 0x6000, inputs)

    Made.product = product
    return Made()


def rig() -> Rig:
    return Rig(
        "large",
        [
            *(Loopback(), large(1, 400, 200, lrw=True), Loopback()),
            *(large(2, 3, 250, lrw=True), large(3, 190, 20, lrw=False), Loopback()),
        ],
    )

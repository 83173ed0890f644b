"""Another client on the CAN channel of a model, and what it says."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable

from ecatd.client import Client
from ecatd.client.can import CanChannel, CanFrame
from ecatd.shm.contract import CanKind

SLAVE = 7

CONFIG = """
[gateway]
listen = []
[[slave]]
position = 7
name = "canTerminal"
[slave.can]
bit_rate = 500
[[slave.can.safe]]
id = 0x7E5
data = "02 00"
"""
SAFE = 0x7E5


def motor(speed: float, page: int, paged: int, torque: float) -> bytes:
    return struct.pack(">h", round(speed * 10)) + struct.pack("<BBf", page, paged, torque)


class Others:
    """Another client on the same channel."""

    def __init__(self, bus: str, slave: int = SLAVE) -> None:
        self._client = Client(bus)
        self.channel: CanChannel = self._client.can(slave)
        self._seen: list[CanFrame] = []

    def send(self, identifier: int, data: bytes) -> None:
        self.channel.send(identifier, data)
        self.channel.flush(30.0)

    def frames(self, identifier: int) -> list[CanFrame]:
        """All frames with an identifier so far that others have sent or that were received."""
        self._seen += self.channel.read()
        kinds = (CanKind.SENT, CanKind.RECEIVED)
        return [f for f in self._seen if f.kind in kinds and f.identifier == identifier]

    def wait(self, condition: Callable[[], object]) -> None:
        deadline = time.monotonic() + 120
        while not condition():
            assert time.monotonic() < deadline
            time.sleep(0.01)

    def close(self) -> None:
        self._client.close()

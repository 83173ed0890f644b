"""A switch for Ethernet frames: it learns at which port an address is (IEEE 802.1D)."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

_GROUP = 0x01
_ADDRESS = 6
_KNOWN_MAX = 256
"""Most addresses at one port. A device that invents addresses makes others forget only its own."""
_AGE_S = 300.0
"""Seconds after which an address is forgotten that has sent nothing."""

Send = Callable[[bytes], None]


class Switch:
    """Passes frames between its ports.

    Args:
        ports: What sends a frame out of each port.
    """

    def __init__(self, ports: Sequence[Send]) -> None:
        self._ports = ports
        self._port: dict[bytes, int] = {}  # where each known address is
        self._seen: list[dict[bytes, float]] = [{} for _ in ports]  # when, the oldest first

    def forward(self, frame: bytes, port: int) -> None:
        """Takes a frame from a port, and sends it out of those where its receiver may be."""
        now = time.monotonic()
        receiver, sender = frame[:_ADDRESS], frame[_ADDRESS : 2 * _ADDRESS]
        if len(sender) < _ADDRESS:
            return
        if not sender[0] & _GROUP:
            self._learn(sender, port, now)
        found = self._port.get(receiver, -1)
        if found >= 0 and now - self._seen[found][receiver] < _AGE_S:
            ports = [] if found == port else [found]
        else:
            ports = [number for number in range(len(self._ports)) if number != port]
        for number in ports:
            self._ports[number](frame)

    def _learn(self, sender: bytes, port: int, now: float) -> None:
        before = self._port.get(sender, port)
        self._seen[before].pop(sender, None)
        self._seen[port][sender] = now
        self._port[sender] = port
        if len(self._seen[port]) > _KNOWN_MAX:
            oldest = next(iter(self._seen[port]))
            del self._seen[port][oldest], self._port[oldest]

    def addresses(self, port: int) -> list[str]:
        """The addresses that were seen at a port, as texts."""
        limit = time.monotonic() - _AGE_S
        return sorted(mac.hex(":") for mac, seen in self._seen[port].items() if seen > limit)

"""A switch for Ethernet frames: it learns at which port an address is (IEEE 802.1D)."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

_GROUP = 0x01
_ADDRESS = 6
_KNOWN_MAX = 1024
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
        self._known: dict[bytes, tuple[int, float]] = {}  # port, and when it was last seen

    def forward(self, frame: bytes, port: int) -> None:
        """Takes a frame from a port, and sends it out of those where its receiver may be."""
        now = time.monotonic()
        receiver, sender = frame[:_ADDRESS], frame[_ADDRESS : 2 * _ADDRESS]
        if len(sender) < _ADDRESS:
            return
        if not sender[0] & _GROUP:
            self._learn(sender, port, now)
        found, seen = self._known.get(receiver, (-1, 0.0))
        if found >= 0 and now - seen < _AGE_S:
            ports = [] if found == port else [found]
        else:
            ports = [number for number in range(len(self._ports)) if number != port]
        for number in ports:
            self._ports[number](frame)

    def _learn(self, sender: bytes, port: int, now: float) -> None:
        if sender not in self._known and len(self._known) >= _KNOWN_MAX:
            oldest = min(self._known, key=lambda address: self._known[address][1])
            del self._known[oldest]
        self._known[sender] = port, now

    def addresses(self, port: int) -> list[str]:
        """The addresses that were seen at a port, as texts."""
        limit = time.monotonic() - _AGE_S
        known = list(self._known.items())
        return sorted(mac.hex(":") for mac, (at, seen) in known if at == port and seen > limit)

"""One line of slaves for several masters that take turns.

Every master has FMMUs of its own, which map the process data to its own logical addresses. Only the
FMMUs of the master whose turn it is are switched on. The slaves stay in OP, so turns can be short.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence

from ecatd.description.bus import Bus
from ecatd.master.engine.process_image import Image

from .frames import APRD, Exchange, Line, ask, frame

PER_MASTER = 2
_FMMU, _FMMU_BYTES, _ACTIVATE = 0x0600, 16, 12

Map = Sequence[bytes]
"""The FMMU registers of a master, for each slave."""


class SharedLine(Line):
    """The slaves of `cells.line`.

    Args:
        exchange: Exchanges a frame with the slaves.
        bus: The bus, after its process data were laid out for the engine.
        image: The process image of the engine, which has one domain.
    """

    def __init__(self, exchange: Exchange, bus: Bus, image: Image) -> None:
        super().__init__(exchange, len(bus.slaves), bus.slaves[0].output_bytes)
        self._bus = bus
        (self._domain,) = image.domains
        self._maps: list[Map] = []

    @contextlib.contextmanager
    def over(self, exchange: Exchange) -> Iterator[None]:
        """Uses another `exchange` within the context."""
        before, self._exchange = self._exchange, exchange
        try:
            yield
        finally:
            self._exchange = before

    def saved(self) -> Map:
        """Returns the FMMU registers of the master that has just set up the slaves."""
        size = PER_MASTER * _FMMU_BYTES
        return [
            ask(self._exchange, frame(APRD, -slave, _FMMU, bytes(size)))[0]
            for slave in range(self.count)
        ]

    def share(self, others: Sequence[Map]) -> None:
        """Brings the slaves to OP for all masters: for the engine, number 0, and then `others`."""
        self._maps = [*others]
        self.bring_to_op()

    def _fmmus(self, slave: int) -> bytes:
        base, where = self._domain.address, self._bus.slaves[slave]
        ours = self._pair(base + where.output_offset, base + where.input_offset)
        return ours + b"".join(self._switched_off(map[slave]) for map in self._maps)

    @staticmethod
    def _switched_off(fmmus: bytes) -> bytes:
        return b"".join(
            fmmus[at : at + _ACTIVATE] + bytes(1) + fmmus[at + _ACTIVATE + 1 : at + _FMMU_BYTES]
            for at in range(0, len(fmmus), _FMMU_BYTES)
        )

    def turn(self, number: int) -> None:
        """Switches the FMMUs of one master on, and those of the others off.

        Args:
            number: 0 for the engine; 1 for the first of the other masters in `share`, and so on.
        """
        for master in range(1 + len(self._maps)):
            for channel in range(PER_MASTER):
                at = _FMMU + _FMMU_BYTES * (PER_MASTER * master + channel) + _ACTIVATE
                self._broadcast(at, bytes([master == number]))

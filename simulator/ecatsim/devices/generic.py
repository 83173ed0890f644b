"""Generic slaves: a loopback of bytes, and digital and analog inputs and outputs."""

from __future__ import annotations

from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo

from ..esc import Chip
from ..slave.device import Device
from ..slave.sii import Mailbox
from .parameters import Parameter, revision_of

_VENDOR = 0x0000FFFF
_BYTES = 32
_MAX_BITS = 120  # the names of more entries would not fit into the SII
_MAX_CHANNELS = 32


def _bytes(index: int, word: str) -> list[Entry]:
    return [Entry(index, i, f"{word} {i}", DataType.UNSIGNED8, 8) for i in range(1, _BYTES + 1)]


class Loopback(Device):
    """32 bytes out that come back as 32 bytes in."""

    vendor = _VENDOR
    product = 0x00003232
    revision = 1
    order = "Loopback32"
    name = "32 bytes in and out"
    chip = Chip(fmmus=4, sync_managers=4)
    rx_pdos = (Pdo(0x1600, "Outputs", 0, _bytes(0x7000, "Output")),)
    tx_pdos = (Pdo(0x1A00, "Inputs", 1, _bytes(0x6000, "Input")),)

    _data = bytes(_BYTES)

    def receive(self, data: bytes) -> None:
        """Keeps the outputs as bytes, which makes long lines of slaves fast."""
        self._data = data

    def give(self) -> bytes:
        """Returns the outputs."""
        return self._data

    def rests(self) -> bool:
        """Always: the inputs are the outputs."""
        return True


class DigitalIO(Device):
    """Generic digital inputs and outputs, one bit each.

    Inputs are 0x6000:01 and following, outputs 0x7000:01 and following.

    Args:
        inputs: Number of inputs.
        outputs: Number of outputs.
    """

    vendor = _VENDOR
    product = 0x00000D10
    revision = 1
    order = "DigitalIO"
    name = "Digital inputs and outputs"
    chip = Chip(fmmus=4, sync_managers=4)
    parameters = (
        Parameter("inputs", "number of inputs", 8, 0, _MAX_BITS),
        Parameter("outputs", "number of outputs", 8, 0, _MAX_BITS),
    )

    def __init__(self, inputs: int = 8, outputs: int = 8) -> None:
        manager = 1 if outputs else 0
        self.rx_pdos = _bits(0x1600, 0x7000, "Output", outputs, 0)
        self.tx_pdos = _bits(0x1A00, 0x6000, "Input", inputs, manager)
        self.revision = revision_of(self.parameters, inputs, outputs)
        super().__init__()


def _bits(mapping: int, index: int, word: str, count: int, manager: int) -> tuple[Pdo, ...]:
    bits = [Entry(index, i, f"{word} {i}", DataType.BOOLEAN, 1) for i in range(1, count + 1)]
    return (Pdo(mapping, f"{word}s", manager, bits),) if bits else ()


class AnalogIO(Device):
    """Generic analog inputs and outputs, with CoE.

    Inputs are 0x6000:01 and following, outputs 0x7000:01 and following. They are signed, with plus
    and minus full scale at the ends of the range.

    Args:
        inputs: Number of inputs.
        outputs: Number of outputs.
        bits: Bits per channel, 16 or 32.
        range: Full scale, in `unit`.
        unit: Unit of the scaled value.
    """

    vendor = _VENDOR
    product = 0x00000A10
    revision = 1
    order = "AnalogIO"
    name = "Analog inputs and outputs"
    mailbox = Mailbox()
    parameters = (
        Parameter("inputs", "number of inputs", 4, 0, _MAX_CHANNELS),
        Parameter("outputs", "number of outputs", 4, 0, _MAX_CHANNELS),
        Parameter("bits", "bits a channel", 16, choices=(16, 32)),
        Parameter("range", "full scale, in unit", 10.0, 1e-9, 1e9),
        Parameter("unit", "unit of the scaled value", "V"),
    )

    def __init__(
        self,
        inputs: int = 4,
        outputs: int = 4,
        bits: int = 16,
        range: float = 10.0,
        unit: str = "V",
    ) -> None:
        kind = DataType.INTEGER32 if bits == 32 else DataType.INTEGER16
        scale = range / ((1 << bits - 1) - 1)

        def pdos(mapping: int, index: int, word: str, count: int, manager: int) -> tuple[Pdo, ...]:
            entries = [
                Entry(index, i, f"{word} {i}", kind, bits, unit, scale)
                for i, _ in enumerate([None] * count, 1)
            ]
            return (Pdo(mapping, f"{word}s", manager, entries),) if entries else ()

        self.rx_pdos = pdos(0x1600, 0x7000, "Output", outputs, 2)
        self.tx_pdos = pdos(0x1A00, 0x6000, "Input", inputs, 3)
        self.revision = revision_of(self.parameters, inputs, outputs, bits, float(range), unit)
        super().__init__()

"""A rotary encoder with the device profile CiA 406."""

from __future__ import annotations

import math

from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo

from ..slave.device import Device
from ..slave.objects import Access, Value, Variable
from ..slave.sii import Mailbox
from .parameters import Parameter, revision_of

_U16, _U32, _I16 = DataType.UNSIGNED16, DataType.UNSIGNED32, DataType.INTEGER16
_OPERATING, _PER_TURN, _RANGE, _PRESET, _POSITION = 0x6000, 0x6001, 0x6002, 0x6003, 0x6004
_SPEED = 0x6030
_COUNTER_CLOCKWISE, _SCALED = 0x1, 0x4  # bits of the operating parameters
_MULTI_TURN = 2 << 16 | 406
_MINUTE = 60.0


class Encoder(Device):
    """Absolute rotary encoder (CiA 406): position in counts, speed in revolutions a minute.

    A wire or waveform gives the angle of the shaft at 0x6004, in rad. 0x6000 turns the direction
    around (bit 0), and switches on the scaling (bit 2) with 0x6001 and 0x6002. A write of 0x6003
    makes the present position this value, which stays so without power.

    Args:
        resolution: Counts per revolution.
        turns: Revolutions that it distinguishes.
    """

    vendor = 0x0000FFFF
    product = 0x00000406
    revision = 1
    order = "Encoder"
    name = "Absolute encoder"
    device_type = _MULTI_TURN
    mailbox = Mailbox()
    parameters = (
        Parameter("resolution", "counts per revolution", 8192, 1, 65536),
        Parameter("turns", "revolutions that it distinguishes", 4096, 1, 65535),
    )

    def __init__(self, resolution: int = 8192, turns: int = 4096) -> None:
        self._resolution, self._turns = resolution, turns
        self._offset = 0  # from the shaft to the position, in counts
        self._last: tuple[float, float] | None = None  # time, and counts of the shaft
        position = Entry(_POSITION, 0, "Position value", _U32, 32, "rad", 2 * math.pi / resolution)
        speed = Entry(_SPEED, 1, "Speed value", _I16, 16, "rpm")
        self.tx_pdos = (Pdo(0x1A00, "Position and speed", 3, [position, speed]),)
        self.revision = revision_of(self.parameters, resolution, turns)
        # The shaft may be anywhere, and turns on beyond the range of the position.
        self._shaft = Variable(_POSITION, 0, "Shaft", DataType.REAL64, 64, value=0.0)
        super().__init__()
        self._shaft.owner = self.dictionary

    def describe(self) -> None:
        """Adds the objects of the profile."""
        objects, counts = self.dictionary, self._resolution * self._turns
        objects.variable(_OPERATING, "Operating parameters", _U16, 0, Access.RW)
        for index, name, value, most in (
            (_PER_TURN, "Measuring units per revolution", self._resolution, self._resolution),
            (_RANGE, "Total measuring range in measuring units", counts, counts),
        ):
            entry = objects.variable(index, name, _U32, value, Access.RW)
            entry.minimum, entry.maximum = 1, most
        preset = objects.variable(_PRESET, "Preset value", _U32, 0, Access.RW)
        preset.maximum, preset.on_write = counts - 1, self._set_position
        objects.variable(0x6501, "Single-turn resolution", _U32, self._resolution)
        objects.variable(0x6502, "Number of distinguishable revolutions", _U16, self._turns)

    def connection(self, index: int, subindex: int) -> Variable:
        """Returns the shaft for the position, so that a wire ends there."""
        return (
            self._shaft
            if (index, subindex) == (_POSITION, 0)
            else super().connection(index, subindex)
        )

    def step(self, now: float) -> None:
        """Measures position and speed of the shaft."""
        shaft = self._counts()
        self[_POSITION, 0] = (shaft + self._offset) % self._range
        speed = 0
        if self._last is not None and now > self._last[0]:
            turns = (shaft - self._last[1]) / self._per_turn
            speed = round(turns / (now - self._last[0]) * _MINUTE)
        self[_SPEED, 1] = max(-0x8000, min(0x7FFF, speed))
        self._last = (now, shaft)

    def rests(self) -> bool:
        """Always: while the shaft turns, it changes in each step."""
        return True

    def _set_position(self, value: Value) -> None:
        self._offset = int(value) - self._counts()

    def _counts(self) -> int:
        """The angle of the shaft since the start, in the counts of the position."""
        turns = float(self._shaft.value) / self._resolution
        counts = math.floor(turns * self._per_turn)
        return -counts if self[_OPERATING, 0] & _COUNTER_CLOCKWISE else counts

    @property
    def _per_turn(self) -> int:
        return self[_PER_TURN, 0] if self[_OPERATING, 0] & _SCALED else self._resolution

    @property
    def _range(self) -> int:
        return self[_RANGE, 0] if self[_OPERATING, 0] & _SCALED else self._resolution * self._turns

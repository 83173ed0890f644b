"""A torque sensor that sends many frames."""

from __future__ import annotations

from ...devices.parameters import Parameter
from ..node import CanNode
from ..traffic import Traffic

_FAST_HZ, _SLOW_HZ, _SLOW = 500.0, 100.0, 13


class TorqueSensor(CanNode):
    """Torque sensor with 1800 extended frames a second: one of 500 Hz, and 13 of 100 Hz.

    It is as busy as one that is used behind an EL6751. Its data are frame numbers, so that a test
    sees what is missing. The frames of 100 Hz have the identifiers that follow the first one.

    Args:
        id: Identifier of the frame of 500 Hz.
        bit_rate: Its bit rate; 0: that of the bus.
    """

    parameters = (Parameter("id", "identifier of its first frame", 0x18FF0000, 0, 0x1FFFFF00),)

    def __init__(self, id: int = 0x18FF0000, bit_rate: int = 0) -> None:
        super().__init__("torque sensor", bit_rate, traffic=sensor_traffic(id))


def sensor_traffic(first: int) -> list[Traffic]:
    """The frames of the sensor, for a check of them."""
    slow = [Traffic(first + n, extended=True, rate=_SLOW_HZ) for n in range(1, _SLOW + 1)]
    return [Traffic(first, extended=True, rate=_FAST_HZ), *slow]

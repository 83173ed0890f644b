"""A CANopen node with inputs and outputs (CiA 401)."""

from __future__ import annotations

from ecatd.etg.datatypes import DataType

from ...devices.parameters import Parameter
from ...slave.objects import Access, Dictionary
from ...slave.standard_objects import add_identity
from ..canopen import CanopenNode

_PROFILE = 0x000F0191  # digital and analog inputs and outputs
_U8, _I16 = DataType.UNSIGNED8, DataType.INTEGER16
_DIGITAL_INPUTS, _DIGITAL_OUTPUTS = (0x6000, 1), (0x6200, 1)
_ANALOG_INPUTS, _ANALOG_OUTPUTS = 0x6401, 0x6411
_CHANNELS = 2


class CanopenIO(CanopenNode):
    """CANopen node (CiA 401) with 8 inputs, 8 outputs, 2 analog inputs and 2 analog outputs.

    Its outputs are wired to its inputs. Outside of OPERATIONAL, its outputs are 0.

    Args:
        node_id: Its node number.
        heartbeat_ms: Time between two heartbeats; 0: none.
        bit_rate: Its bit rate; 0: that of the bus.
    """

    parameters = (
        Parameter("node_id", "node number", 2, 1, 127),
        Parameter("heartbeat_ms", "time between two heartbeats, 0 for none", 100, 0, 65535),
    )

    def __init__(self, node_id: int = 2, heartbeat_ms: int = 100, bit_rate: int = 0) -> None:
        analog = [[(index, n) for n in (1, 2)] for index in (_ANALOG_OUTPUTS, _ANALOG_INPUTS)]
        super().__init__(
            node_id,
            _objects(),
            ((_DIGITAL_OUTPUTS,), analog[0]),
            ((255, (_DIGITAL_INPUTS,)), (255, analog[1])),
            heartbeat_ms=heartbeat_ms,
            name=f"CANopen I/O {node_id}",
            bit_rate=bit_rate,
        )

    def work(self, now: float) -> None:
        """Carries outputs to inputs."""
        del now
        objects = self.dictionary
        objects[_DIGITAL_INPUTS].value = objects[_DIGITAL_OUTPUTS].value
        for channel in range(1, _CHANNELS + 1):
            objects[_ANALOG_INPUTS, channel].value = objects[_ANALOG_OUTPUTS, channel].value

    def left_operational(self) -> None:
        """Switches all outputs off."""
        self.dictionary[_DIGITAL_OUTPUTS].value = 0
        for channel in range(1, _CHANNELS + 1):
            self.dictionary[_ANALOG_OUTPUTS, channel].value = 0


def _objects() -> Dictionary:
    objects = Dictionary()
    add_identity(objects, _PROFILE, "CANopen I/O", (0x0000FFFF, 0x00000401, 1, 0))
    for index, name, kind, count, outputs in (
        (0x6000, "Read input 8-bit", _U8, 1, False),
        (0x6200, "Write output 8-bit", _U8, 1, True),
        (_ANALOG_INPUTS, "Read analogue input 16-bit", _I16, _CHANNELS, False),
        (_ANALOG_OUTPUTS, "Write analogue output 16-bit", _I16, _CHANNELS, True),
    ):
        access = Access.RW | Access.RX_PDO if outputs else Access.RO | Access.TX_PDO
        item = objects.array(index, name, kind, [0] * count, access)
        item.entries[0].access = Access.RO
    return objects

"""A rig with a slave that never comes to an end, and one that works.

What the first one does is chosen by the object or the file that it is asked for.
"""

import struct

from ecatsim.devices.generic import AnalogIO
from ecatsim.devices.generic_drive import CiA402Drive
from ecatsim.esc import Event
from ecatsim.rig import Rig
from ecatsim.slave.mailbox import Protocol
from ecatsim.slave.sii import Mailbox

DRIP, SLOW_DRIP, WRONG_TOGGLE, BEGINS_AGAIN = 0x5001, 0x5002, 0x5003, 0x5004
ANNOUNCED = 60_000
_SDO, _INFORMATION = 3, 8
_DATA, _ACKNOWLEDGED, _BUSY = 3, 4, 6


class Endless(AnalogIO):
    """Sends one byte in a segment, descriptions and files without end, and is busy for ever."""

    vendor, product, order = 0xFFFF, 77, "Endless"
    mailbox = Mailbox(0x1000, 128, 0x1080, 128, protocols=0x0C, coe_details=0x03)
    slow_s = 0.9
    endless = DRIP, SLOW_DRIP, WRONG_TOGGLE, BEGINS_AGAIN
    _object = _toggle = 0
    _file = ""

    def handle(self, event: Event, now: float) -> None:
        self._take_over()
        super().handle(event, now)

    def run(self, now: float) -> None:
        self._take_over()
        super().run(now)

    def _take_over(self) -> None:
        handlers = self._services.server.handlers if self._services else {}
        if handlers.get(Protocol.COE) not in (None, self._coe):
            self._own_coe, handlers[Protocol.COE] = handlers[Protocol.COE], self._coe
        if Protocol.FOE in handlers:
            handlers[Protocol.FOE] = self._foe

    def _coe(self, body: bytes) -> list[bytes]:
        service, command = body[1] >> 4, body[2]
        self.answer_delay = 0.0
        if service == _INFORMATION:
            wanted = body[6:8]
            head = struct.pack("<HBBH", _INFORMATION << 12, body[2] + 1 | 0x80, 0, 1)
            return [head + wanted] + [head] * 50
        if command & 0xE0 == 0x40:
            self._object, self._toggle = struct.unpack_from("<H", body, 3)[0], 0
        if self._object not in self.endless:
            return self._own_coe(body)
        if self._object == SLOW_DRIP:
            self.answer_delay = self.slow_s
        if command & 0xE0 == 0x40 or self._object == BEGINS_AGAIN:
            sdo = b"\x41" + struct.pack("<HBI", self._object, body[5], ANNOUNCED) + b"x"
        else:
            sdo = bytes([self._toggle | 6 << 1]) + b"x".ljust(7, b"\0")
            self._toggle ^= 0 if self._object == WRONG_TOGGLE else 0x10
        return [struct.pack("<H", _SDO << 12) + sdo]

    def _foe(self, body: bytes) -> list[bytes]:
        operation, number = struct.unpack_from("<BxI", body)
        self.answer_delay = 0.0
        if operation in (1, 2):
            self._file = body[6:].decode()
            number = 0
        if self._file == "busy":
            return [struct.pack("<BxHH", _BUSY, 1, 2) + b"soon"]
        if self._file == "slow":
            self.answer_delay = self.slow_s
        if operation in (2, 3):
            return [struct.pack("<BxI", _ACKNOWLEDGED, number)]
        if operation in (1, 4):
            return [struct.pack("<BxI", _DATA, number + 1) + bytes(128 - 12)]
        return []


class AtStart(Endless):
    """The same for the list of its PDOs, which ecatd reads at the start."""

    product, order = 78, "AtStart"
    endless = (0x1C13,)


def rig() -> Rig:
    return Rig("endless", [Endless(), CiA402Drive(), AtStart()])

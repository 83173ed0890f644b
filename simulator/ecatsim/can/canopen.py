"""A CANopen slave (CiA 301): NMT, SDO server, PDOs, SYNC, heartbeats and emergencies."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import IntEnum

from ecatd.base.errors import UsageError
from ecatd.etg.al import AlState
from ecatd.etg.datatypes import DataType

from ..slave.objects import Access, Dictionary, Variable
from ..slave.sdo import SdoServer
from .canopen_pdos import ReceivePdo, TransmitPdo
from .frame import CanFrame, Filter
from .node import CanNode

_U8, _U16, _U32 = DataType.UNSIGNED8, DataType.UNSIGNED16, DataType.UNSIGNED32
_NMT, _SYNC = 0x000, 0x080
_EMERGENCY, _SDO_ANSWER, _SDO_REQUEST, _HEARTBEAT = 0x080, 0x580, 0x600, 0x700
_FRAME_SIZE = 8
_HEARTBEAT_LOST = 0x8130
_COMMUNICATION_ERROR, _GENERIC_ERROR = 0x10, 0x01
_ERRORS_KEPT = 8


class NmtState(IntEnum):
    """NMT states, as heartbeats tell them."""

    BOOT_UP = 0
    STOPPED = 4
    OPERATIONAL = 5
    PRE_OPERATIONAL = 127


class _Command(IntEnum):
    START = 1
    STOP = 2
    ENTER_PRE_OPERATIONAL = 128
    RESET_NODE = 129
    RESET_COMMUNICATION = 130


class CanopenNode(CanNode):
    """A CANopen slave with an object dictionary.

    After power-on it sends its boot-up message, and waits in PRE-OPERATIONAL. If a heartbeat that
    it watches (0x1016) does not come, it sends emergency 0x8130 and goes back to PRE-OPERATIONAL.

    Args:
        node_id: Its node number, 1 to 127.
        dictionary: Its objects; those of communication are added.
        receive: Its RPDOs: for each, the mapped objects (index, subindex).
        transmit: Its TPDOs: for each, the transmission type and the mapped objects. More than four
            of a direction have no identifier of their own, until a master gives them one.
        heartbeat_ms: Time between two heartbeats (0x1017); 0: none.
        name: Its name.
        bit_rate: Its bit rate; 0: that of the bus.

    Attributes:
        node_id: Its node number.
        dictionary: Its objects.
        state: Its NMT state.
    """

    def __init__(
        self,
        node_id: int,
        dictionary: Dictionary,
        receive: Sequence[Sequence[tuple[int, int]]] = (),
        transmit: Sequence[tuple[int, Sequence[tuple[int, int]]]] = (),
        *,
        heartbeat_ms: int = 0,
        name: str = "",
        bit_rate: int = 0,
    ) -> None:
        if not 1 <= node_id <= 127:
            raise UsageError(f"CANopen node {node_id}: nodes have the numbers 1 to 127")
        super().__init__(name, bit_rate)
        self.node_id = node_id
        self.dictionary = dictionary
        self.state = NmtState.BOOT_UP
        self._sdo = SdoServer(dictionary, self._access_state, _FRAME_SIZE, complete_access=False)
        self._add_objects(heartbeat_ms)
        self._receive = [
            ReceivePdo(dictionary, number, node_id, mapped)
            for number, mapped in enumerate(receive, 1)
        ]
        self._transmit = [
            TransmitPdo(dictionary, number, node_id, mapped, kind)
            for number, (kind, mapped) in enumerate(transmit, 1)
        ]
        dictionary.remember()
        self._next_heartbeat = 0.0
        self._watched_until: float | None = None
        self._now = 0.0
        # Only what concerns it costs time: frames to it, NMT, SYNC, and watched heartbeats.
        self.filters = (Filter(0, 0x57F), Filter(_SDO_REQUEST + node_id), Filter(0x701, 0x77F))

    # --- for subclasses ------------------------------------------------------------------------

    def work(self, now: float) -> None:
        """Makes a step of the device, between its RPDOs and its TPDOs.

        Args:
            now: CLOCK_MONOTONIC in seconds.
        """

    def left_operational(self) -> None:
        """Called when it leaves OPERATIONAL, for whatever reason: outputs must become safe."""

    def reset_application(self) -> None:
        """Called at power-on, and for NMT "reset node", when objects have their first values."""

    # --- for users -----------------------------------------------------------------------------

    def emergency(self, code: int, register: int, data: bytes = b"") -> None:
        """Sets the error register 0x1001, and sends an emergency.

        Args:
            code: Error code (CiA 301); 0 means that the error is gone.
            register: New value of 0x1001.
            data: Device-specific data, at most five bytes.
        """
        self.dictionary[0x1001, 0].value = register
        self._remember_error(code)
        if self.state in (NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL):
            body = struct.pack("<HB", code, register) + data.ljust(5, b"\0")
            self.send(CanFrame(self._number(0x1014, 0), body))

    # --- objects -------------------------------------------------------------------------------

    def _add_objects(self, heartbeat_ms: int) -> None:
        objects, own = self.dictionary, self.node_id
        objects.array(0x1003, "Pre-defined error field", _U32, [0] * _ERRORS_KEPT)
        objects[0x1003, 0].value = 0
        objects[0x1003, 0].access, objects[0x1003, 0].maximum = Access.RW, 0  # 0 clears it
        objects.variable(0x1005, "COB-ID SYNC", _U32, _SYNC, Access.RW)
        objects.variable(0x1014, "COB-ID EMCY", _U32, _EMERGENCY + own)
        objects.array(0x1016, "Consumer heartbeat time", _U32, [0], Access.RW)
        objects[0x1016, 0].access = Access.RO
        objects.variable(0x1017, "Producer heartbeat time", _U16, heartbeat_ms, Access.RW)
        objects.record(
            0x1200,
            "SDO server parameter",
            [
                Variable(0x1200, 1, "COB-ID client to server", _U32, value=_SDO_REQUEST + own),
                Variable(0x1200, 2, "COB-ID server to client", _U32, value=_SDO_ANSWER + own),
            ],
            type=0x22,
        )

    def _number(self, index: int, subindex: int) -> int:
        value = self.dictionary[index, subindex].value
        assert isinstance(value, int)
        return value

    def _remember_error(self, code: int) -> None:
        if not code:
            return
        entries = self.dictionary.object(0x1003).entries
        for number in range(_ERRORS_KEPT, 1, -1):
            entries[number].value = entries[number - 1].value
        entries[1].value = code
        entries[0].value = min(_ERRORS_KEPT, self._number(0x1003, 0) + 1)

    @property
    def application(self) -> dict[str, str | float]:
        """Its NMT state."""
        return {"nmt": self.state.name.lower().replace("_", "-")}

    def _access_state(self) -> AlState:
        """The state by which objects can be written; those of EtherCAT count as CANopen's."""
        operational = self.state == NmtState.OPERATIONAL
        return AlState.OP if operational else AlState.PREOP

    # --- behaviour -----------------------------------------------------------------------------

    def started(self) -> None:
        """Begins as after power-on."""
        self._boot(application=True)

    def _boot(self, *, application: bool) -> None:
        self._leave_operational()
        if application:
            self.dictionary.restore()
            self.reset_application()
        else:
            self._restore_communication()
        self._sdo.reset()
        self._watched_until = None
        for pdo in (*self._receive, *self._transmit):
            pdo.reset()
        self.send(CanFrame(_HEARTBEAT + self.node_id, b"\0"))
        self.state = NmtState.PRE_OPERATIONAL
        self._next_heartbeat = self._now

    def _restore_communication(self) -> None:
        for item in self.dictionary:
            if 0x1000 <= item.index <= 0x1FFF:
                for entry in item.entries.values():
                    if entry.initial is not None:
                        entry.value = entry.initial

    def _leave_operational(self) -> None:
        if self.state == NmtState.OPERATIONAL:
            self.state = NmtState.PRE_OPERATIONAL
            self.left_operational()

    def on_frame(self, frame: CanFrame) -> None:
        """Takes a frame: NMT, SYNC, SDO, PDO, or a heartbeat."""
        if frame.extended:
            return
        if frame.id == _NMT:
            self._take_command(frame.data)
        elif frame.id == _SDO_REQUEST + self.node_id:
            if self.state != NmtState.STOPPED and len(frame.data) == _FRAME_SIZE:
                self._answer(frame.data)
        elif frame.id == self._number(0x1005, 0) & 0x7FF:
            self._take_sync()
        elif frame.id > _HEARTBEAT:
            self._take_heartbeat(frame)
        elif self.state == NmtState.OPERATIONAL:
            self._take_pdo(frame)

    def _take_command(self, data: bytes) -> None:
        if len(data) < 2 or data[1] not in (0, self.node_id):
            return
        command = data[0]
        if command == _Command.START and self.state != NmtState.OPERATIONAL:
            self.state = NmtState.OPERATIONAL
            for pdo in self._transmit:
                pdo.reset()
        elif command in (_Command.STOP, _Command.ENTER_PRE_OPERATIONAL):
            self._leave_operational()
            stop = command == _Command.STOP
            self.state = NmtState.STOPPED if stop else NmtState.PRE_OPERATIONAL
        elif command in (_Command.RESET_NODE, _Command.RESET_COMMUNICATION):
            self._boot(application=command == _Command.RESET_NODE)

    def _answer(self, request: bytes) -> None:
        answer = self._sdo.handle(request)
        if answer:
            self.send(CanFrame(_SDO_ANSWER + self.node_id, answer))

    def _take_pdo(self, frame: CanFrame) -> None:
        for received in self._receive:
            received.take(frame)
        if frame.remote:
            for pdo in self._transmit:
                if pdo.identifier == frame.id:
                    self.send(pdo.frame(self._now))

    def _take_sync(self) -> None:
        if self.state != NmtState.OPERATIONAL:
            return
        for received in self._receive:
            received.sync()
        for pdo in self._transmit:
            if pdo.due_at_sync():
                self.send(pdo.frame(self._now))

    def _take_heartbeat(self, frame: CanFrame) -> None:
        watched = self._number(0x1016, 1)
        milliseconds = watched & 0xFFFF
        if milliseconds and frame.id - _HEARTBEAT == watched >> 16 & 0x7F:
            self._watched_until = self._now + milliseconds / 1000

    def step(self, now: float) -> None:
        """Works, and sends what is due."""
        self._now = now
        if not self.on:
            return
        if self._watched_until is not None and now > self._watched_until:
            self._watched_until = None
            self.emergency(_HEARTBEAT_LOST, _GENERIC_ERROR | _COMMUNICATION_ERROR)
            self._leave_operational()
        self.work(now)
        if self.state == NmtState.OPERATIONAL:
            for pdo in self._transmit:
                if pdo.due(now):
                    self.send(pdo.frame(now))
        period = self._number(0x1017, 0) / 1000
        if period and now >= self._next_heartbeat:
            self.send(CanFrame(_HEARTBEAT + self.node_id, bytes([self.state])))
            due = self._next_heartbeat + period
            self._next_heartbeat = due if due > now else now + period

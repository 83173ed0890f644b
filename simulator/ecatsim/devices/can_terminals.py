"""Terminals with a CAN bus behind them, in CAN interface mode.

Layouts and objects are those of `ecatd.etg.can_terminals`, which says where each of them comes
from. What no source says is chosen so that a master has the harder task: the answer to the
handshake is late, a terminal keeps few frames, and those that wait are dropped when it leaves OP.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

from ecatd.etg import can_terminals as table
from ecatd.etg import error_codes
from ecatd.etg.al import AlState
from ecatd.etg.can_terminals import Messages, Mode
from ecatd.etg.datatypes import DataType
from ecatd.etg.error_codes import abort_error
from ecatd.etg.pdo import Entry, Pdo

from ..can.bus import CanBus, NodeState
from ..can.terminal import TerminalPort
from ..slave.device import Device
from ..slave.objects import Access, Value, Variable
from ..slave.pdo_objects import follow_list_procedure
from ..slave.sii import Mailbox, SmType, SyncManager
from .beckhoff.terminal import COMPLEX_CHIP, COMPLEX_FMMUS, VENDOR
from .parameters import Parameter

_OUTPUTS, _INPUTS, _STATUS = 0x1600, 0x1A00, 0x1A85
_BUS, _CONFIGURATION, _FILTERS, _DIAGNOSIS = 0xF800, 0x8000, 0x8001, 0xF108
_RATE, _KEPT_AT = 0x02, 0x0F
_FLAGS, _RECEIVE, _SEND = 0x20, 0x21, 0x22
_EXTENDED = 0x0008
_BUFFERS, _ONE_BUFFER = 0x03, 0x02  # bits of the control byte of a sync manager
_QUEUE, _KEPT = 10, 100
_MAX_FILTERS = 32
_U8, _U16, _U32 = DataType.UNSIGNED8, DataType.UNSIGNED16, DataType.UNSIGNED32
_RAW = DataType.OCTET_STRING
_CONFIGURABLE = Access.READ | Access.WRITE_PREOP
_SYNC_MANAGERS = (
    SyncManager(SmType.MAILBOX_OUT, 0x1000, 1024, 0x26),
    SyncManager(SmType.MAILBOX_IN, 0x1400, 1024, 0x22),
    SyncManager(SmType.OUTPUTS, 0x1800, 0, 0x24, enable=0),
    SyncManager(SmType.INPUTS, 0x2400, 0, 0x20, enable=0),
)
"""Addresses as in DLR's example; they leave room for three buffers of the longest queues."""

_PARAMETERS = (
    Parameter("handshake_cycles", "cycles to the answer of the terminal", 2, 1, 4),
    Parameter("mode", "how frames go through the process data", "buffered", choices=tuple(Mode)),
    Parameter("kept", "frames that each queue of it holds; 0: as the master says", 0, 0, 65535),
)


class CanTerminal(Device):
    """The base class of terminals with a CAN bus.

    Args:
        bus: The bus; None: one of its own.
        handshake_cycles: Cycles from a batch of the master, or from an acknowledgement, to the
            answer of the terminal.
        mode: How frames go through the process data.
        kept: Frames that each of its queues holds; 0: as the master says.

    Attributes:
        told: What the manuals say about it.
        can: Its node on the bus.
    """

    told: ClassVar[table.Terminal]
    parameters: ClassVar[tuple[Parameter, ...]] = _PARAMETERS
    chip = COMPLEX_CHIP
    mailbox = Mailbox(0x1000, 1024, 0x1400, 1024, coe_details=0x2F)
    sync_managers: Sequence[SyncManager] | None = _SYNC_MANAGERS
    fmmus = COMPLEX_FMMUS
    pdos_in_sii = False
    sync_parameters = True

    def __init__(
        self,
        bus: CanBus | None = None,
        *,
        handshake_cycles: int = 2,
        mode: str = Mode.BUFFERED,
        kept: int = 0,
    ) -> None:
        self._handshake, self._mode, self._kept = handshake_cycles, Mode(mode), kept
        if self._mode is Mode.OPTIMIZED:
            self.sync_managers = [_one_buffer(sm) for sm in _SYNC_MANAGERS]
        self.rx_pdos, self.tx_pdos = self._pdos(min(self.told.layouts), *self._first_queues)
        self.plug(bus or CanBus())
        super().__init__()

    def plug(self, bus: CanBus) -> None:
        """Plugs it into a bus, before it is on a segment."""
        self.can = TerminalPort(bus, self.order, recovers=self.told.recovers)

    @property
    def _first_queues(self) -> tuple[int, int]:
        queue = self.told.queue_max if self.told.queue_fixed else _QUEUE
        return queue, queue

    # --- process data --------------------------------------------------------------------------

    @property
    def program(self) -> tuple[int, int]:
        """The cycle of the terminal in C."""
        return self.can.program

    def rests(self) -> bool:
        """Always: what happens in each cycle does so in C."""
        return True

    def _pdos(
        self, identifiers: int, receive: int, send: int
    ) -> tuple[tuple[Pdo, ...], tuple[Pdo, ...]]:
        """The PDOs for identifiers of 11 or 29 bit, and queues of these lengths."""
        layout = self.told.layouts[identifiers]
        sent = _entries(0x7000 + (identifiers == 29), layout.sent, send, layout.spare_outputs)
        received = _entries(
            0x6000 + (identifiers == 29), layout.received, receive, layout.spare_inputs
        )
        inputs = [Pdo(_INPUTS, "CAN inputs", 3, received)]
        if layout.status.size:
            inputs.append(Pdo(_STATUS, "CAN status", 3, _status_entries()))
        return (Pdo(_OUTPUTS, "CAN outputs", 2, sent),), tuple(inputs)

    def _settings_now(self) -> tuple[int, int, int]:
        """Identifiers, and lengths of the queues for received frames and for frames to be sent."""
        return (min(self.told.layouts), *self._first_queues)

    def _lay_out(self) -> None:
        identifiers, receive, send = self._settings_now()
        for index in (0x6000, 0x6001, 0x7000, 0x7001):
            if index in self.dictionary:
                self.dictionary.remove(index)
        self.set_pdos(*self._pdos(identifiers, receive, send))

    # --- on the bus ----------------------------------------------------------------------------

    def _go_online(self) -> None:
        self.can.go_online(self.can.bus.bit_rate, self._kept or _KEPT)

    def _filters(self) -> list[tuple[int, int]]:
        return []

    def check(self, old: AlState, new: AlState) -> None:
        """Sets up the terminal before SAFEOP."""
        if new != AlState.SAFEOP or old != AlState.PREOP:
            return
        identifiers, receive, send = self._settings_now()
        self._go_online()
        self.can.set_filters(identifiers == 29, self._filters())
        layout = self.told.layouts[identifiers]
        self.can.configure(layout, self._mode, receive, send, self._handshake)

    def entering(self, old: AlState, new: AlState) -> None:
        """Leaves the bus in INIT, and begins anew in OP."""
        if new == AlState.INIT:
            self.can.go_offline()
        elif new == AlState.OP:
            self.can.begin()

    def reset(self) -> None:
        """Returns to the state after power-on: off the bus, all counters 0."""
        super().reset()
        self.can.go_offline()
        self._lay_out()


class ProfileTerminal(CanTerminal):
    """A terminal of the CAN interface profile, which is set up by objects."""

    def describe(self) -> None:
        """Adds the objects of the profile."""
        self.dictionary.record(
            _BUS,
            "CAN bus parameter set",
            [
                Variable(_BUS, 0x01, "Master node address", _U8, 0, Access.RW, 127),
                Variable(_BUS, _RATE, "Baudrate", _U8, 0, Access.RW, 2),
                Variable(_BUS, 0x03, "COB-ID SYNC message", _U16, 0, Access.RW, 0x80),
                Variable(_BUS, 0x04, "SYNC cycle time", _U32, 0, Access.RW, 1000),
                *(
                    Variable(_BUS, subindex, f"SubIndex {subindex:03d}", _U8, 0, Access.RW)
                    for subindex in range(0x06, 0x0E)
                ),
                Variable(_BUS, 0x0E, "TxPDO delay", _U8, 0, Access.RW, 0x1E),
                Variable(_BUS, _KEPT_AT, "CAN message queue size", _U16, 0, Access.RW, _KEPT),
                Variable(_BUS, 0x11, "SubIndex 017", _U8, 0, Access.RW),
            ],
            count_access=Access.RW,
        )
        self.dictionary[_BUS, _RATE].on_write = self._check_rate
        self.dictionary[_BUS, _KEPT_AT].minimum = 1
        self.dictionary[_BUS, 0].on_write = self._bus_written
        configuration = [
            Variable(_CONFIGURATION, 0x01, "Node address", _U16, 0, _CONFIGURABLE),
            Variable(_CONFIGURATION, _FLAGS, "Flags", _U16, 0, _CONFIGURABLE),
            Variable(_CONFIGURATION, _RECEIVE, "Rx queue size", _U8, 0, _CONFIGURABLE, _QUEUE),
            Variable(_CONFIGURATION, _SEND, "Tx queue size", _U8, 0, _CONFIGURABLE, _QUEUE),
            Variable(_CONFIGURATION, 0x23, "SubIndex 035", _U16, 0, _CONFIGURABLE, 150),
            Variable(_CONFIGURATION, 0x24, "SubIndex 036", _U16, 0, _CONFIGURABLE, 150),
        ]
        for entry in configuration[2:4]:
            entry.minimum, entry.maximum = 1, self.told.queue_max
        self.dictionary.record(
            _CONFIGURATION, "CAN interface configuration", configuration, count_access=_CONFIGURABLE
        )
        self.dictionary[_CONFIGURATION, 0].on_write = self._configuration_written
        self.dictionary.array(
            _FILTERS, "CAN filters", DataType.UNSIGNED64, [0] * _MAX_FILTERS, _CONFIGURABLE
        )
        self.dictionary[_FILTERS, 0].value = 0
        follow_list_procedure(self.dictionary.object(_FILTERS))
        for subindex, read in enumerate(
            (lambda: 0, self._state_bits, self._receive_errors, self._send_errors), 1
        ):
            self.dictionary[_DIAGNOSIS, subindex].on_read = read

    def _settings_now(self) -> tuple[int, int, int]:
        flags, receive, send = (
            int(self.dictionary[_CONFIGURATION, subindex].value)
            for subindex in (_FLAGS, _RECEIVE, _SEND)
        )
        return 29 if flags & _EXTENDED else 11, receive, send

    def _filters(self) -> list[tuple[int, int]]:
        entries = self.dictionary.object(_FILTERS).entries
        pairs = [int(entries[i].value) for i in range(1, int(entries[0].value) + 1)]
        return [(pair & 0xFFFFFFFF, pair >> 32) for pair in pairs]

    def _check_rate(self, value: Value) -> None:
        if value not in self.told.bit_rates.values():
            raise abort_error(error_codes.VALUE_RANGE)

    def _bus_written(self, count: Value) -> None:
        """All bus parameters are there: this brings the terminal online."""
        if count and self.machine.state >= AlState.PREOP:
            self._go_online()

    def _configuration_written(self, count: Value) -> None:
        """The whole configuration is there: the process data follow it."""
        if count:
            self._lay_out()

    def _go_online(self) -> None:
        number = self.dictionary[_BUS, _RATE].value
        rate = next(rate for rate, code in self.told.bit_rates.items() if code == number)
        kept = self._kept or int(self.dictionary[_BUS, _KEPT_AT].value)
        self.can.go_online(1000 * rate, kept)

    # --- the state of its controller, as words ---------------------------------------------------

    def _state_bits(self) -> int:
        status = self.can.status
        off, warns = status.state == NodeState.BUS_OFF, status.state >= NodeState.WARNING
        return int(off) | int(warns and not off) << 1

    def _receive_errors(self) -> int:
        return min(self.can.status.receive_errors, 0xFF)

    def _send_errors(self) -> int:
        return min(self.can.status.transmit_errors, 0xFF)


class EL6751CAN(ProfileTerminal):
    """CANopen master terminal EL6751 in CAN interface mode."""

    told = table.EL6751
    vendor = VENDOR
    product = 0x1A5F3052
    revision = 0x00150000
    order = "EL6751"
    name = "EL6751 CANopen Master"
    group = "Communication"
    group_name = "Kommunikationsklemmen (EL6xxx)"
    physical_ports = 0x33
    ebus_current = 280


class C2922(ProfileTerminal):
    """CAN-EtherCAT gateway C.2922 of esd. Its product code is not known: this one is not that."""

    told = table.ESD
    vendor = 0x17
    product = 0x2922
    revision = 1
    order = "CAN-EtherCAT"
    name = "CAN-EtherCAT gateway"
    chip = replace(COMPLEX_CHIP, ports=0x0F)


class KendrionCAN(CanTerminal):
    """CAN terminal of Kendrion Kuhnke FIO. Its product code is not known: this one is not that."""

    told = table.KENDRION
    vendor = 0x48554B
    product = 0x694411
    revision = 1
    order = "FIO CAN"
    name = "Kuhnke FIO CAN"
    physical_ports = 0x33
    ebus_current = 100


def _entries(index: int, messages: Messages, queue: int, spare: int) -> list[Entry]:
    """The entries of a direction: words, then frames, then bytes without meaning."""
    words = [
        Entry(index, number, f"Word {number}", _U16, 16)
        for number in range(1, messages.first // 2 + 1)
    ]
    frames = [
        Entry(index, len(words) + number, f"Frame {number}", _RAW, 8 * messages.stride)
        for number in range(1, queue + 1)
    ]
    gap = [Entry(0, 0, "", DataType.PADDING, 8 * spare)] if spare else []
    return [*words, *frames, *gap]


def _one_buffer(sm: SyncManager) -> SyncManager:
    return replace(sm, control=sm.control & ~_BUFFERS | _ONE_BUFFER)


def _status_entries() -> list[Entry]:
    return [
        Entry(_DIAGNOSIS, 1, "Error", _U16, 16),
        Entry(_DIAGNOSIS, 2, "CAN state", _U16, 16),
        Entry(_DIAGNOSIS, 3, "Rx error counter", _U8, 8),
        Entry(_DIAGNOSIS, 4, "Tx error counter", _U8, 8),
    ]

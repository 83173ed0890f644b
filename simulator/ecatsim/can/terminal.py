"""The side of a terminal that faces the CAN bus: its node, its queues and its handshake, in C."""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Sequence
from dataclasses import dataclass, fields

from ecatd.etg.can_terminals import EXTENDED_MAX, STANDARD_MAX, Field, Layout, Messages, Mode

from . import library as c
from .bus import CanBus, NodeStatus, checked
from .frame import Filter

_QUEUES = 100
_MODES = {Mode.BUFFERED: 0, Mode.FAST: 1, Mode.OPTIMIZED: 2}


@dataclass(frozen=True, slots=True)
class Batches:
    """The handshake of a terminal since INIT.

    Attributes:
        rx_counter: Counter of received batches.
        tx_echo: Counter of the last batch that it has taken.
        rx_batches: Batches that it has given.
        tx_batches: Batches that it has taken.
        malformed: Frames and counts of the master that no terminal can take.
    """

    rx_counter: int
    tx_echo: int
    rx_batches: int
    tx_batches: int
    malformed: int


class TerminalPort:
    """The node of a terminal, and its cycle.

    Args:
        bus: The bus.
        name: Name of the node.
        recovers: Whether it comes back from bus-off by itself.

    Attributes:
        bus: The bus.
        place: Number of the node.
    """

    def __init__(self, bus: CanBus, name: str, *, recovers: bool) -> None:
        self.bus = bus
        self._recovers = recovers
        self.place = bus.add_place(name, queues=(_QUEUES, _QUEUES), recovers=recovers)
        self._online: tuple[int, int] | None = None
        self._lib = c.library()
        pointer = self._lib.can_terminal_create(bus.pointer, self.place)
        if not pointer:
            raise MemoryError
        self.pointer = ctypes.c_void_p(pointer)
        weakref.finalize(self, self._lib.can_terminal_destroy, self.pointer).atexit = False

    @property
    def program(self) -> tuple[int, int]:
        """Addresses of the function and of its context, for `Segment.set_program`."""
        function = ctypes.cast(self._lib.can_terminal_cycle, ctypes.c_void_p).value
        assert function is not None
        assert self.pointer.value is not None
        return function, self.pointer.value

    def go_online(self, bit_rate: int, kept: int) -> None:
        """Takes part in the traffic from now on.

        Args:
            bit_rate: Bits a second.
            kept: Frames that each of its queues holds.
        """
        if self._online == (bit_rate, kept):
            return
        self.bus.configure(self.place, bit_rate, recovers=self._recovers)
        self.bus.set_queues(self.place, kept, kept)
        self.bus.power(self.place, True)
        self._online = (bit_rate, kept)

    def go_offline(self) -> None:
        """Takes no part any more, and forgets all counters, as in INIT."""
        self.bus.power(self.place, False)
        self._lib.can_terminal_reset(self.pointer)
        self._online = None

    def set_filters(self, extended: bool, ranges: Sequence[tuple[int, int]]) -> None:
        """Sets what it receives.

        Args:
            extended: Whether its frames can have identifiers of 29 bits.
            ranges: The identifiers; none: all.
        """
        either = None if extended else False
        every = (0, EXTENDED_MAX if extended else STANDARD_MAX)
        rows = [Filter(*pair, extended=either) for pair in ranges or [every]]
        self.bus.set_filters(self.place, rows)

    def configure(
        self, layout: Layout, mode: Mode, receive_queue: int, send_queue: int, handshake_cycles: int
    ) -> None:
        """Sets up the process data, on the way to SAFEOP."""
        config = c.TerminalConfig(
            _layout(layout, receive_queue),
            *(_MODES[mode], receive_queue, send_queue, handshake_cycles),
        )
        checked(self._lib.can_terminal_configure(self.pointer, ctypes.byref(config)))

    def begin(self) -> None:
        """Forgets the frames received so far, on the way to OP."""
        self._lib.can_terminal_begin(self.pointer, self.bus.now_ns())

    @property
    def batches(self) -> Batches:
        """The handshake since INIT."""
        raw = c.TerminalStatus()
        self._lib.can_terminal_status(self.pointer, ctypes.byref(raw))
        return Batches(*(getattr(raw, field.name) for field in fields(Batches)))

    @property
    def status(self) -> NodeStatus:
        """State and counters of its node."""
        return self.bus.node_status(self.place)


def _field(field: Field | None, base: int = 0) -> c.Field:
    if field is None:
        return c.Field()
    return c.Field(field.at + base, field.size, field.shift, field.bits)


def _messages(messages: Messages) -> c.Messages:
    return c.Messages(
        *(messages.first, messages.stride, messages.data),
        length=_field(messages.length),
        identifier=_field(messages.identifier),
        remote=_field(messages.remote),
        extended=_field(messages.extended),
        transaction=_field(messages.transaction),
    )


def _layout(layout: Layout, receive_queue: int) -> c.Layout:
    status, at = layout.status, layout.status_at(receive_queue)
    return c.Layout(
        received=_messages(layout.received),
        sent=_messages(layout.sent),
        tx_echo=_field(layout.inputs.tx_echo),
        rx_counter=_field(layout.inputs.rx_counter),
        rx_count=_field(layout.inputs.rx_count),
        transaction=_field(layout.inputs.transaction),
        bus_off=_field(status.bus_off, at),
        warning=_field(status.warning, at),
        error_passive=_field(status.error_passive, at),
        receive_overflow=_field(status.receive_overflow, at),
        send_overflow=_field(status.send_overflow, at),
        send_error=_field(status.send_error, at),
        receive_full=_field(status.receive_full, at),
        receive_errors=_field(status.receive_errors, at),
        send_errors=_field(status.send_errors, at),
        tx_counter=_field(layout.outputs.tx_counter),
        rx_ack=_field(layout.outputs.rx_ack),
        tx_count=_field(layout.outputs.tx_count),
        reset=_field(layout.outputs.reset),
    )

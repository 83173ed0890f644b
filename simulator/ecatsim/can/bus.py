"""A CAN bus: the wire between nodes and terminals."""

from __future__ import annotations

import ctypes
import time
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from itertools import count
from typing import Protocol, TypeVar

from ecatd.base.errors import EcatError, UsageError

from . import library as c
from .frame import CanFrame, Filter
from .traffic import CheckStatus, Traffic

MAX_NODES = 32
_BATCH = 64
_names = count(1)


class NodeState(IntEnum):
    """State of a node (enum can_state)."""

    ACTIVE = 0
    WARNING = 1
    PASSIVE = 2
    BUS_OFF = 3
    NO_POWER = 4


class Stuck(IntEnum):
    """What a broken wire shows all the time (enum can_stuck)."""

    NO = 0
    RECESSIVE = 1
    DOMINANT = 2


@dataclass(frozen=True, slots=True)
class NodeStatus:
    """State and counters of a node since its power-on; `struct can_node_status` explains them."""

    state: NodeState
    transmit_errors: int
    receive_errors: int
    transmit_pending: int
    receive_pending: int
    last_tag: int
    sent: int
    received: int
    refused: int
    overflowed: int
    dropped: int
    lost_arbitrations: int
    not_acknowledged: int
    failed: int
    bus_offs: int


@dataclass(frozen=True, slots=True)
class BusStatus:
    """Counters of a bus.

    Attributes:
        frames: Frames that have come to their end.
        error_frames: Attempts that have not.
        busy_ns: Time in which the wire was not idle.
        now_ns: The time up to which the bus has lived.
    """

    frames: int
    error_frames: int
    busy_ns: int
    now_ns: int


def wire_bits(frame: CanFrame) -> list[int]:
    """The bits of a frame on the wire, to the end of the intermission; 0 is dominant."""
    bits = (ctypes.c_uint8 * 256)()
    raw = _raw(frame)
    size = checked(c.library().can_frame_bits(ctypes.byref(raw), bits, len(bits)))
    return list(bits[:size])


def checked(result: int) -> int:
    """Passes on what a function of the library has returned, unless it has failed."""
    if result < 0:
        raise EcatError(f"the CAN bus has failed: error {-result}")
    return result


def _raw(frame: CanFrame) -> c.Frame:
    flags = (c.EXTENDED if frame.extended else 0) | (c.REMOTE if frame.remote else 0)
    raw = c.Frame(id=frame.id, tag=frame.tag, flags=flags, length=frame.size)
    ctypes.memmove(raw.data, frame.data, len(frame.data))
    return raw


def _frame(raw: c.Frame) -> CanFrame:
    remote = bool(raw.flags & c.REMOTE)
    data = b"" if remote else bytes(raw.data[: raw.length])
    extended = bool(raw.flags & c.EXTENDED)
    return CanFrame(raw.id, data, extended, remote, raw.length, raw.time_ns, raw.tag)


class Member(Protocol):
    """What a bus needs of its nodes in Python; `CanNode` has it.

    Attributes:
        place: Its number on the bus.
    """

    place: int

    def connect(self, bus: CanBus) -> None:
        """Becomes a node of a bus."""

    def power(self, on: bool) -> None:
        """Switches its power."""

    def take(self) -> None:
        """Takes received frames."""

    def step(self, now: float) -> None:
        """Makes a step."""

    @property
    def application(self) -> dict[str, str | float]:
        """What its application does."""
        ...

    @property
    def check_results(self) -> list[CheckStatus]:
        """What its checks have found."""
        ...


N = TypeVar("N", bound=Member)


class CanBus:
    """A bus with nodes.

    Args:
        bit_rate: Bit rate of nodes that do not say another one, in bits a second.
        name: Its name; by default a number.
        clock: Returns the present time in ns. The time of a bus that is simulated must be
            CLOCK_MONOTONIC; tests may have another one.

    Attributes:
        name: Its name.
        bit_rate: See above.
        nodes: The nodes in Python.
        places: Names of all nodes, also of terminals, by their number.
        now_ns: Returns the present time in ns.
    """

    def __init__(
        self,
        bit_rate: int = 500_000,
        name: str = "",
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        if not 1 <= bit_rate <= 1_000_000:
            raise UsageError(f"a bit rate of {bit_rate} is not from 1 to 1000000 bits a second")
        self.bit_rate = bit_rate
        self.name = name or f"can{next(_names)}"
        self.nodes: list[Member] = []
        self.places: list[str] = []
        self._babbler: int | None = None
        self.now_ns = clock
        self._lib = c.library()
        pointer = self._lib.can_create(clock())
        if not pointer:
            raise EcatError("not enough memory for a CAN bus")
        self.pointer = ctypes.c_void_p(pointer)
        # Not at the end of the process: threads may still wait for frames.
        weakref.finalize(self, self._lib.can_destroy, self.pointer).atexit = False

    # --- nodes ---------------------------------------------------------------------------------

    def add(self, node: N) -> N:
        """Connects a node, and switches its power on."""
        node.connect(self)
        self.nodes.append(node)
        return node

    def add_place(
        self,
        name: str,
        bit_rate: int = 0,
        *,
        queues: tuple[int, int] = (256, 256),
        recovers: bool = True,
    ) -> int:
        """Adds a place for a node without power, and returns its number.

        Args:
            name: Its name.
            bit_rate: Its bit rate; 0: that of the bus.
            queues: Frames that its queues hold: to be sent, and received.
            recovers: Whether it comes back from bus-off by itself.

        Raises:
            UsageError: The bus is full.
        """
        if len(self.places) >= MAX_NODES:
            raise UsageError(f"{self.name}: a CAN bus has at most {MAX_NODES} nodes")
        flags = 0 if recovers else c.STAYS_OFF
        config = c.NodeConfig(bit_rate or self.bit_rate, flags, *queues)
        place = checked(self._lib.can_add_node(self.pointer, ctypes.byref(config)))
        self.places.append(name)
        return place

    def power(self, place: int, on: bool) -> None:
        """Switches the power of a node."""
        checked(self._lib.can_power(self.pointer, place, on, self.now_ns()))

    def configure(
        self, place: int, bit_rate: int, *, recovers: bool = True, listens_only: bool = False
    ) -> None:
        """Gives a node another bit rate, and says how it behaves."""
        flags = (0 if recovers else c.STAYS_OFF) | (c.LISTENS_ONLY if listens_only else 0)
        checked(self._lib.can_configure(self.pointer, place, bit_rate, flags, self.now_ns()))

    def set_queues(self, place: int, transmit: int, receive: int) -> None:
        """Gives a node queues of other lengths, which are empty."""
        checked(self._lib.can_set_queues(self.pointer, place, transmit, receive, self.now_ns()))

    def set_filters(self, place: int, filters: Sequence[Filter]) -> None:
        """Sets what a node receives; without filters, everything."""
        rows = [
            c.FilterRange(
                f.first,
                f.first if f.last is None else f.last,
                2 if f.extended is None else int(f.extended),
            )
            for f in filters
        ]
        array = (c.FilterRange * len(rows))(*rows)
        checked(self._lib.can_set_filters(self.pointer, place, array, len(rows)))

    # --- frames --------------------------------------------------------------------------------

    def advance(self) -> int:
        """Lets everything happen up to now; returns the nodes with received frames as bits."""
        return checked(self._lib.can_advance(self.pointer, self.now_ns()))

    def run(self, now: float) -> None:
        """Makes a step: gives the nodes in Python their frames, and lets them act.

        Args:
            now: CLOCK_MONOTONIC in seconds.
        """
        received = self.advance()
        for node in self.nodes:
            if received >> node.place & 1:
                node.take()
            node.step(now)

    def send(self, place: int, frames: Sequence[CanFrame]) -> int:
        """Puts frames into the queue of a node; returns how many had room."""
        array = (c.Frame * len(frames))(*map(_raw, frames))
        result = self._lib.can_send(self.pointer, place, array, len(frames), self.now_ns())
        return checked(result)

    def receive(self, place: int, most: int = _BATCH) -> list[CanFrame]:
        """Takes frames that a node has received."""
        array = (c.Frame * most)()
        size = self._lib.can_receive(self.pointer, place, array, most, self.now_ns())
        return [_frame(raw) for raw in array[: checked(size)]]

    def wait(self, place: int, seconds: float) -> bool:
        """Waits until a node has received something; returns whether it has."""
        return bool(checked(self._lib.can_wait(self.pointer, place, round(seconds * 1e9))))

    def cancel(self, place: int) -> None:
        """Empties the transmit queue of a node."""
        checked(self._lib.can_cancel(self.pointer, place, self.now_ns()))

    # --- traffic -------------------------------------------------------------------------------

    def add_traffic(self, place: int, traffic: Traffic) -> int:
        """Has a node send traffic by itself; returns its number at the node."""
        source = self._source(traffic)
        return checked(
            self._lib.can_add_source(self.pointer, place, ctypes.byref(source), self.now_ns())
        )

    def clear_traffic(self, place: int) -> None:
        """Ends all traffic of a node."""
        checked(self._lib.can_clear_sources(self.pointer, place, self.now_ns()))

    def traffic_sent(self, place: int, number: int) -> int:
        """Number of frames of a traffic that were sent."""
        return checked(self._lib.can_source_sent(self.pointer, place, number))

    def add_check(self, place: int, traffic: Traffic) -> int:
        """Has a node check the traffic of another one; returns the number of the check."""
        source = self._source(traffic)
        return checked(self._lib.can_add_check(self.pointer, place, ctypes.byref(source)))

    def check_status(self, place: int, number: int) -> CheckStatus:
        """What a check has found."""
        status = c.CheckStatus()
        result = self._lib.can_check_status(self.pointer, place, number, ctypes.byref(status))
        checked(result)
        return CheckStatus(status.received, status.lost, status.doubled, status.wrong)

    def set_echo(self, place: int, change: int) -> None:
        """Has a node send data frames back, with `change` exclusively or'ed into the identifier.

        0 ends it.
        """
        checked(self._lib.can_set_echo(self.pointer, place, change))

    def _source(self, traffic: Traffic) -> c.Source:
        flags = (c.EXTENDED if traffic.extended else 0) | (c.REMOTE if traffic.remote else 0)
        return c.Source(
            *(traffic.id, traffic.span, flags, traffic.length),
            first_ns=self.now_ns() + round(traffic.delay * 1e9),
            period_ns=round(1e9 / traffic.rate) if traffic.rate else 0,
            count=traffic.count,
        )

    def babble(self, identifier: int | None) -> None:
        """Has a node send a frame again and again, as fast as the bus allows; None: no more."""
        if self._babbler is None:
            self._babbler = self.add_place("babbling node")
        # A silent one would still acknowledge frames of others.
        self.power(self._babbler, identifier is not None)
        self.clear_traffic(self._babbler)
        if identifier is not None:
            self.add_traffic(self._babbler, Traffic(identifier))

    # --- state and faults ----------------------------------------------------------------------

    def node_status(self, place: int) -> NodeStatus:
        """State and counters of a node."""
        raw = c.NodeStatus()
        checked(self._lib.can_node_status(self.pointer, place, ctypes.byref(raw), self.now_ns()))
        state, *others = (getattr(raw, field.name) for field in fields(NodeStatus))
        return NodeStatus(NodeState(state), *others)

    def status(self) -> BusStatus:
        """Counters of the bus."""
        raw = c.BusStatus()
        checked(self._lib.can_bus_status(self.pointer, ctypes.byref(raw), self.now_ns()))
        return BusStatus(raw.frames, raw.error_frames, raw.busy_ns, raw.now_ns)

    def restart(self, place: int) -> None:
        """Ends bus-off, as the application of a node asks for it."""
        checked(self._lib.can_restart(self.pointer, place, self.now_ns()))

    def force_bus_off(self, place: int) -> None:
        """Brings a node into bus-off."""
        checked(self._lib.can_force_bus_off(self.pointer, place, self.now_ns()))

    def set_noise(self, probability: float, seed: int = 1) -> None:
        """Damages each attempt to send a frame with a probability."""
        checked(self._lib.can_set_noise(self.pointer, probability, seed, self.now_ns()))

    def set_stuck(self, stuck: Stuck) -> None:
        """Makes the wire show one level all the time, or repairs it."""
        checked(self._lib.can_set_stuck(self.pointer, stuck, self.now_ns()))

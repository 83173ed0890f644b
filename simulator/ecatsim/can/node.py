"""Nodes in plain Python."""

from __future__ import annotations

from collections.abc import Sequence

from ecatd.base.errors import StateError

from .bus import CanBus, NodeStatus
from .frame import CanFrame, Filter
from .traffic import CheckStatus, Traffic


class CanNode:
    """A node of a CAN bus; a subclass reacts to frames and sends its own.

        class Counter(CanNode):
            def on_frame(self, frame):
                self.send(CanFrame(frame.id + 1, frame.data))

    A frame costs the simulator some 10 µs of Python, so a node on a busy bus should have filters.

    Args:
        name: Its name.
        bit_rate: Its bit rate; 0: that of the bus.
        traffic: Frames that it sends by itself (in C).
        checks: Traffic that it expects from others (in C).
        echo: What is exclusively or'ed into the identifiers of data frames, which it then sends
            back (in C); 0: it sends none back.

    Attributes:
        name: See above.
        bit_rate: See above.
        filters: What it receives; none: everything. Without `on_frame`, nothing.
        queues: Frames that its queues hold: to be sent, and received.
        place: Its number on the bus; -1 before `CanBus.add`.
        on: Whether it has power.
    """

    filters: Sequence[Filter] = ()
    queues: tuple[int, int] = (256, 256)

    def __init__(
        self,
        name: str = "",
        bit_rate: int = 0,
        *,
        traffic: Sequence[Traffic] = (),
        checks: Sequence[Traffic] = (),
        echo: int = 0,
    ) -> None:
        self.name = name or type(self).__name__
        self.bit_rate = bit_rate
        self.place = -1
        self.on = False
        self._traffic, self._checks, self._echo = traffic, checks, echo
        self._bus: CanBus | None = None

    # --- for subclasses ------------------------------------------------------------------------

    def on_frame(self, frame: CanFrame) -> None:
        """Takes a frame that another node has sent."""

    def step(self, now: float) -> None:
        """Called in each step of the simulation, every millisecond.

        Args:
            now: CLOCK_MONOTONIC in seconds.
        """

    def started(self) -> None:
        """Called at power-on."""

    # --- for users -----------------------------------------------------------------------------

    @property
    def bus(self) -> CanBus:
        """The bus.

        Raises:
            StateError: The node is on no bus.
        """
        if self._bus is None:
            raise StateError(f"CAN node {self.name} is on no bus: `CanBus.add` comes first")
        return self._bus

    def connect(self, bus: CanBus) -> None:
        """Becomes a node of a bus; `CanBus.add` calls it."""
        if self._bus is not None:
            raise StateError(f"CAN node {self.name} is on {self._bus.name} already")
        listens = type(self).on_frame is not CanNode.on_frame
        queues = self.queues[0], self.queues[1] if listens else 0
        self.place = bus.add_place(self.name, self.bit_rate, queues=queues)
        self._bus = bus
        bus.set_filters(self.place, self.filters)
        bus.set_echo(self.place, self._echo)
        for traffic in self._traffic:
            bus.add_traffic(self.place, traffic)
        for check in self._checks:
            bus.add_check(self.place, check)
        self.power(True)

    def power(self, on: bool) -> None:
        """Switches its power. Without, it neither sends nor acknowledges."""
        if on == self.on:
            return
        self.bus.power(self.place, on)
        self.on = on
        if on:
            self.started()

    def send(self, *frames: CanFrame) -> bool:
        """Sends frames; returns whether the queue had room for all of them."""
        return not frames or self.bus.send(self.place, frames) == len(frames)

    def take(self) -> None:
        """Passes received frames to `on_frame`; the bus calls it."""
        while frames := self.bus.receive(self.place):
            for frame in frames:
                self.on_frame(frame)

    @property
    def status(self) -> NodeStatus:
        """Its state and counters."""
        return self.bus.node_status(self.place)

    @property
    def application(self) -> dict[str, str | float]:
        """What its application does, for those who look at the simulator."""
        return {}

    @property
    def check_results(self) -> list[CheckStatus]:
        """What its checks have found."""
        return [self.bus.check_status(self.place, i) for i in range(len(self._checks))]

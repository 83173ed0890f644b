"""Simulated buses for programs that use python-can: nodes written with `can` or `canopen`.

    from ecatsim.can import CanBus
    from ecatsim.can.python_can import SimulatedBus

    bus = CanBus(500_000)
    network = canopen.Network(SimulatedBus(bus))
    network.connect()
    network.add_node(canopen.LocalNode(5, "node.eds"))

Such nodes run in threads of their own, beside the loop of the simulation.
"""

from __future__ import annotations

import time
from typing import Any

import can

from ecatd.base.timeouts import Timeout

from .bus import CanBus, NodeState
from .frame import CanFrame

_STATES = {
    NodeState.ACTIVE: can.BusState.ACTIVE,
    NodeState.WARNING: can.BusState.ACTIVE,
    NodeState.PASSIVE: can.BusState.PASSIVE,
}
_LONGEST_WAIT = 0.5
"""Seconds after which a thread that waits for a frame looks whether its bus was shut down."""


class SimulatedBus(can.BusABC):
    """A node of a simulated bus, for python-can.

    Args:
        bus: The bus.
        name: Name of the node.
        bit_rate: Its bit rate; 0: that of the bus.
        can_filters: Filters of python-can.
        **kwargs: What else `can.BusABC` takes.
    """

    def __init__(
        self,
        bus: CanBus,
        name: str = "python-can",
        bit_rate: int = 0,
        can_filters: can.typechecking.CanFilters | None = None,
        **kwargs: Any,
    ) -> None:
        self._can = bus
        self.channel_info = f"{bus.name}: {name}"
        self._place = bus.add_place(name, bit_rate, queues=(1024, 4096))
        bus.power(self._place, True)
        self._received: list[CanFrame] = []
        super().__init__(bus.name, can_filters, **kwargs)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        until = None if timeout is None else time.monotonic() + timeout
        while not self._received and not self._is_shutdown:
            self._received = self._can.receive(self._place)[::-1]
            left = _LONGEST_WAIT if until is None else until - time.monotonic()
            if not self._received and left <= 0:
                return None, False
            if not self._received:
                self._can.wait(self._place, min(left, _LONGEST_WAIT))
        return (self._message(self._received.pop()) if self._received else None), False

    def _message(self, frame: CanFrame) -> can.Message:
        age = (self._can.now_ns() - frame.time_ns) / 1e9
        return can.Message(
            timestamp=time.time() - age,
            arbitration_id=frame.id,
            is_extended_id=frame.extended,
            is_remote_frame=frame.remote,
            dlc=frame.size,
            data=None if frame.remote else frame.data,
            channel=self._can.name,
            is_rx=True,
        )

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Puts a frame into the queue of the node.

        Raises:
            CanOperationError: The queue is full, also after the timeout.
        """
        data = b"" if msg.is_remote_frame else bytes(msg.data)
        remote, extended = msg.is_remote_frame, msg.is_extended_id
        frame = CanFrame(msg.arbitration_id, data, extended, remote, msg.dlc)
        patience = Timeout(timeout or 0.0, "timeout")
        until = time.monotonic() + patience.seconds
        while not self._can.send(self._place, [frame]):
            if time.monotonic() >= until:
                raise can.CanOperationError(
                    f"{self.channel_info}: the queue had no room within {patience}"
                )
            time.sleep(0.001)

    @property
    def state(self) -> can.BusState:
        """Whether the node is active, passive or off."""
        return _STATES.get(self._can.node_status(self._place).state, can.BusState.ERROR)

    @state.setter
    def state(self, new_state: can.BusState) -> None:
        raise NotImplementedError("a node decides itself about its state")

    def shutdown(self) -> None:
        """Leaves the bus."""
        if not self._is_shutdown:
            self._can.power(self._place, False)
        super().shutdown()

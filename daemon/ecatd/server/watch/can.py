"""Reports what happens on the CAN channels of terminals: their controllers, and who sends."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, Iterator
from functools import partial
from typing import Any, Protocol

from ecatd.base.batch import Batch, last_of
from ecatd.base.errors import EcatError
from ecatd.description.bus import Bus
from ecatd.master.engine.engine import Event, EventType
from ecatd.operations.faults import CAN, Fault
from ecatd.shm import contract as shm
from ecatd.shm.contract import CAN_EXTENDED, CAN_ID, CanState

from ..start.running_bus import RunningBus
from .reports import Reporter

EVENTS = frozenset(
    {
        EventType.CAN_STATE,
        EventType.CAN_ENDED,
        EventType.CAN_REFUSED,
        EventType.CAN_CONFLICT,
        EventType.CAN_OVERFLOW,
        EventType.CAN_MALFORMED,
    }
)

_STATES = {
    CanState.STOPPED: "the CAN controller has stopped, since the terminal is not in OP",
    CanState.ACTIVE: "the CAN controller works",
    CanState.WARNING: "the CAN bus has errors",
    CanState.PASSIVE: "the CAN controller is error passive",
    CanState.BUS_OFF: "the CAN controller is bus-off",
}
_CHECK = ": check its cable and termination, the bit rate of all nodes, and that another node is on"
_LONGEST_PAUSE = 60.0
"""Seconds between two starts of a terminal that is bus-off again and again."""
_SETTLES = 0.5
"""Seconds after a start in which its state is known."""
_SENDS = (CanState.ACTIVE, CanState.WARNING)
_BAD = (CanState.WARNING, CanState.PASSIVE, CanState.BUS_OFF)

_ENDS = {
    shm.Reason.RELEASED: "no longer sends",
    shm.Reason.DIED: "has ended without a release",
    shm.Reason.LAPSED: "gave no sign of life for its lease",
    shm.Reason.GONE: "has lost its slot",
    shm.Reason.STOPPING: "no longer sends, since the daemon stops",
}
_EXPECTED = (shm.Reason.RELEASED, shm.Reason.STOPPING)


class Client(Protocol):
    """Who is in a slot, as it says itself; its text names it."""

    @property
    def program(self) -> str:
        """Name of the program."""

    @property
    def pid(self) -> int:
        """Its process ID."""


class CanWatch:
    """The watch over the CAN channels; for the thread of the event loop.

    Args:
        running: The bus.
        who: Who is in a slot.
        restart: Takes a slave to INIT, and back to OP.
        report: Reports.
    """

    def __init__(
        self,
        running: RunningBus,
        who: Callable[[int], Client],
        restart: Callable[[int], Awaitable[None]],
        report: Reporter,
    ) -> None:
        self._bus: Bus = running.bus
        self._rows = {
            row.slave: row for row in running.shared.can[: running.shared.header.can_count]
        }
        self._channels = {channel.slave: channel for channel in running.data.resolved.can}
        self._who = who
        self._restart = restart
        self._since: dict[int, float] = {}  # Unix time since which a controller is not well
        self._restarts: dict[int, asyncio.Task[None]] = {}
        self._report = report
        self._gathered: dict[tuple[int, int, int, int], Batch[tuple[Event, Client | None]]] = {}

    @property
    def faults(self) -> list[Fault]:
        """CAN controllers that are error passive or bus-off now."""
        found = []
        for slave, row in self._rows.items():
            state = CanState(row.state)
            if state in (CanState.PASSIVE, CanState.BUS_OFF):
                text = (
                    f"{self._bus.slaves[slave].label}: {_STATES[state]}{self._counts(slave, state)}"
                )
                since = self._since.setdefault(slave, time.time())
                found.append(Fault(CAN, text, since, slaves=(slave,)))
            else:
                self._since.pop(slave, None)
        return found

    def handle(self, event: Event) -> None:
        """Takes an event of the engine about a CAN channel."""
        if event.type == EventType.CAN_STATE and event.value == CanState.BUS_OFF:
            self._heal(event.slave)
        client = self._who(event.slot) if event.slot >= 0 else None
        # A client that comes and goes must not delay the news that one has died.
        why = event.value if event.type == EventType.CAN_ENDED else 0
        key = (event.type, event.slave, event.slot, why)
        if key not in self._gathered:
            self._gathered[key] = Batch(partial(self._tell, EventType(event.type)))
        self._gathered[key].note((event, client))

    def close(self) -> None:
        """Reports what still waits, and starts no terminal any more."""
        for task in self._restarts.values():
            task.cancel()
        for batch in self._gathered.values():
            batch.close()

    def _heal(self, slave: int) -> None:
        pause = self._channels[slave].bus_off_restart_ms
        if pause and slave not in self._restarts:
            self._restarts[slave] = asyncio.create_task(self._start_anew(slave, pause / 1000))
            self._restarts[slave].add_done_callback(lambda _: self._restarts.pop(slave, None))

    async def _start_anew(self, slave: int, pause: float) -> None:
        """Starts a terminal that is bus-off until it is not, after growing pauses."""
        label = self._bus.slaves[slave].label
        while True:
            await asyncio.sleep(pause)
            if self._rows[slave].state != CanState.BUS_OFF:
                return
            self._report.log.warning(f"{label}: bus-off for {pause:g} s, so ecatd starts it anew")
            try:
                await self._restart(slave)
            except EcatError as error:
                self._report.log.warning(f"{label}: it could not be started anew: {error}")
            pause = min(2 * pause, max(pause, _LONGEST_PAUSE))
            await asyncio.sleep(_SETTLES)

    def _tell(
        self, kind: EventType, events: list[tuple[Event, Client | None]], left_out: int
    ) -> None:
        event, client = events[-1]
        label = self._bus.slaves[event.slave].label
        facts: dict[str, Any] = {"slave": event.slave, "cycle": event.cycle}
        good, text = False, ""
        if client is not None:
            facts |= {"slot": event.slot, "program": client.program, "pid": client.pid}
        match kind:
            case EventType.CAN_STATE:
                state = CanState(event.value)
                good = state not in _BAD
                text = (
                    f"{label}: {_STATES.get(state, state.name)}{self._counts(event.slave, state)}"
                )
                facts["state"] = state.name.lower()
            case EventType.CAN_ENDED:
                reason = shm.Reason(event.value)
                good = reason in _EXPECTED
                text = f"{client} {_ENDS.get(reason, reason.name)} on the CAN channel of {label}"
                if not good:
                    text += f"; its frames that waited were dropped{self._safe_frames(event.slave)}"
                facts["reason"] = reason.name.lower()
            case EventType.CAN_REFUSED:
                text = (
                    f"a CAN frame of {client} for {label} was not sent: "
                    f"{_identifier(event.value)} is reserved by another client, or it is malformed"
                )
            case EventType.CAN_CONFLICT:
                text = (
                    f"{client} is refused identifiers of the CAN channel of {label}: "
                    f"{self._who(event.value)} has reserved them"
                )
                facts["owner"] = str(self._who(event.value))
            case EventType.CAN_OVERFLOW:
                text = (
                    f"{label} has lost CAN frames that it received, since its queue was full: "
                    "exchange it more often, or let filters of its [slave.can] pass only what is "
                    "needed"
                )
            case EventType.CAN_MALFORMED:
                text = (
                    f"{label} says that it delivers {event.value} CAN frames, but its process data "
                    f"have room for {self._rows[event.slave].receive_queue}: ecatd uses those that "
                    "fit; check the layout in its [slave.can]"
                )
        level = "debug" if kind == EventType.CAN_CONFLICT or (good and client is not None) else ""
        self._report(
            kind.name.lower(),
            last_of([*([""] * (len(events) - 1)), text], left_out),
            facts,
            [event.slave],
            good=good,
            level=level,
        )

    def _safe_frames(self, slave: int) -> str:
        if not self._channels[slave].safe:
            return "; its [slave.can] has no safe frames"
        works = CanState(self._rows[slave].state) in _SENDS
        when = "" if works else " as soon as the CAN controller works"
        return f", and the safe frames are sent{when}"

    def _counts(self, slave: int, state: CanState) -> str:
        if state not in _BAD:
            return ""
        row = self._rows[slave]
        return f" (error counters {row.send_errors} sent, {row.receive_errors} received){_CHECK}"


def unsent_safe_frames(running: RunningBus) -> Iterator[str]:
    """Tells, when the bus stops, of which terminals the safe frames cannot have been sent."""
    for row in running.shared.can[: running.shared.header.can_count]:
        state = CanState(row.state)
        if row.safe_active and state not in _SENDS:
            yield (
                f"{running.bus.slaves[row.slave].label}: the safe frames were not sent, since "
                f"{_STATES[state]}: what is on its CAN bus goes on as it does without a sender"
            )


def _identifier(word: int) -> str:
    digits = 8 if word & CAN_EXTENDED else 3
    return f"identifier 0x{word & CAN_ID:0{digits}X}"

"""Watches a running bus: the engine's events and the AL states of the slaves.

Whatever changes is written to shared memory, logged, and published as an event.
"""

from __future__ import annotations

import asyncio
import os
import threading
import time
from collections.abc import Callable
from typing import Any

from ecatd import shm
from ecatd.log import Log
from ecatd.model.al import AlState
from ecatd.model.bus import Bus
from ecatd.model.errors import StateError

from .clock_watch import ClockWatch
from .clocks import Clocks
from .engine import Engine, Event, EventType
from .mailbox import Mailbox
from .master import Master, SlaveState
from .segment import Segment
from .slot_requests import SlotRequests

_PERIOD = 0.25
_EVENT_PATIENCE = 0.2

_REASONS = {
    shm.Reason.RELEASED: "their owner released them",
    shm.Reason.LAPSED: "their owner gave no sign of life",
    shm.Reason.GONE: "their owner is gone",
    shm.Reason.STOPPING: "the daemon stops",
}


class Monitor:
    """The watch over one bus, from OP until it is stopped.

    Args:
        bus: The description of the bus.
        interface: Name of the interface, for messages.
        segment: Where states are written.
        engine: Whose events are watched.
        master: Reads AL states.
        mailbox: The worker on which that is done.
        log: Where events are told.
        publish: Called with every event, as a map, on the event loop's thread.
        clocks: The distributed clocks, where they are used.

    Attributes:
        states: AL status of every slave when it was last read.
    """

    def __init__(
        self,
        bus: Bus,
        interface: str,
        segment: Segment,
        engine: Engine,
        master: Master,
        mailbox: Mailbox,
        log: Log,
        publish: Callable[[dict[str, Any]], None],
        clocks: Clocks | None,
    ) -> None:
        self._bus = bus
        self._interface = interface
        self._segment = segment
        self._engine = engine
        self._master = master
        self._mailbox = mailbox
        self._log = log
        self._publish = publish
        self._requests = SlotRequests(segment, engine, mailbox, master, len(bus.slaves))
        self._clock_watch = (
            None if clocks is None else ClockWatch(clocks, segment, mailbox, log, self._tell)
        )
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        self.states: list[SlaveState] = []

    def read_states(self) -> list[SlaveState]:
        """Reads the AL states into shared memory; returns those that have changed.

        On the mailbox worker.
        """
        before, self.states = self.states, self._master.states()
        changed = [
            now
            for now in self.states
            if not before or now != before[min(now.position, len(before) - 1)]
        ]
        for now in changed:
            row = self._segment.slave_status[now.position]
            row.al_state, row.al_code = now.al_state, now.al_code
        return changed

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Begins to bring the engine's events to the event loop."""
        self._thread = threading.Thread(target=self._watch_events, args=(loop,), daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Ends the watch: no event is handled any more."""
        self._stopping.set()

    def close(self) -> None:
        """Waits until nothing uses the engine any more; after `stop`."""
        if self._thread is not None:
            self._thread.join()

    def _watch_events(self, loop: asyncio.AbstractEventLoop) -> None:
        while not self._stopping.is_set():
            event = self._engine.wait_event(_EVENT_PATIENCE)
            if event is not None and not self._stopping.is_set():
                loop.call_soon_threadsafe(self._handle, event)

    def _handle(self, event: Event) -> None:
        if self._stopping.is_set():
            return
        if event.type == EventType.REQUEST:
            self._requests.look(event.slot, event.value)
        elif event.type == EventType.CLAIMED:
            self._tell("claimed", slave=event.slave, slot=event.slot, cycle=event.cycle)
        elif event.type == EventType.SAFE:
            cause = shm.Reason(event.value)
            if cause in (shm.Reason.LAPSED, shm.Reason.GONE):
                self._log.warning(
                    f"outputs of {self._bus.slaves[event.slave].label} are safe: {_REASONS[cause]}"
                )
            self._tell("safe", slave=event.slave, reason=cause.name.lower(), cycle=event.cycle)
        elif event.type == EventType.WKC:
            state = shm.WkcState(event.value).name.lower()
            self._log.debug(f"domain {event.slave}: working counter {state}")
            self._tell("working_counter", domain=event.slave, state=state, cycle=event.cycle)
        elif event.type == EventType.SEND:
            reason = os.strerror(event.value) if event.value else ""
            if reason:
                self._log.error(f"frames cannot be sent on {self._interface}: {reason}")
            else:
                self._log.info(f"frames can be sent on {self._interface} again")
            self._tell("sending", error=reason, cycle=event.cycle)

        elif event.type == EventType.CLOCK and self._clock_watch is not None:
            self._clock_watch.handle(event)

    def _tell(self, kind: str, **facts: Any) -> None:
        self._publish({"event": kind, "time_ns": time.time_ns(), **facts})

    async def run(self) -> None:
        """Watches the AL states until the watch is stopped."""
        while not self._stopping.is_set():
            await asyncio.sleep(_PERIOD)
            try:
                await self.look()
                if self._clock_watch is not None:
                    await self._clock_watch.look()
            except StateError:
                continue  # the mailbox is busy: the next look is soon
            except Exception as error:
                # Watching must go on: an unwatched bus looks like a healthy one.
                self._log.error(f"defect while reading AL states: {error!r}")

    async def look(self) -> None:
        """Reads the AL states, and tells of every change."""
        for item in await self._mailbox.run(self.read_states):
            # OP is what everybody wants; leaving it may be wanted, too, but somebody should know.
            tell = self._log.info if item.al_state == AlState.OP else self._log.warning
            tell(f"{self._bus.slaves[item.position].label}: {item.describe()}")
            self._tell(
                "al_state",
                slave=item.position,
                al_state=item.al_state,
                al_code=item.al_code,
                text=item.describe(),
            )

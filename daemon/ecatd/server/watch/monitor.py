"""Watches a running bus: passes the engine's events to the modules that handle them, and polls.

`slaves.py` knows the slaves, `clocks.py` their clocks, `interfaces.py` what lies between
them and the engine. Whatever changes is written to shared memory, logged, and published as an
event.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections import deque
from collections.abc import Awaitable, Callable
from typing import Any

from ecatd.base.batch import Batch
from ecatd.base.errors import StateError
from ecatd.base.log import Log
from ecatd.description.cables import Cables
from ecatd.etg.al import AlState
from ecatd.master.emergencies import Emergency
from ecatd.master.engine.engine import Event, EventType
from ecatd.master.worker import Worker
from ecatd.operations.events import new_event
from ecatd.operations.faults import LOST, Fault
from ecatd.shm import contract as shm

from ..start.running_bus import RunningBus
from . import can
from .cables import CableWatch
from .clocks import ClockWatch
from .drives import DriveWatch
from .exchange import ExchangeWatch
from .interfaces import InterfaceWatch
from .mailboxes import MailboxWatch
from .outputs import OutputWatch
from .reports import Reporter, Throttle
from .shared_memory_files import FileWatch
from .slaves import SlaveWatch
from .slot_requests import Answer, SlotRequests

_EVENT_PATIENCE = 0.2
_EVENTS_WAITING = 64
"""Events that may wait for the event loop; others wait in the engine, which has bounded room."""
_LAST_EVENTS = 1024
"""Most events that are read from the engine at the end; a client could go on causing more."""
_ABOUT_OUTPUTS = frozenset(
    {
        EventType.CLAIMED,
        EventType.SAFE,
        EventType.REFUSED,
        EventType.MALFORMED,
        EventType.CONFLICT,
        EventType.STOPPED,
    }
)
_NOBODY = -1
"""The slot of requests that no client has sent."""
_COUNTER_PAUSE = 0.1
"""Seconds between two events about a domain's working counter, which may change in every cycle."""


class Monitor:
    """The watch over one bus, from OP until it is stopped.

    Args:
        running: The bus.
        answer: Carries out requests of clients.
        worker: The worker on which slaves are asked.
        log: The log for events.
        publish: Called with every event, as a map, on the event loop's thread.
        cables: The verdicts on the cables.

    Attributes:
        slaves: The watch over the slaves.
        exchange: The watch over the exchange.
        cables: The watch over the cables.
    """

    def __init__(
        self,
        running: RunningBus,
        answer: Answer,
        worker: Worker,
        log: Log,
        publish: Callable[[dict[str, Any]], None],
        cables: Cables,
    ) -> None:
        self._bus = running.bus
        self._shared = running.shared
        self._engine = running.engine
        self._log = log.of("slaves")
        self._send = publish
        self._requests = SlotRequests(
            running.shared, running.engine, answer, self._on_wrong_request, log.of("mailbox")
        )
        report = Reporter(self._log, self._publish)
        of_outputs, of_interfaces = report.of("outputs"), report.of("interfaces")
        self._outputs = OutputWatch(running, of_outputs)
        self._interfaces = InterfaceWatch(running, of_interfaces)
        self.slaves = SlaveWatch(running, worker, report, self._interfaces, cables.restarted)
        self.cables = CableWatch(running, cables, worker, of_interfaces)
        self.exchange = ExchangeWatch(
            running, worker, of_interfaces, self._explain, self.slaves.find_away
        )
        self._can = can.CanWatch(running, self._outputs.client, self._start_anew, of_outputs)
        self._drives = DriveWatch(running, lambda request: answer(request, _NOBODY), report)
        self._clocks = None
        if running.clocks is not None:
            self._clocks = ClockWatch(running.clocks, running.shared, worker, report.of("dc"))
        self._working_counters = [
            Throttle(self._report_working_counter, _COUNTER_PAUSE) for _ in running.bus.domains
        ]
        self._mailboxes = MailboxWatch(running, worker, report.of("mailbox"))
        self._files = FileWatch(running.shared, of_outputs)
        self._events: deque[Event] = deque()
        self._room = threading.Semaphore(_EVENTS_WAITING)
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def emergencies(self) -> Batch[Emergency]:
        """Takes the emergencies that slaves send, and reports them."""
        return self._mailboxes.emergencies

    @property
    def faults(self) -> list[Fault]:
        """What is wrong with interfaces, exchange, clocks, cables and drives: causes first."""
        clocks = [] if self._clocks is None else self._clocks.faults
        exchange = [*self._interfaces.faults, *self.exchange.faults, *clocks]
        return [*exchange, *self.cables.faults, *self._drives.faults, *self._can.faults]

    def describe(self) -> dict[str, Any]:
        """What `ecatctl info` shows of links and slaves, in addition to the shared memory."""
        conditions = {i: self.slaves.repair.condition(i) for i in range(len(self._bus.slaves))}
        recovery = [
            {"slave": position, "state": str(word), "text": text}
            for position, (word, text) in conditions.items()
            if word
        ]
        return {**self._interfaces.describe(), "recovery": recovery}

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Starts passing the events of the engine and of the links to the event loop."""
        self._interfaces.start(loop)
        self._thread = threading.Thread(target=self._watch_events, args=(loop,), daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Ends the watch: handles no more events, and brings no more slaves back."""
        self._stopping.set()
        self._requests.close()
        self.slaves.close()

    def close(self) -> None:
        """Waits until nothing uses the engine any more; after `stop`."""
        if self._thread is not None:
            self._thread.join()
        self._handle_last_events()
        for item in self._working_counters:
            item.close()
        self._outputs.close()
        self._can.close()
        self._mailboxes.close()
        if self._clocks is not None:
            self._clocks.close()
        self._interfaces.close()

    def _watch_events(self, loop: asyncio.AbstractEventLoop) -> None:
        while not self._stopping.is_set():
            if not self._room.acquire(timeout=_EVENT_PATIENCE):
                continue
            event = self._engine.wait_event(_EVENT_PATIENCE)
            if event is None:
                self._room.release()
            else:
                self._events.append(event)
                loop.call_soon_threadsafe(self._take)

    def _take(self) -> None:
        if self._events:  # else `close` has taken it
            self._room.release()
            self._handle(self._events.popleft())

    def _handle_last_events(self) -> None:
        """Handles what nobody has taken yet: the last events say why outputs became safe."""
        while self._events:
            self._handle(self._events.popleft())
        for _ in range(_LAST_EVENTS):
            if (event := self._engine.wait_event(0)) is None:
                break
            self._handle(event)

    def _handle(self, event: Event) -> None:
        if event.type in _ABOUT_OUTPUTS:
            self._outputs.handle(event)
        elif event.type in can.EVENTS:
            self._can.handle(event)
        elif not self._stopping.is_set():
            self._handle_while_running(event)

    def _handle_while_running(self, event: Event) -> None:
        match event.type:
            case EventType.REQUEST:
                self._requests.ring(event.slot)
            case EventType.WKC:
                self._working_counters[event.slave].note(event)
            case EventType.SEND:
                self._interfaces.on_send(event)
            case EventType.SLAVES:
                self.slaves.on_change(event.slave, event.cycle)
            case EventType.RING:
                self._interfaces.on_ring(event)
            case EventType.CLOCK:
                if self._clocks is not None:
                    self._clocks.handle(event)
            case EventType.OVERRUN:
                self._interfaces.look()

    def _on_wrong_request(self, slot: int, generation: int) -> None:
        kind = EventType.MALFORMED
        cycle = self._shared.header.cycle
        self._outputs.handle(Event(kind, slave=-1, slot=slot, value=generation, cycle=cycle))

    async def _start_anew(self, slave: int) -> None:
        await self.slaves.change([slave], AlState.INIT)
        await self.slaves.change([slave], AlState.OP)

    def _report_working_counter(self, event: Event) -> None:
        state = shm.WkcState(event.value).name.lower()
        text = f"domain {event.slave}: working counter {state}"
        self._log.debug(text)
        times = self._working_counters[event.slave].taken
        facts = {"domain": event.slave, "state": state, "cycle": event.cycle, "times": times}
        self._publish("working_counter", **facts, text=text)

    def _publish(self, kind: str, **facts: Any) -> None:
        event = new_event(kind, **facts)
        if "cycle" in facts:  # it stands beside the values of its cycle, and not where it was seen
            event["time_ns"] = min(event["time_ns"], self._time_of(facts["cycle"]))
        self._send(event)

    def _time_of(self, cycle: int) -> int:
        """Unix time in ns of the end of a cycle, about: as if all had lasted equally long."""
        head = self._shared.header
        newest, end_ns = head.cycle, head.cycle_end_ns
        while newest != head.cycle:  # the engine has written the other one meanwhile
            newest, end_ns = head.cycle, head.cycle_end_ns
        ago_ns = time.monotonic_ns() - end_ns + (newest - cycle) * head.cycle_time_ns
        return time.time_ns() - int(ago_ns)

    async def _explain(self, kind: str) -> str:
        """Why frames are not sent or get lost, as far as interfaces and cables know; else empty."""
        return await self._interfaces.explain(kind) or (
            await self.cables.explain() if kind == LOST else ""
        )

    async def run(self) -> None:
        """Watches everything until the watch is stopped."""
        watches = [
            self.slaves.watch,
            self._interfaces.watch,
            self.exchange.watch,
            self.cables.watch,
            self._mailboxes.watch,
            self._files.watch,
            self._drives.watch,
        ]
        if self._clocks is not None:
            watches.append(self._clocks.watch)
        await asyncio.gather(*(self._persist(watch) for watch in watches))

    async def _persist(self, watch: Callable[[], Awaitable[None]]) -> None:
        """Starts a watch again whenever it fails: an unwatched bus looks like a healthy one."""
        while not self._stopping.is_set():
            try:
                await watch()
            except StateError:
                await asyncio.sleep(0.1)  # the worker is busy: the next look is soon
            except Exception as error:
                if self._stopping.is_set():
                    return  # what it looks at is closed already
                self._log.error(f"defect in ecatd while watching the bus: {error!r}")
                await asyncio.sleep(1)

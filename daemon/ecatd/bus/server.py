"""The life of a bus: from an interface to slaves in OP, and back.

Order matters and is all here: scan in PREOP, map, SAFEOP, exchange with safe outputs, OP, publish.
Stopping goes the same way back: safe outputs, SAFEOP, INIT, no more frames.
"""

from __future__ import annotations

import asyncio
import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from ecatd import shm
from ecatd.log import Log
from ecatd.model.al import AlState
from ecatd.model.bus import Bus
from ecatd.model.config import Config
from ecatd.model.errors import StateError
from ecatd.model.messages import (
    Describe,
    ReadStates,
    Request,
    SdoRead,
    SdoWrite,
    SetState,
)
from ecatd.version import VERSION

from .engine import Engine, Event, EventType, RealTime
from .layout import Image, lay_out
from .mailbox import Mailbox
from .mapping import Scanned, configure, scan_slave
from .master import Master, SlaveState
from .safe import safe_images
from .segment import Segment
from .slot_requests import SlotRequests

_MONITOR_PERIOD = 0.25
_EVENT_PATIENCE = 0.2
_STOP_CYCLES = 3
_STOP_TIMEOUT = 1.0
_UPWARDS = (AlState.PREOP, AlState.SAFEOP)

_REASONS = {
    shm.Reason.RELEASED: "their owner released them",
    shm.Reason.LAPSED: "their owner gave no sign of life",
    shm.Reason.GONE: "their owner is gone",
    shm.Reason.STOPPING: "the daemon stops",
}


_SETTINGS = {
    shm.Setting.SCHEDULING: "SCHED_FIFO priority {} (needs CAP_SYS_NICE)",
    shm.Setting.AFFINITY: "CPU {}",
    shm.Setting.MEMORY: "locked memory (needs CAP_IPC_LOCK)",
}


class BusServer:
    """One bus.

    Args:
        config: The configuration.
        interface: The interface, which may come from the simulator instead of the configuration.
        log: Where events are told.
        publish: Called with every event, as a map, on the event loop's thread.
    """

    def __init__(
        self, config: Config, interface: str, log: Log, publish: Callable[[dict[str, Any]], None]
    ) -> None:
        self._config = config
        self._interface = interface
        self._log = log
        self._publish = publish
        self._mailbox = Mailbox()
        self._stopping = threading.Event()
        self._aborted = threading.Event()  # ends waiting for slaves while the bus is brought up
        self._states: list[SlaveState] = []
        self._started = 0.0
        self._master: Master | None = None
        self._segment: Segment | None = None
        self._engine: Engine | None = None
        self._requests: SlotRequests | None = None
        self._events: threading.Thread | None = None
        self.bus = Bus(config.bus, config.cycle_time_us)

    async def start(self) -> None:
        """Brings the bus to OP and publishes it.

        Raises:
            EcatError: It does not work; nothing is left behind after `stop`.
        """
        loop = asyncio.get_running_loop()
        await self._mailbox.run(self._bring_up)
        assert self._segment is not None
        assert self._engine is not None
        assert self._master is not None
        self._requests = SlotRequests(
            self._segment, self._engine, self._mailbox, self._master, len(self.bus.slaves)
        )
        self._events = threading.Thread(target=self._watch_events, args=(loop,), daemon=True)
        self._events.start()

    def abort(self) -> None:
        """Has a start that is under way end soon, by an error."""
        self._aborted.set()

    def _bring_up(self) -> None:
        config = self._config
        begin = time.monotonic()
        # First what keeps others away, so that nothing is done to a bus that somebody else runs.
        self._segment = Segment(config.bus)
        self._master = master = Master(self._interface, self._aborted.is_set)
        count = master.scan()
        self._log.info(f"{count} slave{'s' * (count != 1)} found on {self._interface}")
        master.reach(AlState.PREOP, config.state_timeout_s)
        scanned = self._scan_slaves(master, count)
        self.bus.slaves = [item.slave for item in scanned]
        image = lay_out(self.bus, {item.slave.position for item in scanned if item.sii.without_lrw})
        configure(master, scanned, image)
        master.reach(AlState.SAFEOP, config.state_timeout_s)
        self._exchange(self._segment, image)
        self._reach_op(master, self._segment)
        self._publish_states(master.states())
        self._segment.publish()
        self._started = time.time()
        self._log.info(
            f"bus '{self.bus.name}' is in OP: {count} slaves, {image.output_bytes} bytes of "
            f"outputs, {sum(d.input_bytes for d in image.domains)} of inputs, every "
            f"{config.cycle_time_us} µs (after {time.monotonic() - begin:.1f} s)"
        )

    def _scan_slaves(self, master: Master, count: int) -> list[Scanned]:
        scanned = []
        for position in range(count):
            if self._aborted.is_set():
                raise StateError("stopped while slaves were being read")
            scanned.append(scan_slave(master, position))
        return scanned

    def _exchange(self, segment: Segment, image: Image) -> None:
        """Starts the cyclic exchange with all outputs safe."""
        config = self._config
        cycle_ns = config.cycle_time_us * 1000
        lease_max = config.outputs.lease_max_ms * 1_000_000
        lease = min(config.outputs.lease_cycles * cycle_ns, lease_max)
        safe = safe_images(self.bus, config.outputs.safe)
        segment.fill(self.bus, image, lease, lease_max)
        self._engine = Engine(segment.address, segment.out_fd, self._interface)
        for domain in image.domains:
            self._engine.add_domain(domain)
        for position, (value, hold) in safe.items():
            self._engine.set_safe(position, value, hold)
        wanted = config.realtime
        grants = self._engine.start(
            RealTime(wanted.priority, wanted.cpu, wanted.lock_memory, wanted.busy_receive)
        )
        segment.set_grants(grants)
        refused = [
            f"{_SETTINGS[grant.setting].format(grant.value)}: {os.strerror(grant.error)}"
            for grant in grants
            if grant.error
        ]
        if refused:
            self._log.warning(f"no real time: not granted are {'; '.join(refused)}")

    def _reach_op(self, master: Master, segment: Segment) -> None:
        """Asks for OP when outputs have been sent a few times; slaves want valid ones first."""
        first = segment.header.cycle
        deadline = time.monotonic() + self._config.state_timeout_s
        while segment.header.cycle < first + _STOP_CYCLES:
            if time.monotonic() > deadline:
                raise StateError("the cyclic engine does not run")
            time.sleep(self._config.cycle_time_us * 1e-6)
        master.reach(AlState.OP, self._config.state_timeout_s)

    def _publish_states(self, states: list[SlaveState]) -> list[SlaveState]:
        """Writes AL states to shared memory; returns those that have changed."""
        assert self._segment is not None
        changed = [
            now
            for now in states
            if not self._states or now != self._states[min(now.position, len(self._states) - 1)]
        ]
        for now in changed:
            row = self._segment.slave_status[now.position]
            row.al_state, row.al_code = now.al_state, now.al_code
        self._states = states
        return changed

    def _watch_events(self, loop: asyncio.AbstractEventLoop) -> None:
        """Thread: brings the engine's events to the event loop."""
        assert self._engine is not None
        while not self._stopping.is_set():
            event = self._engine.wait_event(_EVENT_PATIENCE)
            if event is not None and not self._stopping.is_set():
                loop.call_soon_threadsafe(self._handle, event)

    def _handle(self, event: Event) -> None:
        if self._stopping.is_set():
            return
        if event.type == EventType.REQUEST:
            assert self._requests is not None
            self._requests.look(event.slot, event.value)
        elif event.type == EventType.CLAIMED:
            self._tell("claimed", slave=event.slave, slot=event.slot, cycle=event.cycle)
        elif event.type == EventType.SAFE:
            cause = shm.Reason(event.value)
            if cause in (shm.Reason.LAPSED, shm.Reason.GONE):
                self._log.warning(
                    f"outputs of {self.bus.slaves[event.slave].label} are safe: {_REASONS[cause]}"
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

    def _tell(self, kind: str, **facts: Any) -> None:
        self._publish({"event": kind, "time_ns": time.time_ns(), **facts})

    async def monitor(self) -> None:
        """Watches the AL states until the server stops."""
        while not self._stopping.is_set():
            await asyncio.sleep(_MONITOR_PERIOD)
            try:
                await self._look_at_states()
            except StateError:
                continue  # the mailbox is busy: the next look is soon
            except Exception as error:
                # Watching must go on: an unwatched bus looks like a healthy one.
                self._log.error(f"defect while reading AL states: {error!r}")

    async def _look_at_states(self) -> None:
        """Reads the AL states, and tells of every change."""
        assert self._master is not None
        master = self._master
        self._tell_states(await self._mailbox.run(lambda: self._publish_states(master.states())))

    def _tell_states(self, changed: list[SlaveState]) -> None:
        for item in changed:
            # OP is what everybody wants; leaving it may be wanted, too, but somebody should know.
            tell = self._log.info if item.al_state == AlState.OP else self._log.warning
            tell(f"{self.bus.slaves[item.position].label}: {item.describe()}")
            self._tell(
                "al_state",
                slave=item.position,
                al_state=item.al_state,
                al_code=item.al_code,
                text=item.describe(),
            )

    async def answer(self, request: Request) -> dict[str, Any]:
        """Carries a request out.

        Raises:
            EcatError: It cannot be done, or the slave refuses.
        """
        match request:
            case Describe():
                return self._describe()
            case ReadStates():
                await self._look_at_states()
                return {"slaves": [self._state_row(item) for item in self._states]}
            case SetState():
                return await self._set_state(request)
            case SdoRead(slave, index, subindex, complete):
                self._check_slave(slave)
                master = self._coe_master(slave)
                data = await self._mailbox.run(
                    lambda: master.sdo_read(slave, index, subindex, complete=complete)
                )
                return {"data": data, **self._known_type(slave, index, subindex)}
            case SdoWrite(slave, index, data, subindex, complete):
                self._check_slave(slave)
                master = self._coe_master(slave)
                await self._mailbox.run(
                    lambda: master.sdo_write(slave, index, subindex, data, complete=complete)
                )
                return {}

    def _describe(self) -> dict[str, Any]:
        return {
            "bus": self.bus.to_dict(),
            "info": {
                "version": VERSION,
                "interface": self._interface,
                "started": self._started,
                "cycle_time_us": self._config.cycle_time_us,
            },
        }

    def _state_row(self, item: SlaveState) -> dict[str, Any]:
        return {
            "position": item.position,
            "name": self.bus.slaves[item.position].name,
            "al_state": item.al_state,
            "al_code": item.al_code,
            "text": item.describe(),
        }

    async def _set_state(self, request: SetState) -> dict[str, Any]:
        assert self._master is not None
        master, target = self._master, AlState.parse(request.state)
        if request.slave is not None:
            self._check_slave(request.slave)
        chosen = range(len(self.bus.slaves)) if request.slave is None else [request.slave]
        timeout = self._config.state_timeout_s

        def change() -> None:
            # Up one state at a time, as the state machine wants it; down in one go.
            for state in _UPWARDS:
                states = {item.position: item.al_state & 0x0F for item in master.states()}
                below = [position for position in chosen if states[position] < state]
                if state < target and below:
                    master.reach(state, timeout, below)
            master.reach(target, timeout, chosen)

        try:
            await self._mailbox.run(change)
        finally:
            await self._look_at_states()
        return {"slaves": [self._state_row(item) for item in self._states]}

    def _check_slave(self, position: int) -> None:
        if position >= len(self.bus.slaves):
            raise StateError(
                f"there is no slave {position}: bus '{self.bus.name}' has {len(self.bus.slaves)} "
                f"slaves, 0 to {len(self.bus.slaves) - 1}"
            )

    def _coe_master(self, position: int) -> Master:
        slave = self.bus.slaves[position]
        if not slave.coe:
            raise StateError(f"{slave.label} has no object dictionary: it does not speak CoE")
        assert self._master is not None
        return self._master

    def _known_type(self, position: int, index: int, subindex: int) -> dict[str, Any]:
        """Name and type of an object that is in the process image; others are not known here."""
        slave = self.bus.slaves[position]
        for outputs in (True, False):
            for _pdo, entry, _bit in slave.entries(outputs=outputs):
                if (entry.index, entry.subindex) == (index, subindex):
                    return {"name": entry.name, "data_type": entry.data_type, "unit": entry.unit}
        return {}

    async def stop(self) -> None:
        """Takes the bus down in order; also after a start that failed half-way."""
        self._stopping.set()
        if self._segment is not None:
            self._segment.set_state(shm.BusState.STOPPING)
        if self._engine is not None:
            self._engine.make_safe()
            await asyncio.sleep((_STOP_CYCLES + 1) * self._config.cycle_time_us * 1e-6)
        if self._events is not None:
            self._events.join()
        await asyncio.to_thread(self._mailbox.close)
        self._aborted.clear()  # on the way down slaves are waited for
        await asyncio.to_thread(self._take_down)

    def _take_down(self) -> None:
        try:
            if self._master is not None and self.bus.slaves:
                for state in (AlState.SAFEOP, AlState.INIT):
                    # Slaves that are gone cannot be asked; their watchdog takes care of them.
                    with suppress(StateError):
                        self._master.reach(state, _STOP_TIMEOUT)
        finally:
            if self._engine is not None:
                self._engine.close()
            if self._segment is not None:
                self._segment.close()
            if self._master is not None:
                self._master.close()

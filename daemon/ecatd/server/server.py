"""Starts, runs and stops a bus, and answers requests about it.

`start/bring_up.py` brings the bus to OP, and `watch/monitor.py` watches it there. A stop takes the
steps in the reverse order: safe outputs, SAFEOP, INIT, no more frames.
"""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, TypeVar, cast

from ecatd.base.errors import StateError
from ecatd.base.log import Log
from ecatd.base.log_levels import Levels, level_of, level_of_each, levels_text, with_level
from ecatd.base.supervised_process import HANG_S
from ecatd.base.timeouts import Timeout
from ecatd.base.version import VERSION
from ecatd.config import Config
from ecatd.config.meanings import object_meaning
from ecatd.config.resolve import missing_audit_folder
from ecatd.description.bus import Bus, Slave
from ecatd.etg.al import AlState
from ecatd.etg.pdo import Entry
from ecatd.master.al_states import SlaveState, states_text
from ecatd.master.engine.engine import Engine
from ecatd.master.engine.shared_memory import SharedMemory
from ecatd.master.ethernet.traffic import EthernetTraffic
from ecatd.master.worker import Worker
from ecatd.operations.bus import (
    Configuration,
    Events,
    Fault,
    Info,
    MissingSlave,
    ReadConfig,
    ReadEvents,
    ReadInfo,
    ReadStates,
    SetState,
    SlaveAlState,
    States,
)
from ecatd.operations.description import BusDescription, Describe
from ecatd.operations.events import new_event
from ecatd.operations.frames import Frames, ReadFrames
from ecatd.operations.handlers import handles
from ecatd.operations.health import look_at
from ecatd.operations.log import LogLevels, ReadLogLevels, SetLogLevel
from ecatd.operations.operation import Operation
from ecatd.shm import contract as shm

from .requests.changes import ZENOH, Changes
from .requests.conversations import Conversations
from .requests.frames import read_frames
from .requests.requests import Requests
from .start.bring_up import BringUp
from .start.exchange import leases
from .watch.event_history import EventHistory
from .watch.fault_files import FaultFiles
from .watch.monitor import Monitor

_STOP_CYCLES = 3
_STOP_PATIENCE = Timeout(1.0)
_SAFE_TIMEOUT = 5.0
"""Most seconds to wait until safe outputs are sent. SAFEOP follows in any case, and in SAFEOP the
slaves make their outputs safe themselves. Even a slow domain must not delay the stop so long that
the service kills the process (`service/supervisor.py`)."""

_ATTEND_PERIOD = 1.0
_ATTENDED_MIN = 3
"""Fewest cycles for which the engine goes on without a sign from the control side."""
_SHOWN = 3
"""Most slaves that the status of the service names."""

A = TypeVar("A")


def _nothing() -> None:
    """Does nothing. A worker that runs it soon does its work."""


class BusServer:
    """One bus.

    Args:
        config: The configuration.
        in_force: The same configuration as the user has given it, with the origins of its values;
            the reply to `ReadConfig`.
        interface: The interface, which may come from the simulator instead of the configuration.
        log: The log for events.
        publish: Called with every event, as a map, on the event loop's thread.
        set_levels: Called when a request has changed the levels of the log; gets the new levels.
        memory: The folder for the shared memory.
    """

    def __init__(
        self,
        config: Config,
        in_force: dict[str, Any],
        interface: str,
        log: Log,
        publish: Callable[[dict[str, Any]], None],
        set_levels: Callable[[Levels], None],
        memory: Path,
    ) -> None:
        self._config = config
        self._in_force = in_force
        self._interface = interface
        self._log = log
        self._events = EventHistory(publish)
        self._changes = Changes(log, self._events.publish)
        self._set_levels = set_levels
        self._configured = config.log
        self._use_audit_file(config)
        self._worker = Worker()
        self._aborted = threading.Event()  # ends waiting for slaves while the bus is brought up
        self._up = BringUp(config, interface, log, self._aborted.is_set, memory)
        self._monitor: Monitor | None = None
        self._fault_files: FaultFiles | None = None
        self._requests: Requests | None = None
        self._ethernet: EthernetTraffic | None = None
        self._started = 0.0
        self._asked_at = time.monotonic()  # when the service has asked whether this process works
        self._missing: list[dict[str, Any]] = []  # slaves that were missing at the start

    @property
    def bus(self) -> Bus:
        """The bus description; it has slaves once they have been read."""
        return self._up.bus

    @property
    def begin(self) -> str:
        """The bus in one line, at the end of the start."""
        return self._up.begin

    async def start(self) -> None:
        """Brings the bus to OP and publishes its shared memory.

        Raises:
            EcatError: The start failed; `stop` cleans up.
        """
        self._monitor = await self._worker.run(self._bring_up)
        assert self._up.master is not None
        conversations = Conversations(self._up.master, self._worker, self._monitor.emergencies.note)
        self._ethernet = EthernetTraffic(
            *(self._config.eoe, self.bus, self._up.master, self._worker),
            *(self._monitor.emergencies.note, self._log),
        )
        self._requests = Requests(
            self.bus,
            self._up.master,
            self._config,
            self._worker,
            conversations,
            self._monitor,
            self._meaning,
            self._changes,
            self._log,
            *(self, self._ethernet),
        )
        self._monitor.start(asyncio.get_running_loop())

    def _meaning(self, slave: Slave, entry: Entry) -> Entry:
        """What an object means that is not in the process data."""
        return object_meaning(slave, entry, self._up.profiles, self._up.config.signal)

    def abort(self) -> None:
        """Makes a start that is under way fail soon."""
        self._aborted.set()

    def _bring_up(self) -> Monitor:
        running = self._up.run()
        self._events.instance = running.shared.header.instance
        self._fault_files = FaultFiles(
            *(self.bus.name, self._config.capture, self._up.frame_rings, running.interfaces),
            *(running.shared.header.cycle, self._log),
        )
        monitor = Monitor(
            running,
            self._up.config.outputs,
            self._config.health,
            self.answer,
            self._worker,
            self._log,
            self._events.publish,
            self._fault_files,
        )
        monitor.read_states()
        self._missing = running.expectation.left_out
        running.shared.publish()
        self._started, self._asked_at = time.time(), time.monotonic()
        return monitor

    async def reconfigure(self, config: Config, in_force: dict[str, Any]) -> None:
        """Takes over the settings that can change while the bus runs; see `model.config.reload`.

        Raises:
            ConfigError: Limits do not fit other values of the configuration; nothing has changed.
            StateError: Limits are about a slave that does not exist; nothing has changed.
        """
        up = self._up
        assert up.shared is not None, "asked before the bus was brought up"
        assert up.engine is not None
        assert up.master is not None
        assert up.limits is not None
        if config.signal != self._config.signal:
            bus = await asyncio.to_thread(up.limits.check, config)
            self._report_held(await self._worker.run(partial(up.limits.use, bus)))
        if config.mailbox != self._config.mailbox:
            await self._worker.run(partial(up.master.set_share, config.mailbox.share))
        up.engine.set_wkc_limit(config.outputs.wkc_limit)
        self._config, self._in_force = config, in_force
        self._running.set_recovery(config.recovery)
        self._running.set_health(config.health)
        up.shared.set_leases(*leases(config))
        if self._fault_files is not None:
            self._fault_files.set_config(config.capture)
        self._configured = config.log
        self._use_audit_file(config)
        self._events.publish(
            new_event("configuration", text="the configuration was read again, and has changed")
        )

    def _use_audit_file(self, config: Config) -> None:
        self._log.set_audit_file(config.audit_file)
        for warning in missing_audit_folder(config):
            self._log.warning(warning)

    def _report_held(self, outputs: list[str]) -> None:
        if outputs:
            one = len(outputs) == 1
            self._log.of("outputs").warning(
                f"{', '.join(outputs)} {'was beyond its' if one else 'were beyond their'} new "
                f"limits; the value is the nearer limit now, until a value within them is written"
            )

    async def monitor(self) -> None:
        """Watches the bus, and carries Ethernet frames, until the server stops."""
        assert self._ethernet is not None, "asked before the bus was brought up"
        await asyncio.gather(self._running.run(), self._ethernet.run())

    async def attend(self) -> None:
        """Tells the engine regularly that the control side works, until the server stops.

        Raises:
            StateError: The control side was silent for too long, so the engine has made the outputs
                safe.
        """
        assert self._up.engine is not None, "asked before the bus was brought up"
        cycles = max(_ATTENDED_MIN, round(HANG_S * 1e6 / self._config.cycle_time_us))
        while True:
            await self._worker.run(_nothing)
            if not self._up.engine.attend(cycles):
                raise StateError(
                    f"the bus server stood still for {Timeout(HANG_S)}, so the engine has made "
                    f"the outputs safe: other programs took the processor, or this is a defect"
                )
            await asyncio.sleep(_ATTEND_PERIOD)

    async def report(self) -> dict[str, Any]:
        """Returns the answer to the service's ping, which comes every second.

        It answers only if the worker does its work.
        """
        self._asked_at = time.monotonic()
        await self._worker.run(_nothing)
        health = look_at(self._states())
        assert self._up.shared is not None, "asked before the bus was brought up"
        return {
            "cycle": self._up.shared.header.cycle,
            "status": health.sentence(_SHOWN) if health.problems else self._up.summary,
        }

    @property
    def _running(self) -> Monitor:
        assert self._monitor is not None, "asked before the bus was brought up"
        return self._monitor

    async def answer(self, operation: Operation[A], slot: int = ZENOH) -> A:
        """Carries an operation out; see `Requests.answer`."""
        assert self._requests is not None, "asked before the bus was brought up"
        return await self._requests.answer(operation, slot)

    @handles(Describe)
    def _describe(self, _: Describe) -> BusDescription:
        return cast("BusDescription", self.bus.to_dict())

    @handles(ReadConfig)
    def _read_config(self, _: ReadConfig) -> Configuration:
        return cast("Configuration", self._in_force)

    @handles(ReadStates)
    async def _read_states(self, _: ReadStates) -> States:
        await self._running.look()
        return self._states()

    @handles(ReadEvents)
    def _read_events(self, request: ReadEvents) -> Events:
        return cast("Events", self._events.since(request.since))

    @handles(ReadFrames)
    def _read_frames(self, request: ReadFrames) -> Frames:
        return read_frames(self._up.frame_rings, self._up.interfaces, request)

    @handles(ReadInfo)
    def _info(self, _: ReadInfo) -> Info:
        assert self._up.wire is not None, "asked before the bus was brought up"
        wire = self._up.wire
        found = {
            "version": VERSION,
            "host": socket.gethostname(),
            "interface": self._interface,
            "started": self._started,
            "cycle_time_us": self._config.cycle_time_us,
            "wire_us": round(wire.round_trip_us, 1),
            "wire_frames": wire.frames,
            "wire_bytes": wire.wire_bytes,
            **self._running.describe(),
        }
        return cast("Info", found)

    def _states(self) -> States:
        return {
            "slaves": [self._state_row(item) for item in self._running.states],
            "missing": cast("list[MissingSlave]", self._missing),
            "others": self._running.others,
            "faults": [cast("Fault", fault.to_map()) for fault in self._running.faults],
            "service_silent_s": time.monotonic() - self._asked_at,
        }

    def _state_row(self, item: SlaveState) -> SlaveAlState:
        condition, more = self._running.condition(item.position)
        found = {
            "position": item.position,
            "name": self.bus.slaves[item.position].name,
            "given_name": self.bus.slaves[item.position].given_name,
            "group": self.bus.slaves[item.position].group,
            "al_state": item.al_state,
            "al_code": item.al_code,
            "text": item.describe(),
            "recovery": str(condition),
            "recovery_text": more,
            "since": self._running.down_since(item.position),
            **self._running.present(item.position),
        }
        return cast("SlaveAlState", found)

    @handles(SetState)
    async def _set_state(self, request: SetState) -> States:
        if request.slave is None:
            slaves = self.bus.slaves
            there = {item.position for item in self._running.states if item.al_state}
            chosen = [n for n, slave in enumerate(slaves) if n in there or not slave.group]
        else:
            chosen = [self.bus.find(request.slave).position]
        whom = "all slaves" if request.slave is None else self.bus.find(request.slave).label
        state = AlState.parse(request.state)
        with self._changes.telling(f"{whom}, AL state", state.name, request.by) as change:
            change.before = states_text(self._running.states[n] for n in chosen)
            await self._running.change(chosen, state)
            await self._running.look()
        return self._states()

    @handles(ReadLogLevels)
    def _read_log_levels(self, _: ReadLogLevels) -> LogLevels:
        return self._log_levels()

    def _log_levels(self) -> LogLevels:
        return {
            "levels": level_of_each(self._log.levels),
            "configured": level_of_each(self._configured),
        }

    @handles(SetLogLevel)
    def _set_log_level(self, request: SetLogLevel) -> LogLevels:
        before, part = self._log.levels, request.part
        after = self._log.levels = with_level(before, part, request.level)
        self._set_levels(after)
        was = levels_text(before) if part is None else level_of(before, part)
        text = (
            f"log level of {part or 'all parts'} changed from {was} to {request.level} by "
            f"{request.by}, until the configuration is read again"
        )
        self._log.notice(text)
        self._events.publish(new_event("log_levels", text=text))
        return self._log_levels()

    async def stop(self) -> None:
        """Takes the bus down in order, also after a start that has failed."""
        shared, engine = self._up.shared, self._up.engine
        if shared is not None:
            shared.set_state(shm.BusState.STOPPING)
        if engine is not None and shared is not None:
            await self._make_safe(engine, shared)
        if self._requests is not None:
            self._requests.close()
        if self._monitor is not None:
            self._monitor.stop()
            self._monitor.close()
        if self._fault_files is not None:
            await self._fault_files.close()
        await asyncio.to_thread(self._worker.close)
        self._changes.close()
        self._events.close()
        self._aborted.clear()  # taking the bus down has to wait for slaves
        await asyncio.to_thread(self._take_down)

    async def _make_safe(self, engine: Engine, shared: SharedMemory) -> None:
        """Sends safe outputs while slaves are in OP, and waits until drives have stopped."""
        cycle_s, header = self._config.cycle_time_us * 1e-6, shared.header
        first = header.cycle
        engine.make_safe()
        if first == 0:
            return  # the exchange has not begun
        deadline = time.monotonic() + _SAFE_TIMEOUT
        enough = first + _STOP_CYCLES + self.bus.output_cycles
        while header.cycle < enough and time.monotonic() < deadline:
            await asyncio.sleep(cycle_s)
        # The engine itself ends each stop after its time, so this deadline is never reached.
        deadline = time.monotonic() + self._config.outputs.longest_stop + _SAFE_TIMEOUT
        while engine.stopping and time.monotonic() < deadline:
            await asyncio.sleep(cycle_s)

    def _take_down(self) -> None:
        up = self._up
        try:
            if up.master is not None and self.bus.slaves:
                # Nobody waits for slaves that are gone; their watchdogs make their outputs safe.
                here = {
                    n.position: n.al_state & 0x0F for n in up.master.al_states.read() if n.al_state
                }
                # Only slaves in OP go to SAFEOP. Those of a refused start are in PREOP, below it.
                in_op = [position for position, state in here.items() if state == AlState.OP]
                with suppress(StateError):
                    up.leave(AlState.INIT, _STOP_PATIENCE)
                for state, asked in ((AlState.SAFEOP, in_op), (AlState.INIT, list(here))):
                    if asked:
                        try:
                            up.master.al_states.wait_for(state, _STOP_PATIENCE, asked)
                        except StateError as error:
                            self._log.warning(f"at the stop: {error}")
                # A slave may hear this although its answers were lost.
                up.master.al_states.tell_all(AlState.INIT)
            if up.clocks is not None:
                up.clocks.sync_signals.stop()
        finally:
            if up.engine is not None:
                up.engine.close()
            if up.shared is not None:
                up.shared.close()
            if up.master is not None:
                up.master.close()
            for ring in up.frame_rings.values():
                ring.close()

"""Runs a bus, answers requests about it, and stops it.

`start/bring_up.py` brings the bus to OP, and `watch/monitor.py` watches it there.
"""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Self, TypeVar, cast

from ecatd.base.errors import StateError
from ecatd.base.log import Log
from ecatd.base.log_levels import Levels, level_of, level_of_each, levels_text, with_level
from ecatd.base.supervised_process import HANG_S
from ecatd.base.timeouts import Timeout
from ecatd.base.version import VERSION
from ecatd.config import Config
from ecatd.config.meanings import object_meaning
from ecatd.config.resolve import missing_audit_folder, unused_conditions
from ecatd.description.bus import Slave
from ecatd.description.cables import Cables
from ecatd.etg.al import AlState
from ecatd.etg.pdo import Entry
from ecatd.master.al_states import SlaveState, states_text
from ecatd.master.ethernet.traffic import EthernetTraffic
from ecatd.master.worker import Worker
from ecatd.operations import faults
from ecatd.operations.bus import (
    CableState,
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
from ecatd.operations.image import ProcessImage, ReadImage
from ecatd.operations.log import LogLevels, ReadLogLevels, SetLogLevel
from ecatd.operations.operation import Operation
from ecatd.shm import contract as shm

from .requests.changes import ZENOH, Changes
from .requests.conversations import Conversations
from .requests.incidents import Incidents
from .requests.requests import Requests
from .requests.wire import read_frames
from .start.bring_up import BringUp
from .start.exchange import leases
from .start.output_limits import OutputLimits
from .start.running_bus import RunningBus
from .watch.can import unsent_safe_frames
from .watch.event_history import EventHistory
from .watch.monitor import Monitor

_ATTEND_PERIOD = 1.0
_ATTENDED_MIN = 3
"""Fewest cycles for which the engine goes on without a sign from the control side."""
_CABLE_FACTS = ("slave", "port", "before", "before_port", "verdict")
_SHOWN = 3
"""Most slaves that the status of the service names."""

A = TypeVar("A")


def _nothing() -> None:
    """Does nothing. A worker that runs it soon does its work."""


class BusServer:
    """One bus that is in OP; `start` brings it there.

    Args:
        running: The bus.
        worker: The worker on which slaves are asked.
        config: The configuration.
        in_force: The same configuration as the user has given it, with the origins of its values;
            the reply to `ReadConfig`.
        log: The log for events.
        publish: Called with every event, as a map, on the event loop's thread.
        set_levels: Called when a request has changed the levels of the log; gets the new levels.

    Attributes:
        bus: The bus description.
        begin: The bus in one line, at the end of the start.
    """

    def __init__(
        self,
        running: RunningBus,
        worker: Worker,
        config: Config,
        in_force: dict[str, Any],
        log: Log,
        publish: Callable[[dict[str, Any]], None],
        set_levels: Callable[[Levels], None],
    ) -> None:
        self._running = running
        self._worker = worker
        self._config = config
        self._in_force = in_force
        self._log = log
        self._set_levels = set_levels
        self._configured = config.log
        self.bus = bus = running.bus
        self.begin = running.begin
        master = running.master
        self._events = EventHistory(publish, running.shared.header.instance)
        self._changes = Changes(log, self._events.publish)
        self._cables = Cables(bus, config.health.cable_factor)
        self._monitor = Monitor(
            *(running, self.answer, worker, log, self._events.publish, self._cables)
        )
        note = self._monitor.emergencies.note
        self._ethernet = EthernetTraffic(config.eoe, bus, master, worker, note, log)
        conversations = Conversations(master, worker, note)
        self._requests = Requests(
            *(bus, master, config, worker, conversations, self._monitor.slaves, self._meaning),
            *(self._changes, log, self._cables, self, self._ethernet),
            Incidents(config, self._changes, self._events.publish),
        )
        self._limits = OutputLimits(running)
        self._started = time.time()
        recorder = config.flight_recorder
        if recorder.folder:
            text = (
                f"the flight recorder has the last {running.frames_s:.1f} s of this bus in "
                f"{recorder.memory_mb} MiB"
            )
            if running.frames_s < recorder.before_s:
                log.of("recorder").warning(
                    f"{text}, and not the {recorder.before_s:g} s of flight_recorder.before_s: "
                    "choose a larger flight_recorder.memory_mb"
                )
            else:
                log.of("recorder").info(text)
        self._unused = self._unused_conditions()
        self._asked_at = time.monotonic()  # when the service has asked whether this process works

    @classmethod
    async def start(cls, up: BringUp, memory: Path, config: Config, *others: Any) -> Self:
        """Brings a bus to OP, publishes its shared memory, and begins to watch it.

        Args:
            up: Brings it to OP.
            memory: The folder for the shared memory.
            config: The configuration.
            others: The other arguments of the class, from `in_force` on.

        Raises:
            EcatError: The start failed; nothing is left of it.
        """
        worker = Worker()
        try:
            running = await worker.run(partial(up.run, memory))
            try:
                server = cls(running, worker, config, *others)
                await worker.run(server._monitor.slaves.read)
            except BaseException:
                await asyncio.to_thread(running.close)
                raise
        except BaseException:
            await asyncio.to_thread(worker.close)
            raise
        running.shared.publish()
        server._monitor.start(asyncio.get_running_loop())
        return server

    def _meaning(self, slave: Slave, entry: Entry) -> Entry:
        """What an object means that is not in the process data."""
        return object_meaning(slave, entry, self._running.profiles, self._running.config.signal)

    async def reconfigure(self, config: Config, in_force: dict[str, Any]) -> None:
        """Takes over the settings that can change while the bus runs; see `model.config.reload`.

        Raises:
            ConfigError: Limits do not fit other values of the configuration; nothing has changed.
            StateError: Limits are about a slave that does not exist; nothing has changed.
        """
        running = self._running
        if config.signal != self._config.signal:
            bus = await asyncio.to_thread(self._limits.check, config)
            self._report_held(await self._worker.run(partial(self._limits.use, bus)))
        if config.mailbox != self._config.mailbox:
            await self._worker.run(partial(running.master.set_share, config.mailbox.share))
        running.engine.set_wkc_limit(config.outputs.wkc_limit)
        self._config, self._in_force = config, in_force
        self._unused = self._unused_conditions()
        self._monitor.slaves.set_recovery(config.recovery)
        self._monitor.exchange.set_config(config.health)
        self._monitor.cables.set_config(config.health)
        running.shared.set_leases(*leases(config))
        self._configured = config.log
        use_audit_file(self._log, config)
        self._events.publish(
            new_event("configuration", text="the configuration was read again, and has changed")
        )

    def _unused_conditions(self) -> list[faults.Fault]:
        texts = unused_conditions(self._config.flight_recorder, self.bus)
        return [faults.Fault(faults.RECORDER, text, self._started) for text in texts]

    def _report_held(self, outputs: list[str]) -> None:
        if outputs:
            one = len(outputs) == 1
            self._log.of("outputs").warning(
                f"{', '.join(outputs)} {'was beyond its' if one else 'were beyond their'} new "
                f"limits; the value is the nearer limit now, until a value within them is written"
            )

    async def monitor(self) -> None:
        """Watches the bus, and carries Ethernet frames, until the server stops."""
        await asyncio.gather(self._monitor.run(), self._ethernet.run())

    async def attend(self) -> None:
        """Tells the engine regularly that the control side works, until the server stops.

        Raises:
            StateError: The control side was silent for too long, so the engine has made the outputs
                safe.
        """
        cycles = max(_ATTENDED_MIN, round(HANG_S * 1e6 / self._config.cycle_time_us))
        while True:
            await self._worker.run(_nothing)
            if not self._running.engine.attend(cycles):
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
        return {
            "cycle": self._running.shared.header.cycle,
            "status": health.sentence(_SHOWN) if health.problems else self._running.summary,
        }

    async def answer(self, operation: Operation[A], slot: int = ZENOH) -> A:
        """Carries an operation out; see `Requests.answer`."""
        return await self._requests.answer(operation, slot)

    @handles(Describe)
    def _describe(self, _: Describe) -> BusDescription:
        return cast("BusDescription", self.bus.to_dict())

    @handles(ReadConfig)
    def _read_config(self, _: ReadConfig) -> Configuration:
        return cast("Configuration", self._in_force)

    @handles(ReadStates)
    async def _read_states(self, _: ReadStates) -> States:
        await self._monitor.slaves.refresh()
        return self._states()

    @handles(ReadEvents)
    def _read_events(self, request: ReadEvents) -> Events:
        return cast("Events", self._events.since(request.since))

    @handles(ReadFrames)
    def _read_frames(self, request: ReadFrames) -> Frames:
        return read_frames(self._running.frame_rings, self._running.master.interfaces, request)

    @handles(ReadImage)
    def _read_image(self, _: ReadImage) -> ProcessImage:
        return self._running.data.image.to_map()

    @handles(ReadInfo)
    def _info(self, _: ReadInfo) -> Info:
        wire = self._running.data.wire
        found = {
            "version": VERSION,
            "host": socket.gethostname(),
            "interface": self._running.master.interfaces[0],
            "started": self._started,
            "cycle_time_us": self._config.cycle_time_us,
            "wire_us": round(wire.round_trip_us, 1),
            "wire_frames": wire.frames,
            "wire_bytes": wire.wire_bytes,
            "frames_s": round(self._running.frames_s, 1),
            **self._monitor.describe(),
        }
        return cast("Info", found)

    def _states(self) -> States:
        now = time.monotonic()
        return {
            "slaves": [self._state_row(item) for item in self._monitor.slaves.states],
            "missing": cast("list[MissingSlave]", self._running.found.expectation.left_out),
            "others": self._monitor.slaves.others,
            "faults": [
                cast("Fault", fault.to_map()) for fault in (*self._monitor.faults, *self._unused)
            ],
            "cables": [
                cast("CableState", {name: getattr(item, name) for name in _CABLE_FACTS})
                for item in self._cables.judge(now)
            ],
            "service_silent_s": now - self._asked_at,
        }

    def _state_row(self, item: SlaveState) -> SlaveAlState:
        condition, more = self._monitor.slaves.repair.condition(item.position)
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
            "since": self._monitor.slaves.repair.down_since(item.position),
            **self._monitor.slaves.present(item.position),
        }
        return cast("SlaveAlState", found)

    @handles(SetState)
    async def _set_state(self, request: SetState) -> States:
        if request.slave is None:
            slaves = self.bus.slaves
            there = {item.position for item in self._monitor.slaves.states if item.al_state}
            chosen = [n for n, slave in enumerate(slaves) if n in there or not slave.group]
        else:
            chosen = [self.bus.find(request.slave).position]
        whom = "all slaves" if request.slave is None else self.bus.find(request.slave).label
        state = AlState.parse(request.state)
        with self._changes.record(f"{whom}, AL state", state.name, request.by) as change:
            change.before = states_text(self._monitor.slaves.states[n] for n in chosen)
            await self._monitor.slaves.change(chosen, state)
            await self._monitor.slaves.refresh()
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
        """Takes the bus down: safe outputs, SAFEOP, INIT, no more frames."""
        self._running.shared.set_state(shm.BusState.STOPPING)
        await asyncio.to_thread(self._running.make_safe)
        for text in unsent_safe_frames(self._running):
            self._log.warning(text)
        self._requests.close()
        self._monitor.stop()
        self._monitor.close()
        await asyncio.to_thread(self._worker.close)
        self._changes.close()
        self._events.close()
        await asyncio.to_thread(self._running.close)


def use_audit_file(log: Log, config: Config) -> None:
    """Writes changes to the audit file of a configuration from now on."""
    log.set_audit_file(config.audit_file)
    for warning in missing_audit_folder(config):
        log.warning(warning)

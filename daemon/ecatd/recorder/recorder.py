"""Waits for triggers, and writes an incident about each.

Signals are made of the frames that the bus server keeps anyway, so nothing wakes up in each cycle.
What was before a trigger is fetched at once: if the bus server dies then, that part is safe. A
trigger within the window of an incident belongs to it.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from ecatd.base.errors import EcatError
from ecatd.base.log import Log
from ecatd.base.log_levels import DEFAULTS
from ecatd.base.paths import control_socket
from ecatd.base.pcapng import read_records
from ecatd.client import Client
from ecatd.client.patterns import find_signals
from ecatd.config import Config, read_config
from ecatd.config.flight_recorder import FlightRecorderConfig
from ecatd.operations.bus import ReadConfig, ReadEvents, ReadInfo, ReadStates
from ecatd.operations.bus_client import BusClient
from ecatd.operations.description import Describe
from ecatd.operations.frames import NEWEST, RINGS, ReadFrames
from ecatd.operations.image import ReadImage
from ecatd.operations.incident_files import (
    PART,
    check_folder,
    file_name,
    make_folder,
    make_room,
    unwritten,
)
from ecatd.operations.log import ReadLogLevels
from ecatd.shm.statistics import read as read_statistics
from ecatd.shm.statistics import to_map
from ecatd.trace.columns import Columns, described
from ecatd.trace.cycles import CycleReader

from .budget import Budget
from .conditions import Conditions
from .incident import LAPSES, Incident, Row, Trigger, write
from .moments import place_events
from .reading import read as first_reading

_KEPT = 1000
"""Events, and lines of the log, that are kept."""
_PERIOD_S = 0.25
"""Seconds between two looks at the values of conditions."""
_NAMED = 3
"""Most deleted incidents that the log names at a time."""
_AT_ONCE = 3
"""Most incidents that are collected and written at a time; each needs memory."""
_STORY_NS = 3_000_000_000
"""Triggers that are closer may be of one story: ecatd counts errors over seconds."""
_SECTIONS = ("bus", "realtime", "flight_recorder")


class Recorder:
    """The recorder of one bus.

    Args:
        bus: Name of the bus.
        runtime_dir: The folder with the folders of the sockets.
        log: The log.
        stop: Is set when this process has to end, also by the bus server's end.
    """

    def __init__(self, bus: str, runtime_dir: Path, log: Log, stop: asyncio.Event) -> None:
        self._name = bus
        self._log = log
        self._stop = stop
        self._server = BusClient(control_socket(runtime_dir, bus), self._on_event, stop.set)
        self._events: deque[dict[str, Any]] = deque(maxlen=_KEPT)
        self._lines: deque[dict[str, Any]] = deque(maxlen=_KEPT)
        self._documents: dict[str, Any] = {}
        self._config = FlightRecorderConfig()
        self._client: Client | None = None
        self._layout: list[Any] = []
        self._started = 0.0
        self._pending: _Pending | None = None
        self._recordings: set[asyncio.Task[None]] = set()
        self._writing = asyncio.Lock()
        self._watch: asyncio.Task[None] | None = None
        self._others: set[asyncio.Task[Any]] = set()
        self._budget = Budget(self._config.per_hour)
        self._left_out: set[str] = set()  # causes
        self._unwritten = ""  # why the last incident could not be written
        self._refused: deque[int] = deque(maxlen=_KEPT)  # times of triggers without an incident

    @property
    def folder(self) -> Path:
        """The folder of the incidents."""
        return Path(self._config.folder)

    async def connect(self) -> Config:
        """Connects to the bus server, and reads what an incident needs besides frames.

        Returns:
            The configuration, as far as the recorder uses it.

        Raises:
            EcatError: The bus server does not answer.
        """
        await self._server.open()
        config = await self._read_settings()
        self._layout = (await self._server.ask(ReadImage()))["domains"]
        self._documents["bus"] = await self._server.ask(Describe())
        info = await self._server.ask(ReadInfo())
        self._started = info["started"]
        self._documents["info"] = info
        self._client = await asyncio.to_thread(Client, self._name)
        return config

    async def start(self) -> None:
        """Begins to wait for triggers; also takes those since the bus server has started."""
        for old in self.folder.glob(f"{self._name}-*{PART}"):  # of one that was killed
            with suppress(OSError):
                old.unlink()
        for event in (await self._server.ask(ReadEvents()))["events"]:
            if all(event["sequence"] != known["sequence"] for known in self._events):
                self._events.append(event)
        self._watch_conditions()

    async def _read_settings(self) -> Config:
        reply = await self._server.ask(ReadConfig())
        self._documents["configuration"] = reply["config"]
        given = reply["config"]
        config = read_config({key: given[key] for key in _SECTIONS if key in given})
        self._config = config.flight_recorder
        levels = (await self._server.ask(ReadLogLevels()))["levels"]
        self._log.levels = {**DEFAULTS, **levels}
        return config

    def _on_event(self, event: dict[str, Any]) -> None:
        if "line" in event:
            self._lines.append(event["line"])
            return
        self._events.append(event)
        if event["event"] in ("configuration", "log_levels"):
            self._keep(asyncio.create_task(self._reconfigure()))
        if trigger := self._trigger_of(event):
            self._begin(trigger)

    def _keep(self, task: asyncio.Task[Any]) -> None:
        self._others.add(task)
        task.add_done_callback(self._others.discard)

    async def _reconfigure(self) -> None:
        with suppress(EcatError):  # the bus server has ended
            before = self._config
            await self._read_settings()
            self._documents["bus"] = await self._server.ask(Describe())
            if self._config.condition != before.condition:
                self._watch_conditions()

    def _trigger_of(self, event: dict[str, Any]) -> Trigger | None:
        kind, text, time_ns = event["event"], event["text"], event["time_ns"]
        if kind == "incident":
            return Trigger("request", time_ns, text)
        if self._is_before_the_start(event):
            return None
        if self._config.faults and _is_fault(event):
            return Trigger("fault", time_ns, f"{kind}: {text}", _cause(event))
        if self._config.lapses and kind == "safe" and event.get("reason") in LAPSES:
            return Trigger("lapse", time_ns, text, _cause(event))
        return None

    def _is_before_the_start(self, event: dict[str, Any]) -> bool:
        """Whether an event is about a cycle on the way to OP, which is no fault."""
        if "cycle" not in event or self._client is None:
            return False
        with suppress(EcatError):
            self._client.sample()
            ago = (self._client.cycle - event["cycle"]) * self._client.cycle_time
            return bool(time.time() - ago < self._started)
        return False

    def _begin(self, trigger: Trigger) -> None:
        """Begins an incident, or adds a trigger to the one in whose window it is."""
        pending = self._pending
        is_full = len(self._recordings) >= _AT_ONCE
        if pending is not None and (is_full or trigger.time_ns <= pending.end_ns):
            pending.triggers.append(trigger)
            return
        if trigger.kind != "request":
            self._budget.per_hour = self._config.per_hour
            if why_not := self._budget.take(trigger.cause, time.monotonic()):
                self._refused.append(trigger.time_ns)
                if trigger.cause not in self._left_out:
                    self._left_out.add(trigger.cause)
                    self._log.warning(
                        f"no incident is written about {trigger.reason}: {why_not} "
                        "(flight_recorder.per_hour); others of this cause are left out for a "
                        "while, too: `ecatctl events` shows what goes on, and `ecatctl incident "
                        "record` still records"
                    )
                return
            self._left_out.discard(trigger.cause)
        # What was refused a moment ago may be the cause of this one.
        recent = [at for at in self._refused if trigger.time_ns - at < _STORY_NS]
        self._refused.clear()
        self._pending = _Pending(trigger, self._config, min([trigger.time_ns, *recent]))
        task = asyncio.create_task(self._record(self._pending))
        self._recordings.add(task)
        task.add_done_callback(self._recordings.discard)

    async def _record(self, pending: _Pending) -> None:
        try:
            await self._collect(pending)
            async with self._writing:
                await asyncio.to_thread(self._write, pending)
        except OSError as error:
            self._report_unwritten(error)
        except MemoryError:
            self._log.error(
                "no memory for an incident: choose a smaller flight_recorder.before_s or memory_mb"
            )
        except Exception as error:  # a defect here must not be silent, and ends no recorder
            self._log.error(f"defect while an incident is written: {error!r}")
        finally:
            if self._pending is pending:
                self._pending = None

    def check_folder(self) -> None:
        """Makes the folder now, so that a mistake shows before there is an incident.

        Raises:
            OSError: Incidents cannot be written there; the log says so.
        """
        try:
            check_folder(self.folder)
        except OSError as error:
            self._report_unwritten(error)
            raise

    def _report_unwritten(self, error: OSError) -> None:
        """Says in the log why no incident can be written: once, and again after one was."""
        text = unwritten(self.folder, error)
        if text != self._unwritten:
            self._log.warning(text, "incident_written")
        self._unwritten = text

    async def _collect(self, pending: _Pending) -> None:
        """Fetches frames: those before the trigger at once, those behind it later."""
        with suppress(EcatError):  # the bus server has ended: what is there is written
            if self._client is not None:
                self._client.sample()
                pending.newest = self._client.cycle, time.monotonic_ns()
            pending.documents["statistics"] = to_map(read_statistics(self._name), buckets=True)
            await self._fetch(pending)
            rest = (pending.end_ns - time.time_ns()) / 1e9
            with suppress(TimeoutError):
                await asyncio.wait_for(self._stop.wait(), max(rest, 0.001))
            await self._fetch(pending)
            pending.documents["states"] = await self._server.ask(ReadStates())

    async def _fetch(self, pending: _Pending) -> None:
        for ring in RINGS:
            more = True
            while more:
                before = pending.positions[ring]
                answer = await self._server.ask(ReadFrames(ring, before))
                pending.positions[ring] = answer["position"]
                pending.clock_ns = answer["clock_ns"]
                pending.interfaces = answer["interfaces"]
                more = answer["more"]
                await asyncio.to_thread(pending.take, ring, answer["records"])

    def _write(self, pending: _Pending) -> None:
        incident = Incident(
            bus=self._name,
            triggers=pending.triggers,
            signals=[],
            rows=[],
            events=[event for event in self._events if event["time_ns"] >= pending.begin_ns],
            lines=[line for line in self._lines if line["time_ns"] >= pending.begin_ns],
            interfaces=pending.interfaces,
            frames=sorted(
                (
                    frame
                    for _, records in pending.records
                    for frame in read_records(records)
                    if frame.time_ns + pending.clock_ns >= pending.begin_ns
                ),
                key=lambda frame: frame.time_ns,
            ),
            clock_ns=pending.clock_ns,
            documents={**self._documents, **pending.documents},
        )
        self._make_rows(pending, incident)
        incident.events = place_events(incident.events, incident.rows, incident.signals)
        try:
            incident.reading, incident.cause = first_reading(incident)
        except Exception as error:  # the values are worth more than words about them
            self._log.error(f"defect in the first reading of an incident: {error!r}")
            incident.reading = f"{pending.triggers[0].reason}\n"
        make_folder(self.folder)
        path = self.folder / file_name(self._name, pending.triggers[0].time_ns)
        write(path, incident)
        self._unwritten = ""
        most = self._config.disk_mb << 20
        deleted = make_room(self.folder, self._name, most)
        if not path.exists():
            self._log.warning(
                f"the incident has more than flight_recorder.disk_mb = {self._config.disk_mb}, so "
                "it was not kept: choose a larger value, or a smaller before_s"
            )
            return
        gone = ""
        if deleted:
            more = f" and {len(deleted) - _NAMED} more" if len(deleted) > _NAMED else ""
            names = ", ".join(deleted[:_NAMED])
            gone = (
                f"; the oldest were deleted, to keep to flight_recorder.disk_mb = "
                f"{self._config.disk_mb}: {names}{more}"
            )
        self._log.info(f"an incident is in {path}{gone}", "incident_written")

    def _make_rows(self, pending: _Pending, incident: Incident) -> None:
        """Makes the values of each cycle of the frames."""
        if self._client is None or pending.newest is None or not self._layout:
            return
        signals = self._client.signals()
        columns = Columns(signals, self._layout)
        reader = CycleReader(self._layout, round(self._client.cycle_time * 1e9), *pending.newest)
        facts: list[tuple[int, float, int, int]] = []
        for ring, records in pending.records:
            if ring != "cycle":
                continue
            for cycle in reader.read(records):
                time_ns = cycle.time_ns + pending.clock_ns
                if not pending.begin_ns <= time_ns <= max(pending.end_ns, pending.begin_ns):
                    continue
                columns.add(cycle, reader.images)
                failed = sum(state.is_known and not state.is_complete for state in cycle.domains)
                exchange_us = (cycle.time_ns - cycle.begin_ns) / 1e3
                facts.append((time_ns, exchange_us, failed, cycle.unanswered))
        batch = columns.take()
        incident.signals = [described(signal) for signal in signals]
        values: list[list[float | None]] = [list(row) for row in zip(*batch.columns, strict=True)]
        if not batch.columns:
            values = [[] for _ in facts]
        for number, places in enumerate(batch.invalid):
            for place in places:
                values[place][number] = None
        incident.rows = [
            Row(cycle, time_ns, exchange_us, failed, row, unanswered)
            for cycle, (time_ns, exchange_us, failed, unanswered), row in zip(
                batch.cycles, facts, values, strict=True
            )
        ]

    def _watch_conditions(self) -> None:
        if self._watch is not None:
            self._watch.cancel()
            self._watch = None
        if self._config.condition:
            self._watch = asyncio.create_task(self._look_at_values())

    async def _look_at_values(self) -> None:
        assert self._client is not None
        configs, signals = [], []
        for number, condition in enumerate(self._config.condition):
            try:
                (signal,) = find_signals(self._client, [condition.signal])
            except (EcatError, ValueError) as error:
                why = str(error) if isinstance(error, EcatError) else "it is more than one entry"
                self._log.warning(
                    f"flight_recorder.condition[{number}].signal = '{condition.signal}': {why}; "
                    "this condition is not used"
                )
            else:
                configs.append(condition)
                signals.append(signal)
        if not signals:
            return
        try:
            conditions = Conditions(configs, signals, self._layout)
            self._client.sample()
            newest = self._client.cycle, time.monotonic_ns()
            cycle_ns = round(self._client.cycle_time * 1e9)
            reader = CycleReader(self._layout, cycle_ns, *newest)
            position = NEWEST
            while True:
                answer = await self._server.ask(ReadFrames("cycle", position))
                if position != NEWEST and answer["overwritten"] > 0:
                    reader.restart()
                position = answer["position"]
                parts = reader, answer["records"], answer["clock_ns"]
                for trigger in await asyncio.to_thread(conditions.look, *parts):
                    self._begin(trigger)
                if not answer["more"]:
                    await asyncio.sleep(_PERIOD_S)
        except EcatError:
            pass  # the bus server has ended
        except Exception as error:
            self._log.error(f"defect in conditions of the flight recorder: {error!r}")

    async def report(self) -> dict[str, Any]:
        """Returns the answer to the service's ping."""
        return {}

    async def close(self) -> None:
        """Writes an incident that has begun at once, and ends."""
        if self._watch is not None:
            self._watch.cancel()
        await asyncio.gather(*self._recordings)
        for task in list(self._others):
            task.cancel()
        self._server.close()
        if self._client is not None:
            self._client.close()


class _Pending:
    """An incident that has begun.

    Attributes:
        triggers: What has begun it, and what came in its window.
        begin_ns: Unix time at which its window begins.
        end_ns: Unix time at which it ends.
        records: Parts of the frames, with their ring.
        newest: A cycle, and CLOCK_MONOTONIC of its end, about.
    """

    def __init__(self, trigger: Trigger, config: FlightRecorderConfig, first_ns: int) -> None:
        self.triggers = [trigger]
        self.begin_ns = first_ns - round(1e9 * config.before_s)
        self.end_ns = trigger.time_ns + round(1e9 * config.after_s)
        self.positions = dict.fromkeys(RINGS, 0)
        self.records: list[tuple[str, bytes]] = []
        self.interfaces: list[str] = []
        self.clock_ns = 0
        self.newest: tuple[int, int] | None = None
        self.documents: dict[str, Any] = {}

    def take(self, ring: str, records: bytes) -> None:
        """Keeps records if some of them are of the window."""
        if any(frame.time_ns + self.clock_ns >= self.begin_ns for frame in read_records(records)):
            self.records.append((ring, records))


def _is_fault(event: dict[str, Any]) -> bool:
    match event["event"]:
        case "working_counter":
            return bool(event["state"] != "complete")
        case "slaves":
            return bool(event["missing"])
        case "disturbance":
            return not event.get("over")
        case "link":
            return bool(event["state"] != "up")
        case "emergency":
            return True
        case "recovery":
            return bool(event["state"] == "fallen")
        case "ring":
            return bool(event["state"] == "open")
        case "sending":
            return bool(event["error"])
        case "foreign_master":
            return not event.get("over")
        case _:
            return False


def _cause(event: Mapping[str, Any]) -> str:
    """What is alike in events of the same cause: their kind, and what they are about."""
    about = ("slave", "slaves", "missing", "interface", "domain", "program")
    return f"{event['event']} { {name: event[name] for name in about if name in event} }"

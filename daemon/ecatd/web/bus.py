"""What pages see of a daemon, which is watched once for all of them while a page is there."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

from ecatd.base.daemon_threads import in_daemon_thread
from ecatd.base.errors import EcatError, UnreachableError
from ecatd.client.remote import Remote
from ecatd.description.bus_reader import read_bus
from ecatd.operations.bus import ReadConfig, ReadEvents, ReadInfo, ReadStates
from ecatd.operations.description import Describe
from ecatd.operations.operation import Operation
from ecatd.operations.outputs import ReadOutputs
from ecatd.operations.registers import ReadErrors
from ecatd.operations.statistics import ReadClocks, ReadStats
from ecatd.view.lamps import Lamps
from ecatd.view.worst import describe_worst

from .asking import to_operation
from .hub import Hub
from .messages import WORST
from .page import Page
from .signals import describe_signals
from .traces import Traces

_RETRY_S = 1.0
"""Seconds until a daemon that is away is asked again."""
_EVENTS_S = 0.5
_BUSES_S = 10.0
"""Seconds until it is looked for other buses again."""
_EVENTS_MAX = 1000
"""Events that may have to do with the worst cycles."""
_ASKS_MAX = 16
"""Questions of all pages that are asked at a time; the others wait."""
_WATCHED: tuple[tuple[Operation[Any], float], ...] = (
    (ReadOutputs(), 0.5),
    (ReadStats(buckets=True), 1.0),
    (ReadStates(), 1.0),
    (ReadInfo(), 1.0),
    (ReadClocks(), 2.0),
    (ReadErrors(), 5.0),
    (Describe(), 30.0),
    (ReadConfig(), 30.0),
)
"""What is watched, and every how many seconds. A reload changes the last two, without a restart."""
_LAMPS = (ReadStats.key, ReadStates.key, ReadOutputs.key)
_KEPT = (Describe.key, ReadConfig.key)
"""Of these only changes are told."""


class BusSource:
    """A daemon, over Zenoh.

    Args:
        title: Name of the bus.
        connect: Opens a session; raises EcatError.
        allow: The most that pages may do; a user of the daemon may have fewer rights.
        user: Whose session it is; empty if the way to the daemon knows no users.
    """

    kind = "bus"

    def __init__(
        self,
        title: str,
        connect: Callable[[], Remote],
        allow: tuple[str, ...],
        user: str = "",
    ) -> None:
        self.title = title
        self.may = () if user else allow  # of a user, until the daemon has said more
        self.user = user
        self.buses: tuple[str, ...] = ()
        self._allow = allow
        self._connect = connect
        self._remote: Remote | None = None
        self._why_not: EcatError = UnreachableError("not connected to the daemon yet")
        self._asking = asyncio.Semaphore(_ASKS_MAX)
        self._lamps = Lamps()
        self._answers: dict[str, Mapping[str, Any]] = {}
        self._traces: Traces | None = None
        self._events: deque[Mapping[str, Any]] = deque(maxlen=_EVENTS_MAX)

    async def run(self, hub: Hub) -> None:
        """See `Source`."""
        self._traces = Traces(hub)
        try:
            while True:
                try:
                    self._remote = await in_daemon_thread(self._connect)
                    await self._follow(self._remote, hub)
                except EcatError as error:
                    self._why_not = error
                    hub.link(False, str(error))
                finally:
                    self._leave()
                await asyncio.sleep(_RETRY_S)
        finally:
            self._traces = None

    def _leave(self) -> None:
        self._answers.clear()
        if self._traces is not None:
            self._traces.use(None)
        remote, self._remote = self._remote, None
        if remote is not None:
            # Closing waits for requests; nobody waits for it.
            task = asyncio.ensure_future(in_daemon_thread(remote.close))
            task.add_done_callback(lambda done: done.cancelled() or done.exception())

    async def _follow(self, remote: Remote, hub: Hub) -> None:
        """Watches until the way to the daemon breaks, or it has started again.

        Raises:
            EcatError: Why it does not go on.
        """
        events = await in_daemon_thread(lambda: remote.request(ReadEvents()))
        await self._describe(hub, await in_daemon_thread(lambda: remote.request(Describe())))
        await self._introduce(remote, hub)
        hub.forget_events()
        hub.link(True, f"connected to bus '{remote.full_name}'")
        hub.events(events["events"], events["left_out"])
        self._events = deque(events["events"], _EVENTS_MAX)
        self._lamps = Lamps()
        assert self._traces is not None, "it runs"
        self._traces.use(remote)
        tasks = [
            asyncio.create_task(self._watch(remote, hub, operation, period))
            for operation, period in _WATCHED
        ]
        tasks.append(asyncio.create_task(self._watch_buses(remote, hub)))
        try:
            instance = events["instance"]
            while True:
                await asyncio.sleep(_EVENTS_S)
                since = events["next"]
                events = await in_daemon_thread(lambda: remote.request(ReadEvents(since)))  # noqa: B023
                if events["instance"] != instance:
                    raise UnreachableError(f"the daemon of bus '{remote.bus}' has started again")
                for task in tasks:
                    if task.done():
                        task.result()  # a defect must not be silent
                hub.events(events["events"], events["left_out"])
                self._events.extend(events["events"])
        finally:
            for task in tasks:
                task.cancel()

    async def _introduce(self, remote: Remote, hub: Hub) -> None:
        """Finds out what the user may; raises EcatError if the daemon does not know the user."""
        self.user = remote.user
        self.may = self._allow
        if remote.user:
            may = (await in_daemon_thread(remote.rights))["write"]
            self.may = tuple(right for right in self._allow if right in may)
        hub.rights()

    async def _watch_buses(self, remote: Remote, hub: Hub) -> None:
        while True:
            with suppress(EcatError):
                found = await in_daemon_thread(remote.neighbours)
                buses = tuple(found) if len(found) > 1 else ()
                if buses != self.buses:
                    self.buses = buses
                    hub.rights()
            await asyncio.sleep(_BUSES_S)

    async def _watch(
        self, remote: Remote, hub: Hub, operation: Operation[Any], period: float
    ) -> None:
        key = type(operation).key
        while True:
            begin = time.monotonic()
            try:
                answer = await in_daemon_thread(lambda: remote.request(operation))
            except EcatError as error:
                self._answers.pop(key, None)
                hub.value(key, error)
            else:
                if key not in _KEPT or answer != self._answers.get(key):
                    self._answers[key] = answer
                    if key == Describe.key:
                        await self._describe(hub, answer)
                    else:
                        hub.value(key, answer)
                    if key == ReadStats.key:
                        hub.value(WORST, describe_worst(answer, self._events, time.time()))
            if key in _LAMPS[:2]:
                found = [self._answers.get(name) for name in _LAMPS]
                now = time.time()
                hub.lamps(self._lamps.look(found[0], found[1], found[2], now), now)
            await asyncio.sleep(max(0.05, begin + period - time.monotonic()))

    async def _describe(self, hub: Hub, answer: Mapping[str, Any]) -> None:
        self._answers[Describe.key] = answer
        # Pages have the entries as signals. Twice they are some megabytes on a large bus.
        slaves = [
            {key: value for key, value in slave.items() if key not in ("outputs", "inputs")}
            for slave in answer["slaves"]
        ]
        hub.value(Describe.key, {**answer, "slaves": slaves})
        # A bus with thousands of entries takes a while.
        found = await in_daemon_thread(
            lambda: describe_signals(read_bus(answer, "the answer of the daemon", strict=False))
        )
        hub.describe(found)

    async def ask(
        self, key: str, parameters: Mapping[str, Any], payload: Mapping[str, Any]
    ) -> Mapping[str, Any]:
        """See `Source`."""
        operation = to_operation(key, parameters, payload, self._allow)
        async with self._asking:
            remote = self._remote
            if remote is None:
                raise self._why_not
            answer: Mapping[str, Any] = await in_daemon_thread(lambda: remote.request(operation))
            return answer

    def wish(self, page: Page) -> None:
        """See `Source`."""
        if self._traces is not None:
            self._traces.wish()

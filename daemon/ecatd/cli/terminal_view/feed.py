"""Asks a daemon again and again, in threads, so that a slow answer never stops the screen."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from ecatd.base.errors import EcatError, UsageError
from ecatd.base.paths import search_dirs, served_buses
from ecatd.client.remote import Remote
from ecatd.description.bus import Bus
from ecatd.operations.bus import ReadEvents, ReadStates
from ecatd.operations.operation import Operation
from ecatd.operations.outputs import ReadOutputs
from ecatd.operations.statistics import ReadStats

if TYPE_CHECKING:
    from ecatd.operations.streams import StreamSignal

_PERIOD_S = 1.0
"""Seconds between two looks at the daemon."""
_RETRY_S = 2.0
"""Seconds until a daemon that is away is asked again."""
_RATE = 10.0
"""Rows of signals a second."""
_PATIENCE_S = 3.0
"""Seconds for an answer about what is watched; what the user asks for may take longer."""


@dataclass(frozen=True, slots=True)
class Look:
    """What the daemon has answered at one time."""

    bus: Bus  #: The bus description.
    statistics: Any  #: `Statistics`, or None.
    states: Any  #: `States`, or None.
    outputs: Any  #: `Outputs`, or None.
    events: list[Any]  #: New events, the oldest first.
    begins: bool  #: Whether events and signals of before are of another start, or another bus.
    at: float = field(default_factory=time.time)  #: Unix time in s.


@dataclass(frozen=True, slots=True)
class Lost:
    """Why no answer comes: a sentence."""

    text: str


@dataclass(frozen=True, slots=True)
class Opened:
    """A stream of signals begins, or why there is none."""

    signals: Sequence[StreamSignal]
    why_not: str = ""


@dataclass(frozen=True, slots=True)
class Row:
    """For each signal its minimum, mean, maximum, and the cycles in which it was valid."""

    values: list[list[float | None]]


Told = Look | Lost | Opened | Row


class Feed:
    """Watches one bus until it is closed.

    Args:
        bus: Its name.
        connect: Zenoh endpoint, or None for this machine.
        timeout: Seconds to wait for an answer to what the user asks for.
        tell: Gets what the daemon says, in a thread of the feed.
    """

    def __init__(
        self, bus: str, connect: str | None, timeout: float, tell: Callable[[Told], object]
    ) -> None:
        self.bus = bus
        self._connect = connect
        self._timeout = timeout
        self._tell = tell
        self._ended = threading.Event()
        self._asking: Remote | None = None
        self._lock = threading.Lock()
        self._pattern = "*"
        self._is_other_pattern = threading.Event()
        for work in (self._watch, self._stream):
            threading.Thread(target=self._keep, args=(work,), daemon=True).start()

    def close(self) -> None:
        """Ends it; does not wait for answers that are still to come."""
        self._ended.set()
        if self._asking is not None:
            threading.Thread(target=self._asking.close, daemon=True).start()

    def choose(self, text: str) -> None:
        """Chooses the signals whose names contain a text."""
        pattern = f"*{text}*" if text else "*"
        if pattern != self._pattern:
            self._pattern = pattern
            self._is_other_pattern.set()

    def open(self, timeout: float | None = None) -> Remote:
        """Opens a session."""
        return Remote(self.bus, self._connect, timeout or self._timeout)

    def asking(self) -> Remote:
        """The session for requests of the user, in any thread.

        Raises:
            EcatError: It cannot be opened.
        """
        with self._lock:
            if self._asking is not None and not self._asking.is_connected:
                self._asking.close()
                self._asking = None
            if self._asking is None:
                self._asking = self.open()
            return self._asking

    def buses(self) -> list[str]:
        """The buses in reach: of this machine, or behind the endpoint."""
        if self._connect is None:
            return sorted({bus for folder in search_dirs() for bus in served_buses(folder)})
        with self.open(_PATIENCE_S) as remote:
            return remote.alive()

    def _say(self, told: Told) -> None:
        if not self._ended.is_set():
            self._tell(told)

    def _keep(self, work: Callable[[Remote], None]) -> None:
        """Works with one session after the other."""
        said = ""
        while not self._ended.is_set():
            try:
                with self.open(min(self._timeout, _PATIENCE_S)) as remote:
                    work(remote)
                said = ""
            except EcatError as error:
                text = str(error)
            except Exception as error:
                text = f"the answer makes no sense ({error!r:.80})"
            else:
                continue
            if work == self._watch or text != said:
                said = text
                self._say(Lost(text) if work == self._watch else Opened((), text))
            self._ended.wait(_RETRY_S)

    def _watch(self, remote: Remote) -> None:
        bus, instance, following = remote.describe(), None, 0
        begins = True
        while not self._ended.is_set():
            due = time.monotonic() + _PERIOD_S
            answer = remote.request(ReadEvents(following))
            if instance is not None and answer["instance"] != instance:
                bus, begins = remote.describe(), True
                answer = remote.request(ReadEvents())
            instance, following = answer["instance"], answer["next"]
            parts: list[Any] = []
            asked: tuple[Operation[Any], ...] = (
                ReadStats(buckets=True),
                ReadStates(),
                ReadOutputs(names=True),
            )
            for operation in asked:
                try:
                    parts.append(remote.request(operation))
                except EcatError:  # a bus server that is busy; lamps say so
                    parts.append(None)
            if parts[0] is None and parts[1] is None:
                remote.request(ReadStates())
            statistics, states, outputs = parts
            events = list(answer["events"])
            self._say(Look(bus, statistics, states, outputs, events, begins))
            begins = False
            self._ended.wait(max(0.0, due - time.monotonic()))

    def _stream(self, remote: Remote) -> None:
        self._is_other_pattern.clear()
        try:
            stream = remote.stream(self._pattern, _RATE)
        except UsageError as error:  # too many signals
            self._say(Opened((), f"{error}. Press / to choose some by name"))
            while not self._is_other_pattern.wait(0.2) and not self._ended.is_set():
                pass
            return
        with stream:
            self._say(Opened(stream.signals))
            for row in stream:
                self._say(Row(row["values"]))
                if self._ended.is_set() or self._is_other_pattern.is_set():
                    return

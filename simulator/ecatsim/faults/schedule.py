"""The faults of a simulation, with the schedule and the state of each."""

from __future__ import annotations

import contextlib
import heapq
import random
from dataclasses import dataclass, field

from ecatd.base.errors import EcatError, StateError, UsageError

from .fault import Fault, SlaveFault
from .frames import FrameFault
from .methods import FaultMethods
from .target import Target

MAX_FAULTS = 256
_FINISHED_KEPT = 64


@dataclass(frozen=True, slots=True)
class FaultState:
    """A fault and its state.

    Attributes:
        id: Number of the fault.
        fault: The fault.
        struck: How often it has struck.
        last_cycle: The scheduled cycle of its last strike; 0 if it has not struck, or if the slave
            controllers carry it out.
        done: Whether it will not strike again.
        error: Why its last strike failed, or empty.
    """

    id: int
    fault: Fault
    struck: int
    last_cycle: int
    done: bool
    error: str


@dataclass(slots=True)
class _Entry:
    id: int
    fault: Fault
    struck: int = 0
    last_cycle: int = 0
    done: bool = False
    error: str = ""
    on_segment: int | None = None
    random: random.Random = field(default_factory=random.Random)


class Faults(FaultMethods):
    """The faults of a simulation.

    Each fault has a method that adds it and returns its number: `faults.drop(count=3,
    at_cycle=1000)`, `faults.al_error(2, code=0x001D)`. All methods are thread-safe while the
    simulation runs, except `run`.

    Args:
        target: The simulation in which they strike.
    """

    def __init__(self, target: Target) -> None:
        self._target = target
        self._entries: dict[int, _Entry] = {}
        self._due: list[tuple[int, int]] = []  # a heap of cycle and number
        self._last_id = 0

    def add(self, fault: Fault) -> int:
        """Adds a fault and returns its number; a fault without a cycle strikes at once.

        Raises:
            UsageError: The simulation has no such slave, or the cycle of the fault is over.
            StateError: There are too many faults.
        """
        with self._target.lock:
            now = self._cycle()
            self._check(fault, now)
            self._forget_finished()
            self._last_id += 1
            entry = _Entry(self._last_id, fault, random=random.Random(fault.seed))
            if isinstance(fault, SlaveFault):
                if fault.at_cycle == 0:
                    self._strike(entry, now, at_once=True)
                if not entry.done:
                    first = fault.at_cycle or now + fault.every
                    heapq.heappush(self._due, (first, entry.id))
            elif isinstance(fault, FrameFault):
                entry.on_segment = self._target.segment.inject(fault.on_segment(now))
            self._entries[entry.id] = entry
            return entry.id

    def clear(self, identifier: int | None = None) -> int:
        """Removes one fault, or all, so that they no longer strike; returns how many there were.

        Effects of earlier strikes stay: a broken link needs `heal_link`, a slave without power
        `power_on`.

        Raises:
            UsageError: There is no such fault.
        """
        with self._target.lock:
            if identifier is not None and identifier not in self._entries:
                raise UsageError(f"there is no fault {identifier}; `faults` lists them")
            gone = list(self._entries) if identifier is None else [identifier]
            for key in gone:
                self._withdraw(self._entries.pop(key))
            self._due = [item for item in self._due if item[1] in self._entries]
            heapq.heapify(self._due)
            return len(gone)

    def list(self) -> list[FaultState]:
        """Returns all faults that may strike, and the last finished ones, oldest first."""
        with self._target.lock:
            self._look_at_segment()
            return [
                FaultState(e.id, e.fault, e.struck, e.last_cycle, e.done, e.error)
                for e in self._entries.values()
            ]

    def run(self) -> None:
        """Carries out the faults that are due; the simulation calls it at every step."""
        if not self._due:
            return
        now = self._cycle()
        while self._due and self._due[0][0] <= now:
            cycle, identifier = heapq.heappop(self._due)
            entry = self._entries.get(identifier)
            if entry is None:
                continue
            self._strike(entry, cycle)
            if not entry.done:
                heapq.heappush(self._due, (cycle + entry.fault.every, identifier))

    def _withdraw(self, entry: _Entry) -> None:
        if entry.on_segment is not None:
            with contextlib.suppress(UsageError):  # finished, and forgotten by the segment
                self._target.segment.clear(entry.on_segment)

    def _look_at_segment(self) -> None:
        """Updates the counts of frame faults from the segment."""
        known = {state.id: state for state in self._target.segment.faults()}
        for entry in self._entries.values():
            if entry.on_segment is not None:
                # The segment removes only faults that have struck `count` times.
                state = known.get(entry.on_segment)
                entry.struck = entry.fault.count if state is None else state.struck
                entry.done = 0 < entry.fault.count <= entry.struck

    def _cycle(self) -> int:
        return self._target.segment.counters().cycles

    def _check(self, fault: Fault, now: int) -> None:
        if 0 < fault.at_cycle < now:
            raise UsageError(
                f"{fault.kind}: cycle {fault.at_cycle} is over, the bus is in cycle {now}; "
                "leave at_cycle out to strike at once"
            )
        fault.check_slave(len(self._target.devices))
        if isinstance(fault, SlaveFault):
            fault.check(self._target)

    def _strike(self, entry: _Entry, cycle: int, *, at_once: bool = False) -> None:
        """Strikes once. A strike `at_once` raises its error; any other one stores it."""
        fault = entry.fault
        assert isinstance(fault, SlaveFault)
        if fault.probability < 1.0 and entry.random.random() >= fault.probability:
            return
        try:
            fault.strike(self._target)
        except EcatError as error:
            if at_once:
                raise
            entry.error = str(error)
        else:
            entry.struck += 1
            entry.last_cycle = cycle
        entry.done = bool(entry.error) or 0 < fault.count <= entry.struck

    def _forget_finished(self) -> None:
        self._look_at_segment()
        finished = [entry.id for entry in self._entries.values() if entry.done]
        for identifier in finished[: max(0, len(finished) - _FINISHED_KEPT)]:
            self._withdraw(self._entries.pop(identifier))
        if len(self._entries) >= MAX_FAULTS:
            raise StateError(
                f"there are {len(self._entries)} faults already, and no more are kept: "
                "clear some that are no longer needed"
            )

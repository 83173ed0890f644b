"""Reports who owns outputs, why outputs are safe, and which client misbehaves.

Name and process number of a client come from its slot, which the client writes itself: they are
reported, but not trusted. Another process may also have written into a slot. So messages name all
processes that could have done it. Whether the process of a client lives is known from the lock of
its slot, which the kernel keeps. How that process is comes from /proc, for the number that the
client says; where this process may see it, the file of the slots has to be open there.
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from typing import Any

from ecatd.base.batch import Batch
from ecatd.base.file_locks import held
from ecatd.base.namespaces import is_ours, said_pid
from ecatd.description.bus import Slave, positions_text
from ecatd.etg.pdo import Entry
from ecatd.linux.process_state import WORDS, has_open, look_at_process
from ecatd.master.engine.engine import Event, EventType
from ecatd.shm import contract as shm
from ecatd.shm.contents import hand_of

from ..start.running_bus import RunningBus
from .reports import Reporter
from .shared_memory_files import Program, names, programs_with

_REPORTED = 4
"""Most events about one client in one report; earlier ones are only counted."""

_FRESH = 0.25
"""Seconds for which the list of programs that have the file open is reused; it is slow to make."""
_WRONG = (EventType.REFUSED, EventType.MALFORMED)

_REASONS = {
    shm.Reason.RELEASED: "{} released them",
    shm.Reason.DIED: "the process of {} has ended without a release",
    shm.Reason.LAPSED: "{} gave no sign of life",
    shm.Reason.GONE: "{} lost its slot: another client took it, or a program has overwritten it",
    shm.Reason.STOPPING: "the daemon stops; {} owned them",
    shm.Reason.WKC: (
        "one of the domains of {} had too many wrong working counters in a row, so it lost all its "
        "outputs"
    ),
}
_EXPECTED = (shm.Reason.RELEASED, shm.Reason.STOPPING)
_OF_LEASES = (shm.Reason.DIED, shm.Reason.LAPSED)


@dataclass(frozen=True, slots=True)
class _Client:
    """Who is in a slot, as it says itself."""

    slot: int
    program: str = ""
    pid: int = 0
    namespace: int = 0
    since_ns: int = 0

    def __str__(self) -> str:
        if not self.pid:
            return f"the client in slot {self.slot}"
        return f"'{self.program}' ({said_pid(self.pid, self.namespace)})"


@dataclass(frozen=True, slots=True)
class _Lapse:
    """What is known of a client that has lost its lease, at that moment.

    Attributes:
        lease_ms: Its lease.
        silent_ms: How long it had given no sign of life.
        process: How its process is, a key of `WORDS`; empty if that is not known.
        text: The same in words, behind who the client is.
    """

    lease_ms: float
    silent_ms: float
    process: str
    text: str


class OutputWatch:
    """Reports about outputs and their owners; for the thread of the event loop.

    Args:
        running: The bus.
        report: Reports these things.
    """

    def __init__(self, running: RunningBus, report: Reporter) -> None:
        self._bus = running.bus
        self._shared = running.shared
        # How long drives may take to stop.
        self._patience = {rule.slave: rule.stop_timeout for rule in running.config.outputs.safe}
        self._report = report
        self._clients: dict[int, _Client] = {}
        self._owners: dict[int, str] = {}  # of outputs, by signal, at the last conflict
        self._lapses: dict[int, tuple[int, _Lapse | None]] = {}  # cycle and lapse, by slot
        self._gathered: dict[tuple[int, int, bool], Batch[tuple[Event, _Client]]] = {}
        self._writers: list[Program] = []
        self._looked = 0.0

    def handle(self, event: Event) -> None:
        """Takes an event of the engine about a client, or about the drive of a slave."""
        if event.type in (EventType.CLAIMED, EventType.MALFORMED):
            self._look_at(event.slot, event.value)
        elif event.type == EventType.CONFLICT:  # the client may never have owned anything
            self._look_at(event.slot)
            self._owners[event.value] = self._owner(event.value)
        elif event.type == EventType.SAFE and event.value in _OF_LEASES:
            self._look_at_lapse(event)
        # A client may try again in each cycle: that must not push out what happens to its outputs.
        about = (event.slot, event.slave if event.slot < 0 else -1, _is_minor(event))
        if about not in self._gathered:
            self._gathered[about] = Batch(partial(self._report_all, event.slot))
        client = self._clients.get(event.slot, _Client(event.slot))
        self._gathered[about].note((event, client))

    def client(self, slot: int) -> _Client:
        """Who is in a slot now, or was there last."""
        self._look_at(slot)
        return self._clients.get(slot, _Client(slot))

    def close(self) -> None:
        """Reports the events that are still waiting."""
        for item in self._gathered.values():
            item.close()

    def _look_at(self, slot: int, generation: int | None = None) -> None:
        """Remembers the client in a slot, so that it can be named after it has left.

        Args:
            slot: The slot.
            generation: Generation of the client; None: whoever is there now.
        """
        out, kind = self._shared.out, shm.struct("ecat_out_slot")
        at = out.slots_offset + slot * out.slot_stride
        data = os.pread(self._shared.out_fd, shm.size(kind.__name__), at)
        if len(data) < shm.size(kind.__name__):
            return
        found = kind.from_buffer_copy(data)
        if generation in (None, found.generation):
            program = shm.printable(found.program)
            self._clients[slot] = _Client(
                slot, program, found.pid, found.pid_namespace, found.since_ns
            )

    def _look_at_lapse(self, event: Event) -> None:
        if self._lapses.get(event.slot, (0, None))[0] != event.cycle:  # each slave has an event
            self._lapses[event.slot] = event.cycle, self._lapse(event)

    def _lapse(self, event: Event) -> _Lapse | None:
        """What is known of a lapse; None if there has been a sign of life since."""
        status, head = self._shared.slot_status[event.slot], self._shared.header
        ended_ns = head.cycle_end_ns - (head.cycle - event.cycle) * head.cycle_time_ns
        silent_ns, lease_ns = ended_ns - status.beat_ns, status.lease_ns
        if silent_ns < 0:
            return None
        process, how = self._process(self._clients.get(event.slot, _Client(event.slot)))
        if event.value == shm.Reason.LAPSED:
            silent_ns = max(silent_ns, lease_ns)  # the end of the cycle is known, not the lapse
            text = f" for {silent_ns / 1e6:.0f} ms, and its lease was {lease_ns / 1e6:g} ms{how}"
        else:
            text = (
                f", {silent_ns / 1e6:.0f} ms after its last sign of life; its lease was "
                f"{lease_ns / 1e6:g} ms"
            )
            process = "ended"
        return _Lapse(lease_ns / 1e6, round(silent_ns / 1e6, 3), process, text)

    def _process(self, client: _Client) -> tuple[str, str]:
        """How the process of a client is: a key of `WORDS`, and words behind a lapse."""
        if not held(self._shared.out_fd, shm.LOCK_SLOT + client.slot):
            return "ended", f"; its process {WORDS['ended']}"
        if not client.pid or hand_of(client.program) is not None:
            return "", ""
        found = None
        if is_ours(client.namespace):
            found = look_at_process(client.pid, client.since_ns)
        if found is None:
            return "", "; its process lives"
        if has_open(client.pid, self._shared.out_fd) is False:
            return "", f"; its process lives, but it is not {client.pid} ({found.name})"
        return found.state, f"; process {client.pid} ({found.name}) {WORDS[found.state]}"

    def _report_all(self, slot: int, events: list[tuple[Event, _Client]], left_out: int) -> None:
        groups = [
            ([event for event, _ in group], client)
            for (_, _, client), group in groupby(events, lambda e: (e[0].type, e[0].value, e[1]))
        ]
        if any(group[0].type in _WRONG for group, _ in groups[-_REPORTED:]):
            self._find_writers()
        left_out += sum(len(group) for group, _ in groups[:-_REPORTED])
        if left_out:
            say = self._report.log.debug if _is_minor(events[-1][0]) else self._report.log.warning
            say(
                f"{left_out} events about outputs of the client in slot {slot} were not reported, "
                "because they come too often"
            )
        for group, client in groups[-_REPORTED:]:
            self._say(group, client)
            alike: dict[int, list[Event]] = {}
            for event in group:
                alike.setdefault(event.slave, []).append(event)
            for events_of_slave in alike.values():
                self._publish(events_of_slave, client)

    def _find_writers(self) -> None:
        if time.monotonic() - self._looked > _FRESH:
            self._writers = programs_with(self._shared.out_fd, writing=True)
            self._looked = time.monotonic()

    def _others(self, owner: _Client) -> str:
        """Which programs can have written into a slot; empty if only its owner can."""
        if all(program.calls_itself(owner.pid, owner.namespace) for program in self._writers):
            return ""
        return f"{self._shared.out_path} is open for writing in {names(self._writers)}"

    def _publish(self, alike: list[Event], client: _Client) -> None:
        """Publishes one event about the same thing that has happened to the same slave."""
        event = alike[-1]
        positions = {event.slave} - {-1}
        facts: dict[str, Any] = {"cycle": event.cycle, "text": self._text(event, client, positions)}
        if len(alike) > 1:
            facts["times"] = len(alike)
        if event.slot >= 0:
            facts |= {"slot": event.slot, "program": client.program, "pid": client.pid}
        if event.slave >= 0:
            facts["slave"] = event.slave
        if event.type in _WRONG:
            facts["programs"] = [*map(str, self._writers)]
        if event.type == EventType.SAFE:
            facts["reason"] = shm.Reason(event.value).name.lower()
            if lapse := self._lapse_of(event):
                facts |= {"lease_ms": lapse.lease_ms, "silent_ms": lapse.silent_ms}
                facts |= {"process": lapse.process} if lapse.process else {}
        elif event.type in (EventType.REFUSED, EventType.CONFLICT):
            facts["entry"] = self._entry(event.value).address
        if event.type == EventType.CONFLICT:
            facts["owner"] = self._owners[event.value]
        if event.type == EventType.STOPPED:
            facts["in_time"] = bool(event.value)
        kind = EventType(event.type).name.lower()
        self._report.publish(kind, severity="info" if _is_wanted(event) else "", **facts)

    def _say(self, group: list[Event], who: _Client) -> None:
        """Logs one line about consecutive events of one kind."""
        first = group[0]
        positions = {event.slave for event in group if event.slave >= 0}
        level = "debug" if _is_minor(first) else ""
        text = self._text(first, who, positions)
        kind = EventType(first.type).name.lower()
        self._report.write(kind, text, positions, good=_is_wanted(first), level=level)

    def _lapse_of(self, event: Event) -> _Lapse | None:
        cycle, lapse = self._lapses.get(event.slot, (0, None))
        return lapse if event.value in _OF_LEASES and cycle == event.cycle else None

    def _text(self, first: Event, who: _Client, positions: set[int]) -> str:
        """What has happened to slaves: the line of the log, and the text of the event."""
        slaves, others = self._slaves(positions), ""
        if first.type in _WRONG:
            others = self._others(who)
        match first.type:
            case EventType.CLAIMED:
                return f"{who} owns outputs of {slaves}"
            case EventType.SAFE:
                because = _REASONS[shm.Reason(first.value)].format(who)
                lapse = self._lapse_of(first)
                return f"outputs of {slaves} are safe: {because}{lapse.text if lapse else ''}"
            case EventType.CONFLICT:
                entry = self._entry(first.value).address
                owner = self._owners[first.value]
                return f"{who} is refused outputs of {slaves}: {owner} owns {entry}"
            case EventType.REFUSED:
                by = f"slot {first.slot}, of {who}, got" if others else f"{who} wrote"
                return f"{by} {self._refused(first)}" + (others and f"; {others}")
            case EventType.MALFORMED:
                return (
                    f"slot {first.slot}{others and f', of {who},'} contains data that no client "
                    f"library writes; ecatd ignores it: "
                    + (f"{others}: check what they do" if others else f"check what {who} does")
                )
            case EventType.STOPPED if first.value:
                return f"{slaves}: the drive has stopped"
        return (
            f"{slaves}: the drive has not stopped in {self._patience.get(first.slave, 0):g} s; "
            "its controlword was set to 0"
        )

    def _owner(self, signal: int) -> str:
        """What an output belongs to now, so that a client cannot have it."""
        row = self._shared.outputs[signal]
        if row.state == shm.Outputs.COPIED:
            return "a [[copy]] of the configuration"
        if row.state == shm.Outputs.CAN:
            return "ecatd, which exchanges CAN frames,"
        if row.owner < 0:  # it has been released meanwhile
            return "another client"
        return str(self._clients.get(row.owner, _Client(row.owner)))

    def _slaves(self, positions: set[int]) -> str:
        if len(positions) == 1:
            return self._bus.slaves[next(iter(positions))].label
        return f"slaves {positions_text(positions)}"

    def _entry(self, signal: int) -> Entry:
        row = self._shared.signals[signal]
        slave: Slave = self._bus.slaves[row.slave]
        return next(
            entry
            for _pdo, entry, _bit in slave.entries(outputs=True)
            if (entry.index, entry.subindex) == (row.index, row.subindex)
        )

    def _refused(self, event: Event) -> str:
        entry = self._entry(event.value)
        low = "any" if entry.minimum is None else f"{entry.minimum:g}"
        high = "any" if entry.maximum is None else f"{entry.maximum:g}"
        slave = self._bus.slaves[event.slave].label
        return (
            f"{entry.address} ({entry.name or 'no name'}) of {slave} out of its declared range, "
            f"{low} to {high} {entry.unit}".rstrip()
            + "; the output keeps the value before"
        )


def _is_wanted(event: Event) -> bool:
    """Whether somebody wanted it to happen."""
    return (
        event.type == EventType.CLAIMED
        or (event.type == EventType.SAFE and shm.Reason(event.value) in _EXPECTED)
        or (event.type == EventType.STOPPED and bool(event.value))
    )


def _is_minor(event: Event) -> bool:
    """Whether the client knows it already, so that the log has it as a detail only."""
    return event.type == EventType.CONFLICT

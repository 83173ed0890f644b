"""Watches what lies between engine and slaves: links, ring, lost frames, other masters."""

from __future__ import annotations

import asyncio
import os
import time
from contextlib import suppress
from dataclasses import asdict, replace
from typing import Any

from ecatd.base.errors import EcatError
from ecatd.description.bus import Bus
from ecatd.master.engine.engine import Event, Index, open_socket
from ecatd.master.frames.interface import switch_on
from ecatd.operations.faults import UNSENT, Fault
from ecatd.shm import contract as shm

from ..start.running_bus import RunningBus
from .foreign_masters import ForeignWatch, Write, describe, sentence
from .interface_states import LinkState, LinkWatch, StateWatch
from .reports import Disturbance, Reporter, Rise, Throttle

_PERIOD = 1.0
_FOREIGN_GONE = 3.0
"""Seconds without a frame of another master after which it is taken to be gone."""
_FOREIGN_REPORTED = 10.0
"""Seconds after the last frame of another master for which the bus is not well."""
_SETTLED = 0.1
"""Seconds to wait before a change is reported: an interface that is removed goes down first."""

_COUNTERS = {item.name: item for item in shm.COUNTERS if item.severity == "warning"}
"""Those that stand still on a healthy bus."""
_AMOUNTS = {
    "wkc_bad": "{unit} with a wrong working counter",
    "mailbox_lost": "lost mailbox {unit}",
}
"""What is counted, where it is not the name of the counter and its unit, such as `lost frames`."""


def _amount(counter: shm.Counter, count: int) -> str:
    """How much a counter has grown, such as `1 lost frame`, `2 missed cycles`."""
    unit = counter.unit.removesuffix("s") if count == 1 else counter.unit
    return f"{count} {_AMOUNTS.get(counter.name, f'{counter.label} {{unit}}').format(unit=unit)}"


_LINKS = {
    shm.Link.UP: "the link is up",
    shm.Link.NO_CARRIER: "no carrier: check the cable, and the power of {slave}",
    shm.Link.DOWN: "was switched off: switch it on with `ip link set {interface} up`",
    shm.Link.GONE: "is gone: ecatd waits for an interface of this name",
}


class InterfaceWatch:
    """The watch over the interfaces of one bus, and over what arrives at them.

    Args:
        running: The bus.
        report: Reports changes.

    Raises:
        EcatError: The interfaces cannot be watched.
    """

    def __init__(self, running: RunningBus, report: Reporter) -> None:
        self._bus = running.bus
        self._engine = running.engine
        self._master = running.master
        self._interfaces = running.master.interfaces
        self._health = running.shared.health
        self._report = report
        self._sending = [Throttle(self._report_sending, _PERIOD) for _ in self._interfaces]
        self._link_changes = [Throttle(self._report_link, _PERIOD) for _ in self._interfaces]
        self._ring: Event | None = None
        self._ring_since = 0.0  # Unix time since which it is open
        self._unreported_break: Event | None = None
        self._ring_reported: tuple[shm.Ring, int | None] | None = None
        self._ring_timer: asyncio.TimerHandle | None = None
        self._states = StateWatch(self._interfaces, report)
        self._links = LinkWatch(self._interfaces, self._on_link, self._states.note)
        self._link_since = [0.0] * len(self._interfaces)
        self._send_errors = [0] * len(self._interfaces)
        self._send_since = [0.0] * len(self._interfaces)
        self._indices = [state.index for state in self._links.states]  # that sockets belong to
        self._publish_links()
        self._foreign = ForeignWatch(self._interfaces, running.master.run)
        self._foreign_frames = [0 for _ in self._interfaces]
        self._foreign_at = -_FOREIGN_GONE  # when frames of another master were last seen
        self._foreign_since = [0.0] * len(self._interfaces)  # Unix time; 0: there is none
        self._foreign_seen = [-_FOREIGN_REPORTED] * len(self._interfaces)
        self._foreign_masters = [Disturbance({"frames": 0}) for _ in self._interfaces]
        self._sources = [""] * len(self._interfaces)
        self._writes: list[set[Write]] = [set() for _ in self._interfaces]  # not reported yet
        self._disturbance = Disturbance(self._read_counters())

    def _read_counters(self) -> dict[str, int]:
        return {name: int(getattr(self._health, name)) for name in _COUNTERS}

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Starts reporting changes of the links."""
        self._links.start(loop)

    def close(self) -> None:
        """Ends the watch; on the event loop's thread."""
        for item in (*self._sending, *self._link_changes):
            item.close()
        if self._ring_timer is not None:
            self._ring_timer.cancel()
        self._links.close()
        self._foreign.close()

    def describe(self) -> dict[str, Any]:
        """Returns names and states of the links; the rest is in shared memory."""
        return {
            "links": {
                name: state.link.name.lower()
                for name, state in zip(self._interfaces, self._links.states, strict=True)
            }
        }

    async def find_blinding(self) -> str:
        """Why no frame can come back, as the interfaces know it; empty if they do not."""
        await self._states.look()
        return "; ".join(fault.text for fault in self.faults if fault.blinds)

    async def settle(self) -> None:
        """Waits until the kernel has told of a change that stops frames at once."""
        await asyncio.sleep(_SETTLED)
        self._states.note()

    def _dead_text(self) -> str:
        """The interfaces that have no link."""
        return "; ".join(
            self._link_text(number, state.link)
            for number, state in enumerate(self._links.states)
            if state.link != shm.Link.UP
        )

    @property
    def faults(self) -> list[Fault]:
        """What is wrong with the interfaces now, what explains most first."""
        found = []
        dead = [state.link != shm.Link.UP for state in self._links.states]
        for number, name in enumerate(self._interfaces):
            if dead[number]:
                text = self._link_text(number, self._links.states[number].link)
                since = self._link_since[number]
                found.append(Fault("link", text, since, interface=name, blinds=all(dead)))
        # If no slave answers, the fault of the interface explains it, and not one of the slaves.
        silent = not self._health.slaves_found
        found += [replace(fault, blinds=silent) for fault in self._states.faults]
        for number, name in enumerate(self._interfaces):
            # An interface that is dead takes no frames, and an MTU is told with its remedy.
            if self._send_errors[number] and not dead[number] and not self._states.explain("mtu"):
                text = f"frames cannot be sent on {name}: {os.strerror(self._send_errors[number])}"
                since = self._send_since[number]
                found.append(Fault("sending", text, since, interface=name, blinds=silent))
            if self._foreign_since[number]:
                text = (
                    f"another EtherCAT master sends frames on {name} (source "
                    f"{self._sources[number]}): stop it, or give it slaves of its own"
                )
                since = self._foreign_since[number]
                found.append(Fault("foreign_master", text, since, interface=name))
        if self._health.ring == shm.Ring.OPEN and not all(dead):
            before = int(self._health.ring_break)
            text = describe_ring(self._bus, self._interfaces, shm.Ring.OPEN, before)
            found.append(Fault("ring", text, self._ring_since))
        return found

    async def explain(self, kind: str) -> str:
        """Why frames are not sent or get lost, as far as the interfaces know; else empty."""
        await self._states.look()
        if dead := self._dead_text():
            return dead
        if kind == UNSENT:
            errors = "; ".join(
                f"{name}: {os.strerror(error)}"
                for name, error in zip(self._interfaces, self._send_errors, strict=True)
                if error
            )
            return errors + ", because of its MTU" * bool(self._states.explain("mtu"))
        return self._states.explain()

    def is_foreign(self) -> bool:
        """Whether another master is at work now."""
        for number in range(len(self._interfaces)):
            self._look_for_others(number, time.monotonic())
        return time.monotonic() - self._foreign_at < _FOREIGN_GONE

    async def watch(self) -> None:
        """Waits for a while, and checks the counters."""
        with suppress(TimeoutError):
            await asyncio.wait_for(self._states.changed.wait(), _PERIOD)
        await self._states.look()
        await asyncio.sleep(_SETTLED)
        self.look()

    def look(self) -> None:
        """Reports counters of disturbances that run, and frames of other masters."""
        now = time.monotonic()
        if (rise := self._disturbance.look(self._read_counters(), now)) is not None:
            self._report_counters(rise)
        for number in range(len(self._interfaces)):
            self._look_for_others(number, now)

    def _report_counters(self, rise: Rise) -> None:
        text = ", ".join(
            _amount(item, rise.counts[name])
            for name, item in _COUNTERS.items()
            if name in rise.counts
        )
        text = (
            f"the exchange is undisturbed again, after {rise.seconds:.0f} s with {text}"
            if rise.over
            else f"within {rise.seconds:.0f} s: {text}"
        )
        self._report("disturbance", text, asdict(rise), good=rise.over)

    def _look_for_others(self, number: int, now: float) -> None:
        interface = self._interfaces[number]
        foreign = self._foreign.look(number)
        self._foreign_frames[number] += foreign.count
        self._health.foreign = sum(self._foreign_frames)
        self._writes[number] |= foreign.writes
        if foreign.count:
            self._foreign_at = self._foreign_seen[number] = now
            self._foreign_since[number] = self._foreign_since[number] or time.time()
        elif now - self._foreign_seen[number] > _FOREIGN_REPORTED:
            self._foreign_since[number] = 0.0
        if foreign.sources:
            self._sources[number] = "; ".join(foreign.sources)
        rise = self._foreign_masters[number].look({"frames": self._foreign_frames[number]}, now)
        if rise is None:
            return
        source, count, wrote = self._sources[number], rise.counts["frames"], self._writes[number]
        text = f"no more frames of another EtherCAT master on {interface}"
        if not rise.over:
            text = (
                f"frames of another EtherCAT master on {interface} (source {source}): {count} "
                f"within {rise.seconds:.0f} s. {sentence(wrote)}. Two masters undo each other's "
                f"outputs and states: stop the other one, or give it slaves of its own"
            )
        facts = {
            "interface": interface,
            "source": source,
            "count": count,
            "wrote": describe(wrote),
            "over": rise.over,
        }
        self._report("foreign_master", text, facts, good=rise.over)
        self._writes[number] = set()

    def on_send(self, event: Event) -> None:
        """Sending on an interface has begun to fail, or works again."""
        if not self._send_errors[event.slot]:
            self._send_since[event.slot] = time.time()
        self._send_errors[event.slot] = event.value
        self._sending[event.slot].note(event)

    def _report_sending(self, event: Event) -> None:
        interface = self._interfaces[event.slot]
        reason = os.strerror(event.value) if event.value else ""
        text = f"frames can be sent on {interface} again"
        if reason:
            text = f"frames cannot be sent on {interface}: {reason}"
        facts = {"interface": interface, "error": reason, "cycle": event.cycle}
        self._report("sending", text, facts, good=not reason)

    def on_ring(self, event: Event) -> None:
        """The ring has opened, closed, or is open at another place."""
        self._ring = event
        if event.value == shm.Ring.OPEN and not self._ring_since:
            self._ring_since = time.time()
        elif event.value == shm.Ring.CLOSED:
            self._ring_since = 0.0
        self._report.log.debug(
            f"ring: {shm.Ring(event.value).name}, {event.slave} slaves before a break"
        )
        if event.value == shm.Ring.OPEN:
            self._unreported_break = event
        if self._ring_timer is None:
            # While a cable is being unplugged, the first cycle may find the break elsewhere.
            self._ring_timer = asyncio.get_running_loop().call_later(_SETTLED, self._report_ring)

    def _report_ring(self) -> None:
        """Reports the state of the ring if it has changed; at most once a second."""
        self._ring_timer = None
        event, brief = self._ring, self._unreported_break
        self._unreported_break = None
        if event is None:
            return
        state = shm.Ring(event.value)
        text = describe_ring(self._bus, self._interfaces, state, event.slave)
        broken_at = event.slave if state == shm.Ring.OPEN else None
        if self._ring_reported == (state, broken_at) and (state == shm.Ring.OPEN or brief is None):
            return
        self._ring_reported = state, broken_at
        if state == shm.Ring.CLOSED and brief is not None:
            place = _place(self._bus, self._interfaces, brief.slave)
            text = f"the ring was broken {place} for a moment: check the plugs. Now {text}"
        facts = {
            "state": state.name.lower(),
            "slaves_before": event.slave if brief is None else brief.slave,
            "cycle": event.cycle,
        }
        self._report("ring", text, facts, good=state == shm.Ring.CLOSED and not brief)
        self._ring_timer = asyncio.get_running_loop().call_later(_PERIOD, self._report_ring)

    def _publish_links(self) -> None:
        states = self._links.states
        self._health.link_first = states[0].link
        self._health.link_second = states[1].link if len(states) > 1 else shm.Link.UNUSED

    def _on_link(self, number: int, before: LinkState, now: LinkState) -> None:
        self._link_since[number] = time.time()
        self._publish_links()
        self._report.log.debug(
            f"{self._interfaces[number]}: link {before.link.name} (index {before.index}), now "
            f"{now.link.name} (index {now.index})"
        )
        if now.index not in (0, self._indices[number]):
            self._take_new(number, now)
            if now.link == shm.Link.DOWN:
                return  # it has just been switched on, which will be reported
        if now.link == shm.Link.DOWN and before.link != shm.Link.GONE:
            # Perhaps it is about to vanish.
            asyncio.get_running_loop().call_later(_SETTLED, self._note_link, number, now)
        elif now.link != before.link:
            self._note_link(number, now)

    def _note_link(self, number: int, now: LinkState) -> None:
        if now == self._links.states[number]:
            self._link_changes[number].note(Event(slot=number, value=now.link))

    def _report_link(self, event: Event) -> None:
        """Reports a link's state; at most once a second, since a loose plug changes it often."""
        interface, link = self._interfaces[event.slot], shm.Link(event.value)
        text = self._link_text(event.slot, link)
        facts = {"interface": interface, "state": link.name.lower()}
        self._report("link", text, facts, good=link == shm.Link.UP)

    def _link_text(self, number: int, link: shm.Link) -> str:
        interface = self._interfaces[number]
        slave = self._bus.slaves[-1 if number else 0].label  # at the other end of the cable
        return f"{interface}: {_LINKS[link].format(interface=interface, slave=slave)}"

    def _take_new(self, number: int, now: LinkState) -> None:
        """Uses an interface that was removed and came back, and sets it up if it is down."""
        interface = self._interfaces[number]
        try:
            self._engine.set_socket(number, open_socket(interface, Index.ENGINE, Index.LAST))
            self._master.reopen(number)
            self._foreign.reopen(number)
            if now.link == shm.Link.DOWN:
                switch_on(interface)
        except EcatError as error:
            # It may be gone again already. That will be reported, and so will its return.
            self._report.write("link", f"{interface} is back, but cannot be used: {error}")
            return
        self._indices[number] = now.index
        text = f"{interface} is back as another interface (index {now.index})"
        self._report.write("link", text, good=True)


def describe_ring(bus: Bus, interfaces: list[str], state: shm.Ring, before: int) -> str:
    """The state of the ring in words.

    Args:
        bus: The bus.
        interfaces: The names of the interfaces.
        state: Whether it is closed.
        before: Slaves between the first interface and the break.
    """
    if state != shm.Ring.OPEN:
        return "the ring is closed" if state == shm.Ring.CLOSED else "no frame has come back yet"
    return (
        f"the ring is broken {_place(bus, interfaces, before)}: the slaves are reached from both "
        f"ends; a second break would lose some"
    )


def _place(bus: Bus, interfaces: list[str], before: int) -> str:
    """Says between which slaves or interfaces the ring is broken."""
    first = bus.slaves[before - 1].label if before else interfaces[0]
    second = bus.slaves[before].label if before < len(bus.slaves) else interfaces[1]
    return f"between {first} and {second}"

"""Finds the slaves that can explain a wrong working counter, by asking them.

A slave adds to the working counter of a datagram if it answers, is in SAFEOP or OP, and its FMMUs
and sync managers are as ecatd has set them (ETG.1000.4). So each slave with bytes in the datagram
is asked for its AL state and for these registers.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

from ecatd.description.bus import Bus, Slave
from ecatd.etg.al import AlState
from ecatd.master.al_states import SlaveState
from ecatd.master.engine.process_image import COUNTS, Datagram, DomainImage
from ecatd.master.frames.datagrams import fprd
from ecatd.master.master import Master

from ..start.mapping import FMMU, SYNC_MANAGER
from ..start.running_bus import RunningBus
from .presence import name_slaves

_ENABLED, _SWITCHED_OFF = 0x01, 0x01
"""Bit of the activation of a sync manager or an FMMU; of the PDI control: off by the slave."""
_MANAGER_BYTES, _FMMU_BYTES = 8, 16
_CONTROL_BITS = 0x7F
"""Bits of the control of a sync manager that belong to the master."""


_ADDED_MOST = 255
"""More than any other device on the wire adds to a counter; one adds 3 at most."""
_VARIED = 3
_OTHER_DEVICE = (
    "another device takes part in it: `ecatctl rescan` shows what is on the wire, and "
    "`ecatctl capture -o FILE` writes the frames"
)


@dataclass(frozen=True, slots=True)
class Suspect:
    """A slave that explains a wrong working counter.

    Attributes:
        position: Its position.
        reason: What is wrong with it, and what to do.
    """

    position: int
    reason: str


@dataclass(frozen=True, slots=True)
class Finding:
    """What the slaves of a datagram have answered.

    Attributes:
        suspects: Slaves that explain the counter.
        able: Positions of those that add just as much as is missing, if no slave explains it.
        returned: Positions of those that are well now, but were not meanwhile.
        damaged: Whether the counters show that frames are damaged.
    """

    suspects: tuple[Suspect, ...]
    able: tuple[int, ...]
    returned: tuple[int, ...] = ()
    damaged: bool = False

    @property
    def slaves(self) -> tuple[int, ...]:
        """Positions of the slaves that explain the counter."""
        return tuple(item.position for item in self.suspects) or self.returned

    def text(self, bus: Bus, wrong_by: int) -> str:
        """Why the counter is wrong, in words, and what to do.

        Args:
            bus: The bus.
            wrong_by: The counter less the expected one.
        """
        if self.suspects:
            return "; ".join(
                f"{bus.slaves[item.position].label} {item.reason}" for item in self.suspects
            )
        if self.damaged:
            return (
                "counters like that come from damaged frames: `ecatctl errors` shows which cable "
                f"damages them; check it and its plugs. If none does, {_OTHER_DEVICE}"
            )
        if wrong_by > 0:
            return _OTHER_DEVICE
        if self.returned:
            were = "was" if len(self.returned) == 1 else "were"
            return (
                f"{name_slaves(bus, self.returned)} did not answer or {were} not in OP meanwhile, "
                "and took no part: `ecatctl events` shows what happened before that"
            )
        asked = "all its slaves answer, are in OP, and have the registers that ecatd has set"
        more = "`ecatctl capture -o FILE` writes the frames; exchange the slave to find out"
        if not self.able:
            return f"{asked}: {more}"
        each = "adds" if len(self.able) == 1 else "add"
        able = f"{name_slaves(bus, self.able)} {each} {-wrong_by}, as much as is missing"
        return f"{asked}; {able}: {more}"


def are_damaged(seen: Collection[int]) -> bool:
    """Whether wrong counters come from damaged frames, since no device counts like that.

    Args:
        seen: Some of the last wrong counters, each less the expected one. A device that takes part
            adds the same each time, and slaves that are missing add nothing.
    """
    most = max(seen, default=0)
    return most > _ADDED_MOST or (most > 0 and len({*seen}) >= _VARIED)


def find_suspects(
    running: RunningBus,
    domain: DomainImage,
    offset: int,
    wrong_by: int,
    away: Collection[int],
) -> Finding:
    """Asks the slaves of a datagram; on the worker.

    Args:
        running: The bus.
        domain: The domain.
        offset: First byte of the datagram in the image of the domain.
        wrong_by: The counter less the expected one.
        away: Positions of slaves that have not answered, or were not in OP, since the counters that
            are to be explained; they may be back.
    """
    datagram = next((item for item in domain.datagrams if item.offset == offset), None)
    if datagram is None:
        return Finding((), ())
    members = list(_members(running.bus, domain, datagram))
    states = running.master.al_states.read()
    suspects = [
        Suspect(slave.position, reason)
        for slave, _ in members
        if (reason := _by_state(states[slave.position]))
    ]
    there = [slave for slave, _ in members if not _by_state(states[slave.position])]
    suspects += _by_registers(running, there)
    suspects = suspects or [
        Suspect(slave.position, reason)
        for slave in there
        if (reason := _short_of_op(states[slave.position]))
    ]
    suspects.sort(key=lambda item: item.position)
    if suspects:
        return Finding(tuple(suspects), ())
    if returned := tuple(slave.position for slave, _ in members if slave.position in away):
        return Finding((), (), returned)
    return Finding((), tuple(slave.position for slave, adds in members if adds == -wrong_by))


def _members(bus: Bus, domain: DomainImage, datagram: Datagram) -> Iterator[tuple[Slave, int]]:
    """The slaves with bytes in a datagram, and what each adds to its working counter."""
    written, read = COUNTS[datagram.command]
    end = datagram.offset + datagram.length
    for slave in bus.slaves:
        if slave.domain != domain.number:
            continue
        adds = 0
        if slave.output_bytes and datagram.offset <= slave.output_offset < end:
            adds += written
        if slave.input_bytes and datagram.offset <= slave.input_offset < end:
            adds += read
        if adds:
            yield slave, adds


def _by_state(state: SlaveState) -> str:
    """Why a slave in this state exchanges nothing; empty if it does."""
    position = state.position
    if not state.al_state:
        return "does not answer: check its power and the cable to it"
    if state.al_state & 0x0F not in (AlState.SAFEOP, AlState.OP):
        return (
            f"exchanges no process data ({state.describe()}): `ecatctl state {position} OP` "
            f"brings it back, or says why not"
        )
    return ""


def _short_of_op(state: SlaveState) -> str:
    """What keeps a slave in SAFEOP or with an error, which may explain a counter; else empty."""
    if state.al_state == AlState.OP:
        return ""
    position = state.position
    again = f"`ecatctl state {position} OP` brings it there, or says why not"
    return f"is not in OP ({state.describe()}): {again}"


def _by_registers(running: RunningBus, slaves: Sequence[Slave]) -> Iterator[Suspect]:
    """Slaves whose sync managers or FMMUs are not as ecatd has set them."""
    master: Master = running.master
    wanted = [
        (slave, register, content)
        for slave in slaves
        for register, content in running.set_up.registers(slave.position)
    ]
    answers = master.registers.exchange(
        [fprd(master.stations[slave.position], at, len(content)) for slave, at, content in wanted]
    )
    named: set[int] = set()
    for (slave, register, content), answer in zip(wanted, answers, strict=True):
        if slave.position in named or not answer.wkc:
            continue
        if reason := _difference(register, content, answer.data):
            named.add(slave.position)
            again = (
                f"`ecatctl state {slave.position} PREOP`, then `ecatctl state "
                f"{slave.position} OP` sets it again"
            )
            yield Suspect(slave.position, f"{reason}: {again}")


def _difference(register: int, wanted: bytes, found: bytes) -> str:
    """What is wrong with the content of a sync manager or an FMMU; empty if nothing is."""
    if register < SYNC_MANAGER:
        name = f"FMMU {(register - FMMU) // _FMMU_BYTES} (register 0x{register:04X})"
        if not found[12] & _ENABLED:
            return f"has its {name} switched off, so it takes no part in the exchange"
        if found[:13] != wanted[:13]:
            return f"has other values in its {name} than ecatd has written: {found[:13].hex(' ')}"
        return ""
    number = (register - SYNC_MANAGER) // _MANAGER_BYTES
    name = f"sync manager {number} (register 0x{register:04X})"
    if not found[6] & _ENABLED:
        return f"has its {name} switched off"
    if found[7] & _SWITCHED_OFF:
        return f"has switched its {name} off by itself"
    same = found[:4] == wanted[:4] and not (found[4] ^ wanted[4]) & _CONTROL_BITS
    return (
        "" if same else f"has other values in its {name} than ecatd has written: {found.hex(' ')}"
    )

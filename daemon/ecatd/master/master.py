"""The master: scan, EEPROMs and registers of one bus. Call it only on one thread, the worker."""

from __future__ import annotations

import contextlib
import struct
import time
from collections.abc import Callable, Sequence
from typing import TypeVar

from ecatd.base.coroutine_steps import Steps, finish
from ecatd.base.errors import StateError, UnreachableError
from ecatd.base.log import Log
from ecatd.base.timeouts import Timeout
from ecatd.etg.al import AlState
from ecatd.etg.sii_categories import Words
from ecatd.etg.sii_parts import read_mailbox
from ecatd.linux.interface_state import InterfaceState, read_interfaces, remarks
from ecatd.shm import contract as shm

from .al_states import AlStates
from .frames import soem
from .frames.datagrams import Datagram, Datagrams, Station, fprd, fpwr, source_address
from .frames.eeprom import reading_eeproms, writing_eeprom
from .frames.frame_ring import FrameRing
from .frames.interface import open_for_control, own, wait_for_carriers
from .frames.other_end import find_other_end
from .frames.relay import Relay
from .frames.scan import FIRST_ANSWER, count_slaves, has_stations, number_slaves, stations
from .mailbox.coe import Coe
from .mailbox.mailbox_queue import MailboxQueue

_AL_STATUS = 0x0130
_SYNC_MANAGERS, _ACTIVATE = 0x0800, (0x0806, 0x080E)

_REPEAT = Timeout(0.5)
"""How long unanswered reads and writes are repeated."""

_LOOKS = 3  # a frame may get lost

_PAUSE = 0.001
"""Seconds between two repetitions."""

T = TypeVar("T")


class SilentSlaveError(StateError):
    """A slave does not answer.

    Attributes:
        position: Position of the slave.
    """

    def __init__(self, message: str, position: int) -> None:
        super().__init__(message)
        self.position = position


class Master:
    """An EtherCAT master. It reserves its interfaces until `close`.

    Args:
        interfaces: Names of its interfaces: one, or two with cable redundancy.
        cancelled: Called while waiting for slaves; when true, waiting ends with `StateError`.
        run: 32 bits that distinguish the frames of this run from those of other masters.
        share: Share of the cycle's free time that the master's frames may take; see `Relay`.
        priority: SCHED_FIFO priority of the relay, below that of the engine; 0 for none.
        frame_ring: The ring that keeps the frames of the relay; None for none.
        log: The log for details.

    Attributes:
        interfaces: Names of the interfaces.
        run: As above.
        relay: The relay that carries all frames of the master; set by `scan`.
        registers: Access to the registers of many slaves at once; set by `scan`.
        al_states: AL states of the slaves; set by `scan`.
        stations: Configured station addresses by position; set by `scan`.
        wire: Positions of the slaves that the scan has found, in the order of the wire.

    Raises:
        UnreachableError: There is no such interface.
        NotPermittedError: The process may not configure the interface.
        StateError: Another ecatd uses the interface.
    """

    relay: Relay
    registers: Datagrams
    al_states: AlStates

    def __init__(
        self,
        interfaces: Sequence[str],
        cancelled: Callable[[], bool] = lambda: False,
        *,
        run: int = 0,
        share: float = 1.0,
        priority: int = 0,
        frame_ring: FrameRing | None = None,
        log: Log | None = None,
    ) -> None:
        self.interfaces = list(interfaces)
        self._cancelled = cancelled
        self.run = run
        self._share = share
        self._priority = priority
        self._frame_ring = frame_ring
        log = log or Log("ecatd")
        self._log, self._mailbox_log = log.of("slaves"), log.of("mailbox")
        self.stations: list[int] = []
        self.wire: list[int] = []
        self._names: list[str] = []
        self._queues: list[MailboxQueue] = []
        with contextlib.ExitStack() as stack:
            for name in interfaces:
                stack.enter_context(own(name, log.of("interfaces")))
            self._opened = stack.pop_all()

    def reopen(self, port: int) -> None:
        """Opens a new socket on an interface that went away and came back.

        Args:
            port: 0 for the first interface, 1 for the second.

        Raises:
            UnreachableError: The interface is not there.
            NotPermittedError: The process may not use raw sockets any more.
        """
        self.relay.set_socket(port, open_for_control(self.interfaces[port]))

    def scan(self, patience: Timeout, *, may_be_empty: bool = False) -> str:
        """Finds the slaves, numbers them, sets their mailboxes up, and leaves them in INIT.

        SOEM scans first, and closes the interfaces before the relay opens them. If its result does
        not match the slaves on the wire, ecatd numbers them itself.

        Args:
            patience: Time that slaves have to reach INIT.
            may_be_empty: Whether a bus without slaves, or without a carrier, is accepted.

        Returns:
            Why SOEM's numbers were not used, as a sentence; empty if they were used.

        Raises:
            UnreachableError: No interface has a carrier, or no slave answers.
            NotPermittedError: The process may not use raw sockets.
            StateError: There are too many slaves, slaves come or go meanwhile, an EEPROM cannot be
                read, a slave does not reach INIT, or the interfaces of a ring are exchanged.
        """
        try:
            wait_for_carriers(self.interfaces, self._cancelled)
        except UnreachableError:
            if not may_be_empty:
                raise
        self._names = soem.scan(self.interfaces)
        self._open_relay()
        count = count_slaves(self.registers)
        if count == 0 and not may_be_empty:
            raise UnreachableError(_why_none(self.interfaces))
        if count > shm.MAX_SLAVES:
            raise StateError(
                f"there are {count} slaves on '{self.interfaces[0]}', but a bus can have "
                f"{shm.MAX_SLAVES} at most"
            )
        _check_direction(self.interfaces)
        why = self._why_not_as_soem(count)
        if why:
            number_slaves(self.registers, count)
            self._names = []
        self.stations = [*stations(count)]
        self.wire = [*range(count)]
        self._queues = [MailboxQueue(self._mailbox_log) for _ in self.stations]
        self.al_states = self._states()
        self.al_states.wait_for(AlState.INIT, patience)
        self._set_mailboxes_up()
        return why

    def arrange(self, places: Sequence[int | None]) -> None:
        """Gives the slaves other positions than those of the scan.

        Args:
            places: For each new position, the position of the scan, or None for an absent slave. An
                absent slave gets its own station address, too, for the time when it comes.

        Raises:
            StateError: There are more slaves than a bus can have.
        """
        if len(places) > shm.MAX_SLAVES:
            raise StateError(
                f"there are {len(places)} slaves with those that are optional, but a bus can have "
                f"{shm.MAX_SLAVES} at most"
            )
        spare = iter(stations(len(places))[len(self.stations) :])
        self.stations = [next(spare) if at is None else self.stations[at] for at in places]
        self._names = ["" if at is None else self.name(at) for at in places]
        self._queues = [
            MailboxQueue(self._mailbox_log) if at is None else self._queues[at] for at in places
        ]
        there = {at: position for position, at in enumerate(places) if at is not None}
        self.wire = [there[at] for at in sorted(there)]
        self.al_states = self._states()

    def _states(self) -> AlStates:
        return AlStates(self.registers, self.stations, self.label, self._cancelled, self._log)

    def _why_not_as_soem(self, count: int) -> str:
        """Says why SOEM's numbers do not match the slaves on the wire; empty if they match."""
        found = len(self._names)
        if count > soem.SLAVES_MAX:
            return f"SOEM has room for {soem.SLAVES_MAX}"
        if count != found:
            return f"SOEM's scan found {found or 'none'}"
        if not has_stations(self.registers, count):
            return "SOEM's scan gave them other addresses"
        return ""

    def _open_relay(self) -> None:
        sockets = [open_for_control(name) for name in self.interfaces]
        self.relay = Relay(sockets, self._share, self._priority)
        if self._frame_ring is not None:
            self._frame_ring.of_relay(self.relay.handle)
        self._opened.callback(self.relay.close)
        self.registers = Datagrams(
            self.relay.client, source_address(0, self.run), self.relay.timeout_us * 1e-6
        )

    def set_share(self, share: float) -> None:
        """Changes the share of the cycle's free time that the master's frames may take."""
        self.relay.set_share(share)
        self.registers.set_timeout(self.relay.timeout_us * 1e-6)

    def _set_mailboxes_up(self) -> None:
        """Sets sync managers 0 and 1 up in each slave that has a mailbox."""
        positions = range(len(self.stations))
        found = zip(positions, self.read_mailboxes(positions), strict=True)
        wanted = [(position, data) for position, data in found if data]
        # SOEM has set them up already, but it assumes that devices of one kind have equal EEPROMs.
        # A sync manager must be off while its settings are changed (ETG.1000.4).
        self.write_registers(
            [(position, register, b"\0") for position, _ in wanted for register in _ACTIVATE]
        )
        self.write_registers([(position, _SYNC_MANAGERS, data) for position, data in wanted])

    def read_mailboxes(self, positions: Sequence[int]) -> list[bytes]:
        """Carries `reading_mailboxes` out at once, for a start, where no other work waits."""
        return finish(self.reading_mailboxes(positions))

    def reading_mailboxes(self, positions: Sequence[int]) -> Steps[list[bytes]]:
        """Reads the settings of the mailboxes, which are sync managers 0 and 1, from EEPROMs.

        Returns:
            For each slave, 16 bytes for the registers of both; empty if it has no mailbox.

        Raises:
            StateError: An EEPROM cannot be read.
        """
        found = yield from self.reading_eeproms(read_mailbox, positions)
        return [
            b"".join(
                struct.pack("<HHBBBB", m.start, m.length, m.control, 0, 1, 0) for m in managers
            )
            for managers in found
        ]

    def answers(self, position: int) -> bool:
        """Whether a slave answers at its address now."""
        (answer,) = self.registers.read_all([self.stations[position]], _AL_STATUS, 2)
        return bool(answer.wkc)

    def find_gone(self) -> list[int]:
        """Returns the positions of slaves that the scan has found, but that do not answer any more.

        A slave that was without power has lost its station address, so it is among them.
        """
        gone = set(self.wire)
        for _ in range(_LOOKS):
            if gone:
                gone -= {slave.position for slave in self.al_states.read() if slave.al_state}
        return sorted(gone)

    def name(self, position: int) -> str:
        """Returns the name that SOEM has read for a slave, for messages; empty if it has none."""
        return self._names[position] if position < len(self._names) else ""

    def read_eeproms(
        self, decode: Callable[[Words], T], positions: Sequence[int] | None = None
    ) -> list[T]:
        """Carries `reading_eeproms` out at once, for a start, where no other work waits."""
        return finish(self.reading_eeproms(decode, positions))

    def reading_eeproms(
        self, decode: Callable[[Words], T], positions: Sequence[int] | None = None
    ) -> Steps[list[T]]:
        """Reads SII EEPROMs of all slaves, or of those at `positions`.

        See `eeprom.reading_eeproms`.

        Raises:
            StateError: An EEPROM cannot be read, or `decode` finds it malformed.
        """
        chosen = range(len(self.stations)) if positions is None else positions
        return reading_eeproms(
            self.registers,
            [(Station(self.stations[position]), self.label(position)) for position in chosen],
            decode,
            self._cancelled,
        )

    def writing_eeprom(
        self, position: int, word: int, data: bytes, before: dict[int, bytes]
    ) -> Steps[None]:
        """Writes words of the SII EEPROM of one slave; see `eeprom.writing_eeprom`."""
        station, label = Station(self.stations[position]), self.label(position)
        return writing_eeprom(self.registers, station, label, word, data, before)

    def read_registers(self, wanted: Sequence[tuple[int, int, int]]) -> list[bytes]:
        """Carries `reading` out at once, for a start, where no other work waits."""
        return finish(self.reading(wanted), _PAUSE)

    def write_registers(self, wanted: Sequence[tuple[int, int, bytes]]) -> None:
        """Carries `writing` out at once, for a start, where no other work waits."""
        finish(self.writing(wanted), _PAUSE)

    def reading(self, wanted: Sequence[tuple[int, int, int]]) -> Steps[list[bytes]]:
        """Reads ESC memory of many slaves at once; tries again where a slave does not answer.

        Args:
            wanted: Position, register address and number of bytes of each read.

        Returns:
            The bytes of each read, in the same order.

        Raises:
            SilentSlaveError: A slave does not answer.
        """
        datagrams = [
            fprd(self.stations[position], address, size) for position, address, size in wanted
        ]
        return self._repeat(datagrams, [item[:2] for item in wanted], "a read")

    def writing(self, wanted: Sequence[tuple[int, int, bytes]]) -> Steps[None]:
        """Writes ESC memory of many slaves, in order; raises as `reading`.

        Writes again where a slave does not answer.

        Args:
            wanted: Position, register address and data of each write.
        """
        datagrams = [
            fpwr(self.stations[position], address, data) for position, address, data in wanted
        ]
        yield from self._repeat(datagrams, [item[:2] for item in wanted], "a write")

    def _repeat(
        self, datagrams: list[Datagram], where: list[tuple[int, int]], what: str
    ) -> Steps[list[bytes]]:
        """Exchanges datagrams, and repeats those without an answer, as long as `_REPEAT` says.

        So a short disturbance does not end the bus.

        Args:
            datagrams: Reads or writes.
            where: Position and register address of each, for the message.
            what: "a read" or "a write", for the message.

        Returns:
            The data of each answer, in the order of `datagrams`.

        Raises:
            SilentSlaveError: A slave still does not answer.
        """
        deadline = time.monotonic() + _REPEAT.seconds
        answers = self.registers.exchange(datagrams)
        while silent := [number for number, answer in enumerate(answers) if answer.wkc == 0]:
            if time.monotonic() > deadline:
                position, address = where[silent[0]]
                raise SilentSlaveError(
                    f"slave {position} does not answer {what} of register 0x{address:04X} within "
                    f"{_REPEAT}",
                    position,
                )
            yield
            again = self.registers.exchange([datagrams[number] for number in silent])
            for number, answer in zip(silent, again, strict=True):
                answers[number] = answer
        return [answer.data for answer in answers]

    def register_read(self, position: int, address: int, size: int) -> bytes:
        """Reads `size` bytes of ESC memory of one slave; raises as `reading`."""
        return self.read_registers([(position, address, size)])[0]

    def register_write(self, position: int, address: int, data: bytes) -> None:
        """Writes ESC memory of one slave; raises as `writing`."""
        self.write_registers([(position, address, data)])

    def set_mailbox_timeout(self, position: int, seconds: float) -> None:
        """Sets the time that a slave has to answer over its mailbox, in seconds."""
        self._queues[position].answer_s = seconds

    def set_mailbox_tries(self, position: int, tries: int) -> None:
        """Sets how many times a slave is asked for an object if it does not answer."""
        self._queues[position].tries = tries

    def coe(self, position: int, *, alone: bool = False) -> Coe:
        """Returns the `Coe` of a slave for one conversation; `alone` as in `Mailbox`."""
        return Coe(position, self.stations[position], self._queues[position], alone=alone)

    def label(self, position: int) -> str:
        """Returns the label of a slave for messages, with the name that SOEM has read."""
        name = self.name(position)
        return f"slave {position} ({name})" if name else f"slave {position}"

    def close(self) -> None:
        """Closes all sockets, and restores and releases the interfaces."""
        self._opened.close()


def _why_none(interfaces: Sequence[str]) -> str:
    """Why no slave answers, as far as the interfaces can tell."""
    first = interfaces[0]
    where = " and ".join(f"'{name}'" for name in interfaces)
    none = f"no EtherCAT slave answers on {where} within {FIRST_ANSWER}"
    states = read_interfaces(interfaces)
    if any(state.master for state in states):  # it takes the frames that come back
        return f"{none}: {_said(states)}"
    end = find_other_end(first) if len(interfaces) == 1 else None
    if end is not None and end.slaves:
        # A bridge takes what its ports receive: one of them is the end.
        bridge = any(state.kind == "bridge" for state in read_interfaces([end.interface]))
        remedy = (
            "take the port with the slaves out of this bridge (`ip link set PORT nomaster`), and "
            "write it as second_interface"
            if bridge
            else f'write second_interface = "{end.interface}"'
        )
        return (
            f"{none}, because the slaves form a ring. Frames sent on {first} pass {end.slaves} "
            f"slaves and arrive at {end.interface}: {remedy}, or unplug one end"
        )
    if end is not None:
        return (
            f"{none}. Frames sent on {first} arrive at {end.interface}, and no slave has processed "
            f"them. If no slave is between the two, connect the slaves. If {first} is the far end "
            f'of a ring, write interface = "{end.interface}" and second_interface = "{first}"'
        )
    said = _said(states)
    more = f" ({said})" if said else ""
    return (
        f"{none}: check the cable and the power of the first slave, and that this is the right "
        f"interface{more}"
    )


def _said(states: Sequence[InterfaceState]) -> str:
    return "; ".join(str(item) for state in states for item in remarks(state))


def _check_direction(interfaces: Sequence[str]) -> None:
    """Checks that frames of the first interface of a closed ring pass the slaves in their order.

    Raises:
        StateError: The interfaces are exchanged.
    """
    if len(interfaces) == 1:
        return
    first, second = interfaces
    end = find_other_end(first)
    if end is not None and end.interface == second and not end.slaves:
        raise StateError(
            f"the interfaces of the ring are exchanged: slaves process frames on their way from "
            f'{second} to {first}: write interface = "{second}" and second_interface = "{first}", '
            f"or exchange the plugs"
        )

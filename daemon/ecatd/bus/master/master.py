"""The master: scan, states and registers of one bus. All calls belong on one thread, the worker."""

from __future__ import annotations

import contextlib
import struct
import time
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from ecatd import shm
from ecatd.coroutine_steps import Steps, finish
from ecatd.model.al import AL_ERROR_FLAG, AlState, al_state_text, al_status_text
from ecatd.model.bus import positions_text
from ecatd.model.errors import StateError, UnreachableError
from ecatd.model.sii_reader import read_mailbox

from ..frames import soem
from ..frames.datagrams import Datagram, Datagrams, Station, bwr, fprd, fpwr, source_address
from ..frames.eeprom import Words, read_eeproms
from ..frames.interface import open_for_control, own
from ..frames.relay import Relay
from ..frames.scan import count_slaves, has_stations, number_slaves, stations
from ..mailbox.coe import Coe
from ..mailbox.mailboxes import Line

_AL_CONTROL, _AL_STATUS = 0x0120, 0x0130
_SYNC_MANAGERS = 0x0800

_TRIES = 3
_ASK_AGAIN = 0.5
_ACKNOWLEDGE_TIMEOUT = 0.5

T = TypeVar("T")


@dataclass(slots=True)
class SlaveState:
    """AL status of one slave: register 0x0130 (0: no answer) and code of register 0x0134."""

    position: int
    al_state: int
    al_code: int

    def describe(self) -> str:
        """The state in words, with the reason where the slave reports an error."""
        text = al_state_text(self.al_state)
        if self.al_state & AL_ERROR_FLAG:
            text += f" (AL status 0x{self.al_code:04X}: {al_status_text(self.al_code)})"
        return text


class Master:
    """An EtherCAT master; the interfaces are its own from now on.

    Args:
        interfaces: Names of its interfaces: one, or two with cable redundancy.
        cancelled: Asked while waiting for slaves; when true, waiting ends with `StateError`.
        run: 32 bits that tell frames with register access of this run from those of others.
        share: Share of the time that frames may be on the wire beside the cyclic exchange.
        priority: SCHED_FIFO priority of the relay, below that of the engine; 0 for none.

    Attributes:
        relay: The way of all frames of the master; from `scan` on.
        registers: Access to registers, of many slaves at once; from `scan` on.
        stations: Configured station addresses by position; from `scan` on.

    Raises:
        UnreachableError: There is no such interface.
        NotPermittedError: The process may not configure the interface.
        StateError: Another ecatd uses the interface.
    """

    relay: Relay
    registers: Datagrams

    def __init__(
        self,
        interfaces: Sequence[str],
        cancelled: Callable[[], bool] = lambda: False,
        *,
        run: int = 0,
        share: float = 1.0,
        priority: int = 0,
    ) -> None:
        self._interfaces = list(interfaces)
        self._cancelled = cancelled
        self._run = run
        self._share = share
        self._priority = priority
        self.stations: list[int] = []
        self._names: list[str] = []
        self._lines: list[Line] = []
        with contextlib.ExitStack() as stack:
            for name in interfaces:
                stack.enter_context(own(name))
            self._opened = stack.pop_all()

    def reopen(self, port: int) -> None:
        """Opens a new socket on an interface that went and came back.

        Args:
            port: 0 first interface, 1 second one.

        Raises:
            UnreachableError: The interface is not there.
            NotPermittedError: The process may not use raw sockets any more.
        """
        self.relay.set_socket(port, open_for_control(self._interfaces[port]))

    def scan(self, timeout: float) -> str:
        """Finds the slaves, numbers them, sets their mailboxes up, and leaves them in INIT.

        SOEM meets them first, and closes the interfaces again before the relay opens them. Where
        what it has found is not what stands on the wire, they are numbered once more.

        Args:
            timeout: Seconds that slaves have to reach INIT.

        Returns:
            Why SOEM's numbers were not taken, in words; empty if they were.

        Raises:
            UnreachableError: No slave answers.
            NotPermittedError: The process may not use raw sockets.
            StateError: There are too many, they come and go meanwhile, or one does not reach INIT.
        """
        self._names = soem.scan(self._interfaces)
        self._open_relay()
        count = count_slaves(self.registers)
        if count == 0:
            raise UnreachableError(
                f"no EtherCAT slave answers on '{self._interfaces[0]}': check cable and power of "
                f"the first slave, and that this is the right interface"
            )
        if count > shm.MAX_SLAVES:
            raise StateError(
                f"there are {count} slaves on '{self._interfaces[0]}', but a bus can have "
                f"{shm.MAX_SLAVES} at most"
            )
        why = self._why_not_as_soem(count)
        if why:
            number_slaves(self.registers, count)
            self._names = []
        self.stations = [*stations(count)]
        self._lines = [Line() for _ in self.stations]
        self.wait_for_state(AlState.INIT, timeout)
        self._set_mailboxes_up()
        return why

    def _why_not_as_soem(self, count: int) -> str:
        """What SOEM has not numbered as it stands on the wire, in words."""
        found = len(self._names)
        if count > soem.SLAVES_MAX:
            return f"SOEM has room for {soem.SLAVES_MAX}"
        if count != found:
            return f"SOEM's scan found {found or 'none'}"
        if not has_stations(self.registers, count):
            return "SOEM's scan gave them other addresses"
        return ""

    def _open_relay(self) -> None:
        sockets = [open_for_control(name) for name in self._interfaces]
        self.relay = Relay(sockets, self._share, self._priority)
        self._opened.callback(self.relay.close)
        self.registers = Datagrams(
            self.relay.client, source_address(0, self._run), self.relay.timeout_us * 1e-6
        )

    def _set_mailboxes_up(self) -> None:
        """Sync managers 0 and 1, in one datagram, of all slaves that have a mailbox."""
        writes = []
        for position, managers in enumerate(self.read_eeproms(read_mailbox)):
            rows = [struct.pack("<HHBBBB", m.start, m.length, m.control, 0, 1, 0) for m in managers]
            if rows:
                writes.append((position, _SYNC_MANAGERS, b"".join(rows)))
        self.write_registers(writes)

    def name(self, position: int) -> str:
        """What a slave is called before its EEPROM is read; empty where SOEM does not tell."""
        return self._names[position] if position < len(self._names) else ""

    def read_eeproms(
        self, decode: Callable[[Words], T], positions: Sequence[int] | None = None
    ) -> list[T]:
        """Reads SII EEPROMs: of all slaves, or of those at `positions`; see `eeprom.read_eeproms`.

        Raises:
            StateError: One cannot be read, or `decode` makes no sense of it.
        """
        chosen = range(len(self.stations)) if positions is None else positions
        return read_eeproms(
            self.registers,
            [(Station(self.stations[position]), self._label(position)) for position in chosen],
            decode,
            self._cancelled,
        )

    def read_registers(self, wanted: Sequence[tuple[int, int, int]]) -> list[bytes]:
        """Reads ESC memory, much of it at once; asked again if an answer is lost.

        Args:
            wanted: Position, address and number of bytes of each.

        Raises:
            StateError: A slave does not answer.
        """
        datagrams = [
            fprd(self.stations[position], address, size) for position, address, size in wanted
        ]
        return self._insist(datagrams, [item[:2] for item in wanted], "a read")

    def write_registers(self, wanted: Sequence[tuple[int, int, bytes]]) -> None:
        """Writes ESC memory, in order; raises as `read_registers`.

        Args:
            wanted: Position, address and data of each; written again if an answer is lost.
        """
        datagrams = [
            fpwr(self.stations[position], address, data) for position, address, data in wanted
        ]
        self._insist(datagrams, [item[:2] for item in wanted], "a write")

    def _insist(
        self, datagrams: list[Datagram], where: list[tuple[int, int]], what: str
    ) -> list[bytes]:
        """Asks again those who do not answer: one hiccup is no reason to give a bus up."""
        answers = self.registers.exchange(datagrams)
        for tries_left in reversed(range(_TRIES)):
            silent = [number for number, answer in enumerate(answers) if answer.wkc == 0]
            if not silent:
                break
            if tries_left == 0:
                position, address = where[silent[0]]
                raise StateError(
                    f"slave {position} does not answer {what} of register 0x{address:04X}"
                )
            again = self.registers.exchange([datagrams[number] for number in silent])
            for number, answer in zip(silent, again, strict=True):
                answers[number] = answer
        return [answer.data for answer in answers]

    def register_read(self, position: int, address: int, size: int) -> bytes:
        """`size` bytes of ESC memory; raises as `read_registers`."""
        return self.read_registers([(position, address, size)])[0]

    def register_write(self, position: int, address: int, data: bytes) -> None:
        """Writes ESC memory; raises as `write_registers`."""
        self.write_registers([(position, address, data)])

    def coe(self, position: int, *, alone: bool = False) -> Coe:
        """The way to the objects of a slave, for one conversation; `alone` as in `Mailbox`."""
        return Coe(position, self.stations[position], self._lines[position], alone=alone)

    def _request(self, state: int, positions: Iterable[int] | None) -> None:
        """Writes AL control, of all slaves by one broadcast if `positions` is None."""
        data = struct.pack("<H", state)
        if positions is None:
            self.registers.exchange([bwr(_AL_CONTROL, data)])
        else:
            self.registers.exchange([fpwr(self.stations[p], _AL_CONTROL, data) for p in positions])

    def acknowledge(self, positions: Collection[int]) -> Steps[set[int]]:
        """Acknowledges errors (AL control bit 4), and gives the slaves time to follow.

        Returns:
            The slaves that had an error; they stay in the state in which they are.

        A controller that emulates its device repeats AL control in AL status, acknowledgement
        included, which looks like an error without a code: it wants the state without it.
        """
        deadline = time.monotonic() + _ACKNOWLEDGE_TIMEOUT
        wrong: set[int] = set()
        while time.monotonic() < deadline:
            flagged: dict[int, list[int]] = {}
            for item in self.states():
                if item.al_state & AL_ERROR_FLAG and item.position in positions:
                    bit = AL_ERROR_FLAG if item.al_code else 0
                    if bit:
                        wrong.add(item.position)
                    flagged.setdefault((item.al_state & 0x0F) | bit, []).append(item.position)
            if not flagged:
                break
            for state, who in flagged.items():
                self._request(state, who)
            yield
        return wrong

    def states(self) -> list[SlaveState]:
        """The AL status of every slave, freshly read."""
        answers = self.registers.read_all(self.stations, _AL_STATUS, 6)
        return [
            # In between (0x0132) lies what is reserved.
            SlaveState(position, *(struct.unpack("<H2xH", answer.data) if answer.wkc else (0, 0)))
            for position, answer in enumerate(answers)
        ]

    def request_state(
        self, state: AlState, timeout: float, positions: Iterable[int] | None = None
    ) -> Steps[list[SlaveState]]:
        """Acknowledges errors, requests an AL state, and waits until all slaves have reached it.

        A slave that does not reach the state does not delay the others.

        Args:
            state: The state.
            timeout: Seconds to wait.
            positions: The slaves, or None for all.

        Returns:
            The slaves that refused, or did not reach it in time, as they are now.
        """
        waiting = set(range(len(self.stations)) if positions is None else positions)
        yield from self.acknowledge(waiting)
        whom = None if positions is None else waiting
        deadline = time.monotonic() + timeout
        ask_again = 0.0
        refused = []
        while True:
            now = time.monotonic()
            if now >= ask_again:  # one lost frame is no reason to wait in vain
                self._request(state, whom)
                ask_again = now + _ASK_AGAIN
            wrong = [
                item
                for item in self.states()
                if item.position in waiting and item.al_state != state
            ]
            refused += [item for item in wrong if item.al_state & AL_ERROR_FLAG and item.al_code]
            wrong = [item for item in wrong if item not in refused]
            waiting = {item.position for item in wrong}
            if not waiting or now > deadline:
                return refused + wrong
            if self._cancelled():
                raise StateError(f"stopped while slaves were going to {state.name}")
            whom = waiting
            yield

    def wait_for_state(
        self,
        state: AlState,
        timeout: float,
        positions: Iterable[int] | None = None,
        *,
        optional: Collection[int] = (),
    ) -> None:
        """Requests an AL state and waits until all slaves have reached it; blocks.

        Args:
            state: The state.
            timeout: Seconds to wait.
            positions: The slaves, or None for all.
            optional: Slaves that may miss it without an error.

        Raises:
            StateError: Slaves did not reach it; the message names each, with its AL status.
        """
        finish(self.require_state(state, timeout, positions, optional=optional))

    def require_state(
        self,
        state: AlState,
        timeout: float,
        positions: Iterable[int] | None = None,
        *,
        optional: Collection[int] = (),
    ) -> Steps[None]:
        """The coroutine of `wait_for_state`, with the same arguments and errors."""
        missed = yield from self.request_state(state, timeout, positions)
        missed = [item for item in missed if item.position not in optional]
        # What a slave has refused is the news; others were perhaps waiting for it.
        refused = [item for item in missed if item.al_state & AL_ERROR_FLAG and item.al_code]
        if missed:
            raise StateError(self._missed(refused or missed, state))

    def _missed(self, wrong: list[SlaveState], state: AlState) -> str:
        """Which slaves do not reach a state, those with the same AL status together."""
        alike: dict[str, list[int]] = {}
        for item in wrong:
            alike.setdefault(item.describe(), []).append(item.position)
        return "; ".join(
            f"{self._label(positions[0])} does not reach {state.name}: {status}"
            if len(positions) == 1
            else f"slaves {positions_text(positions)} do not reach {state.name}: {status}"
            for status, positions in alike.items()
        )

    def _label(self, position: int) -> str:
        name = self.name(position)
        return f"slave {position} ({name})" if name else f"slave {position}"

    def close(self) -> None:
        """Closes all sockets, and leaves the interfaces to others as they were."""
        self._opened.close()

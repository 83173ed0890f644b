"""AL states of all slaves: reads them, and brings slaves to other states."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass

from ecatd.base.coroutine_steps import Steps, finish
from ecatd.base.errors import StateError
from ecatd.base.log import Log
from ecatd.base.timeouts import Timeout
from ecatd.description.bus import positions_text
from ecatd.etg.al import AL_ERROR_FLAG, AlState, al_state_text, al_status_text

from .frames.datagrams import Datagrams, bwr, fpwr

_AL_CONTROL, _AL_STATUS = 0x0120, 0x0130
_IDENTIFICATION = 0x20  # bit of AL status, see `frames/identification.py`

WHY_SILENT = "switched off or exchanged, or behind a broken cable; `ecatctl check` says more"
"""What is said of slaves that should do something and do not answer."""

_ASK_AGAIN = 0.5
_ACKNOWLEDGE_TIMEOUT = 0.5


class NotReachedError(StateError):
    """Slaves did not reach a state.

    Attributes:
        missed: By position, which state a slave has not reached, and why: see `why_not_reached`.
    """

    def __init__(self, message: str, missed: dict[int, str]) -> None:
        super().__init__(message)
        self.missed = missed


@dataclass(slots=True)
class SlaveState:
    """AL status of one slave: register 0x0130 (0: no answer), and the code in register 0x0134."""

    position: int
    al_state: int
    al_code: int

    def describe(self) -> str:
        """The state in words, with the reason where the slave reports an error."""
        text = al_state_text(self.al_state)
        if self.al_state & AL_ERROR_FLAG:
            text += f" (AL status 0x{self.al_code:04X}: {al_status_text(self.al_code)})"
        return text


def states_text(states: Iterable[SlaveState]) -> str:
    """The states of slaves in words: of which slaves, if they are not the same."""
    alike: dict[str, list[int]] = {}
    for item in states:
        alike.setdefault(item.describe(), []).append(item.position)
    if len(alike) == 1:
        return next(iter(alike))
    return ", ".join(f"{text} ({_slaves(positions)})" for text, positions in alike.items())


class AlStates:
    """The AL states of the slaves of one bus. Call it only on the thread of the master.

    Args:
        registers: Access to the registers of many slaves at once.
        stations: Configured station addresses by position.
        label: Returns the name of the slave at a position for messages.
        cancelled: Called while waiting for slaves; when it returns true, waiting ends with
            `StateError`.
        log: The log for details.
    """

    def __init__(
        self,
        registers: Datagrams,
        stations: Sequence[int],
        label: Callable[[int], str],
        cancelled: Callable[[], bool],
        log: Log,
    ) -> None:
        self._registers = registers
        self._stations = stations
        self._label = label
        self._cancelled = cancelled
        self._log = log

    def _write(self, state: int, positions: Iterable[int] | None) -> None:
        """Writes AL control: of the slaves at `positions`, or of all slaves by one broadcast."""
        data = struct.pack("<H", state)
        if positions is None:
            self._registers.exchange([bwr(_AL_CONTROL, data)])
        else:
            self._registers.exchange(
                [fpwr(self._stations[p], _AL_CONTROL, data) for p in positions]
            )

    def request_of_all(self, state: AlState) -> None:
        """Requests an AL state of all slaves by one broadcast, and waits for none of them."""
        self._write(state, None)

    def acknowledge(self, positions: Collection[int]) -> Steps[set[int]]:
        """Acknowledges errors (AL control bit 4), and gives the slaves time to clear them.

        An ESC with device emulation copies AL control to AL status, including the acknowledge bit.
        That looks like an error without a code. So a slave without a code gets a request for its
        state without this bit. Others keep the flag until it is acknowledged, and have no code
        either. So requests with the bit follow, by turns with those without it.

        Returns:
            The positions of the slaves that had an error. They stay in their states.
        """
        deadline = time.monotonic() + _ACKNOWLEDGE_TIMEOUT
        wrong: set[int] = set()
        plain: set[int] = set()  # those that got a request without the bit last
        while time.monotonic() < deadline:
            flagged: dict[int, list[int]] = {}
            for item in self.read():
                if item.al_state & AL_ERROR_FLAG and item.position in positions:
                    bit = AL_ERROR_FLAG if item.al_code or item.position in plain else 0
                    if item.al_code:
                        wrong.add(item.position)
                    elif bit:
                        plain.remove(item.position)
                    else:
                        plain.add(item.position)
                    flagged.setdefault((item.al_state & 0x0F) | bit, []).append(item.position)
            if not flagged:
                break
            for state, who in flagged.items():
                self._log.debug(
                    f"{_slaves(who)}: the error is acknowledged with AL control 0x{state:02X}",
                    slaves=who,
                )
                self._write(state, who)
            yield
        return wrong

    def read(self) -> list[SlaveState]:
        """Reads the AL status of every slave."""
        answers = self._registers.read_all(self._stations, _AL_STATUS, 6)
        states = []
        for position, answer in enumerate(answers):
            # 0x0132 is reserved.
            state, code = struct.unpack("<H2xH", answer.data) if answer.wkc else (0, 0)
            if state & _IDENTIFICATION:  # it is no code, but the identification of the slave
                state, code = state & ~_IDENTIFICATION, 0
            states.append(SlaveState(position, state, code))
        return states

    def request(
        self, state: AlState, patience: Timeout, positions: Iterable[int] | None = None
    ) -> Steps[list[SlaveState]]:
        """Acknowledges errors, requests an AL state, and waits until all slaves have reached it.

        A slave that does not reach the state does not delay the others.

        Args:
            state: The state.
            patience: How long to wait.
            positions: The slaves, or None for all.

        Returns:
            The slaves that refused the state or did not reach it in time, with their AL status.
        """
        waiting = set(range(len(self._stations)) if positions is None else positions)
        yield from self.acknowledge(waiting)
        whom = None if positions is None else waiting
        begin = time.monotonic()
        deadline = begin + patience.seconds
        ask_again = 0.0
        refused: list[SlaveState] = []
        asked = sorted(waiting)
        while True:
            now = time.monotonic()
            if now >= ask_again:  # the frame with the request may have been lost
                self._log.debug(
                    f"{_slaves(sorted(waiting))}: {state.name} is requested", slaves=waiting
                )
                self._write(state, whom)
                ask_again = now + _ASK_AGAIN
            wrong = [
                item for item in self.read() if item.position in waiting and item.al_state != state
            ]
            refused += [item for item in wrong if item.al_state & AL_ERROR_FLAG and item.al_code]
            wrong = [item for item in wrong if item not in refused]
            waiting = {item.position for item in wrong}
            if not waiting or now > deadline:
                self._log_reached(state, asked, refused + wrong, now - begin)
                return refused + wrong
            if self._cancelled():
                raise StateError(f"stopped while slaves were going to {state.name}")
            whom = waiting
            yield

    def _log_reached(
        self, state: AlState, asked: list[int], missed: list[SlaveState], seconds: float
    ) -> None:
        late = {item.position for item in missed}
        if there := [position for position in asked if position not in late]:
            text = f"{_slaves(there)}: {state.name} is reached after {1e3 * seconds:.0f} ms"
            self._log.debug(text, slaves=there)
        for item in missed:
            self._log.debug(
                f"{self._label(item.position)}: {state.name} is not reached: {item.describe()}",
                slaves=[item.position],
            )

    def wait_for(
        self,
        state: AlState,
        patience: Timeout,
        positions: Iterable[int] | None = None,
        *,
        optional: Collection[int] = (),
    ) -> None:
        """Requests an AL state and waits until all slaves have reached it; blocks.

        Args:
            state: The state.
            patience: How long to wait.
            positions: The slaves, or None for all.
            optional: Slaves that need not reach the state: they cause no error.

        Raises:
            NotReachedError: Slaves did not reach it; the message names each, with its AL status.
            StateError: `cancelled` returned true.
        """
        finish(self.require(state, patience, positions, optional=optional))

    def require(
        self,
        state: AlState,
        patience: Timeout,
        positions: Iterable[int] | None = None,
        *,
        optional: Collection[int] = (),
    ) -> Steps[None]:
        """The steps of `wait_for`, with the same arguments and errors."""
        missed = yield from self.request(state, patience, positions)
        missed = [item for item in missed if item.position not in optional]
        # If slaves refused, only these are named: the others may have been waiting for them.
        refused = [item for item in missed if item.al_state & AL_ERROR_FLAG and item.al_code]
        if missed:
            why = {n.position: why_not_reached(n, state, patience) for n in refused or missed}
            raise NotReachedError(self._missed(why), why)

    def _missed(self, why: dict[int, str]) -> str:
        """Returns a text about slaves that miss a state, grouped by their AL status."""
        alike: dict[str, list[int]] = {}
        for position, text in why.items():
            alike.setdefault(text, []).append(position)
        return "; ".join(
            f"{self._label(positions[0])} does not reach {why}"
            if len(positions) == 1
            else f"slaves {positions_text(positions)} do not reach {why}"
            for why, positions in alike.items()
        )


def why_not_reached(item: SlaveState, state: AlState, patience: Timeout) -> str:
    """A state that a slave has refused, or has not reached in time, and what it says.

    Such as `OP within 10 s (state_timeout_s above all tables): SAFEOP`.
    """
    refused = item.al_state & AL_ERROR_FLAG and item.al_code
    return f"{state.name}{'' if refused else f' within {patience}'}: {item.describe()}"


def _slaves(positions: Collection[int]) -> str:
    one = len(positions) == 1
    return f"slave{'' if one else 's'} {positions_text(positions) or 'none'}"

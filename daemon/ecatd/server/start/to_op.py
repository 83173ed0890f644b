"""Brings the slaves from PREOP to OP while the engine exchanges safe outputs.

If a slave loses its power meanwhile, the start goes on without it, and recovery brings it back when
it comes. If a slave refuses to go on, the start begins again without it: in the exchange it would
spoil the working counter, and so the values of others. Under the policy "strict", the start fails.
"""

from __future__ import annotations

from collections.abc import Callable

from ecatd.base.coroutine_steps import finish
from ecatd.base.errors import StateError
from ecatd.base.log import Log
from ecatd.etg.al import AlState
from ecatd.master.al_states import NotReachedError
from ecatd.master.engine.shared_memory import SharedMemory

from .clocks import Clocks
from .expectation import STARTS_OTHERS
from .found_bus import FoundBus
from .set_up import wait_for_outputs
from .slave_configuration import write_parameters

MAILBOX_PAUSE_S = 0.0005
"""Seconds between two rounds of frames while slaves answer over their mailboxes."""

_CLOCK_PAUSE = 0.01
"""Seconds between two reads of the state of SYNC signals."""


class LeftOutError(StateError):
    """Slaves refuse to go on, and the bus may start without them.

    Attributes:
        why: By position, why.
    """

    def __init__(self, message: str, why: dict[int, str]) -> None:
        super().__init__(message)
        self.why = why


class ToOp:
    """Brings the slaves of one start to OP.

    Args:
        found: The slaves.
        shared: The shared memory; the engine runs.
        clocks: The distributed clocks; None if they are not used.
        cancelled: Called while waiting; when it returns true, the start ends with `StateError`.
        log: The log for progress and warnings.
    """

    def __init__(
        self,
        found: FoundBus,
        shared: SharedMemory,
        clocks: Clocks | None,
        cancelled: Callable[[], bool],
        log: Log,
    ) -> None:
        self._found = found
        self._shared = shared
        self._clocks = clocks
        self._cancelled = cancelled
        self._log = log
        self._written: set[int] = set()  # slaves that have the parameters of SO

    def run(self) -> None:
        """Brings the slaves to OP.

        Raises:
            LeftOutError: Slaves do not reach it, and the bus may start without them.
            StateError: Slaves do not reach it.
        """
        self._repeat(self._synchronise)
        self._repeat(lambda: self._bring_to(AlState.SAFEOP))
        self._repeat(self._write_before_op)
        # Slaves need valid outputs before OP.
        patience = self._found.config.state_timeout
        finish(wait_for_outputs(self._shared, self._found.bus, patience, self._cancelled))
        self._repeat(lambda: self._bring_to(AlState.OP))

    def _repeat(self, step: Callable[[], None]) -> None:
        """Carries out a step. If slaves lose their power meanwhile, repeats it without them."""
        while True:
            try:
                step()
            except StateError as error:
                gone = [n for n in self._found.master.find_gone() if n not in self._found.lost]
                if not gone or self._cancelled():
                    raise
                self._drop(gone, error)
            else:
                return

    def _drop(self, gone: list[int], error: StateError) -> None:
        """Continues the start without the slaves that have gone.

        Raises:
            StateError: The bus must not start without one of them.
        """
        found = self._found
        must = [n for n in gone if found.must_be_there(n)]
        if must:
            raise StateError(
                f"{found.labels(must)} answered at first, but no longer: check power and cable "
                f"({STARTS_OTHERS})"
            ) from error
        found.lost.update(gone)
        self._log.warning(
            f"{found.labels(gone)} answered at first, but no longer: check power and cable; the "
            f"start goes on without {'it' if len(gone) == 1 else 'them'}",
            "slaves",
            gone,
        )

    def _synchronise(self) -> None:
        """Waits until all clocks are in step, and starts the SYNC signals."""
        clocks = self._clocks
        if clocks is None:
            return
        seconds = clocks.wait_for_lock(self._shared, self._cancelled, self._found.lost)
        count = sum(slave.position not in self._found.lost for slave in clocks.followers)
        self._log.of("dc").info(
            f"cycle and {count} clock{'s' * (count != 1)} follow that of "
            f"{clocks.reference.label} (after {seconds:.1f} s)"
        )
        here = {item.slave.position for item in self._found.present} - {*self._found.idle}
        failed = finish(clocks.sync_signals.start(self._shared, here), _CLOCK_PAUSE)
        if failed:
            raise self._refused(self._named(failed), failed)

    def _bring_to(self, state: AlState) -> None:
        """Brings all slaves to a state, except those that stay in PREOP.

        If an uncertain slave does not reach it, this is no error: recovery tries again later.
        """
        found = self._found
        out = {*found.idle, *found.absent, *found.missing}
        used = [n for n in range(len(found.bus.slaves)) if n not in out] if out else None
        patience = found.config.state_timeout
        try:
            found.master.al_states.wait_for(state, patience, used, optional=found.uncertain)
        except NotReachedError as error:
            why = {n: f"it does not reach {text}" for n, text in error.missed.items()}
            raise self._refused(str(error), why) from error

    def _named(self, why: dict[int, str]) -> str:
        slaves = self._found.bus.slaves
        return "; ".join(f"{slaves[n].label}: {text}" for n, text in why.items())

    def _refused(self, message: str, why: dict[int, str]) -> StateError:
        """The error about slaves that do not go on.

        If all slaves with process data are among them, there is nobody whom they could keep from
        OP, and what is wrong may be the exchange itself.
        """
        found = self._found
        others = [item for item in found.present if item.slave.outputs or item.slave.inputs]
        others = [item for item in others if item.slave.position not in why]
        if not others:
            return StateError(message)
        if any(map(found.must_be_there, why)):
            return StateError(f"{message} ({STARTS_OTHERS})")
        return LeftOutError(message, why)

    def _write_before_op(self) -> None:
        """Writes the start-up parameters of SO to all slaves but the uncertain ones.

        An uncertain slave must not keep the others from OP, and may be in PREOP.
        """
        found = self._found
        done = self._written | found.uncertain.keys()
        waiting = [item for item in found.present if item.slave.position not in done]
        texts, refused = finish(write_parameters(found.master, waiting, "SO"), MAILBOX_PAUSE_S)
        for text in texts:
            self._log.warning(text)
        self._written.update(item.slave.position for item in waiting)
        self._written -= refused.keys()
        if refused:
            why = {position: missed.text for position, missed in refused.items()}
            raise self._refused(self._named(why), why)

"""Takes the slaves from PREOP to OP while the engine exchanges safe outputs.

A slave that loses its power on this way counts as one that is lost later: the bus goes on without
it, and recovery brings it back when it comes, unless the policy says that it must be there.
"""

from __future__ import annotations

from collections.abc import Callable

from ecatd.coroutine_steps import finish
from ecatd.log import Log
from ecatd.model.al import AlState
from ecatd.model.errors import StateError

from ..engine.shared_memory import SharedMemory
from .clocks import Clocks
from .found import FoundBus
from .gone import find_gone
from .set_up import wait_for_outputs
from .telling import write_parameters

MAILBOX_PAUSE_S = 0.0005
"""Seconds between two rounds of frames while slaves answer over their mailboxes."""

_CLOCK_PAUSE = 0.01
"""Seconds between two reads of the state of SYNC signals."""


class ToOp:
    """The way of the slaves of one start to OP.

    Args:
        found: The slaves.
        shared: The shared memory; the engine runs.
        clocks: The distributed clocks, where they are used.
        cancelled: Called while waiting; when true, the start ends with `StateError`.
        log: Where it is told.
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
        self._told: set[int] = set()  # slaves that have their parameters of SO

    def run(self) -> None:
        """Takes them there.

        Raises:
            StateError: Slaves do not reach it.
        """
        self._insist(self._synchronise)
        self._insist(lambda: self._reach(AlState.SAFEOP))
        self._insist(self._tell_before_op)
        # Slaves need valid outputs before OP.
        timeout_s = self._found.config.state_timeout_s
        finish(wait_for_outputs(self._shared, self._found.bus, timeout_s, self._cancelled))
        self._insist(lambda: self._reach(AlState.OP))

    def _insist(self, step: Callable[[], None]) -> None:
        """Carries a step out; again without the slaves that have lost their power meanwhile."""
        while True:
            try:
                step()
            except StateError as error:
                gone = [n for n in find_gone(self._found.master) if n not in self._found.lost]
                if not gone or self._cancelled():
                    raise
                self._lose(gone, error)
            else:
                return

    def _lose(self, gone: list[int], error: StateError) -> None:
        """Goes on without slaves.

        Raises:
            StateError: One of them must be there.
        """
        found = self._found
        must = [n for n in gone if found.must_be_there(n)]
        if must:
            raise StateError(
                f"{found.labels(must)} answered at first, but no longer: check power and cable "
                '(policy = "tolerant" in [expected] or in a [[slave]] table starts the others)'
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
        here = {item.slave.position for item in self._found.present}
        failed = finish(clocks.sync_signals.start(self._shared, here), _CLOCK_PAUSE)
        for position, why in failed.items():
            raise StateError(f"{self._found.bus.slaves[position].label}: {why}")

    def _reach(self, state: AlState) -> None:
        """Takes all slaves to a state, except those that stay in PREOP.

        A doubtful slave that does not reach the state is no error: recovery takes care of it.
        """
        found = self._found
        out = {*found.idle, *found.absent, *found.missing}
        used = [n for n in range(len(found.bus.slaves)) if n not in out] if out else None
        timeout_s = found.config.state_timeout_s
        found.master.al_states.wait_for(state, timeout_s, used, optional=found.doubtful)

    def _tell_before_op(self) -> None:
        """Writes the start-up parameters of SO."""
        # A doubtful slave must not keep the others from OP, and may be in PREOP.
        found = self._found
        done = self._told | found.doubtful.keys()
        waiting = [item for item in found.present if item.slave.position not in done]
        told, refused = finish(write_parameters(found.master, waiting, "SO"), MAILBOX_PAUSE_S)
        for text in told:
            self._log.warning(text)
        self._told.update(item.slave.position for item in waiting)
        self._told -= refused.keys()
        if refused:
            raise StateError("; ".join(missed.text for missed in refused.values()))

"""AL state machine of a slave (ETG.1000.6 "EtherCAT state machine")."""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum

from ecatd.model.al import AL_ERROR_FLAG, AlState

_ACKNOWLEDGE = 0x10
_STATE_MASK = 0x0F


class AlCode(IntEnum):
    """AL status codes that a device reports."""

    NONE = 0x0000
    INVALID_CHANGE = 0x0011
    UNKNOWN_STATE = 0x0012
    NO_BOOTSTRAP = 0x0013
    MAILBOX = 0x0016
    NO_OUTPUTS = 0x0019
    WATCHDOG = 0x001B
    OUTPUTS = 0x001D
    INPUTS = 0x001E


class RefusedError(Exception):
    """A check of a state change failed.

    Attributes:
        code: The AL status code to report.
    """

    def __init__(self, code: int) -> None:
        super().__init__(f"AL status code 0x{code:04X}")
        self.code = code


_STEPS_UP = {
    (AlState.INIT, AlState.PREOP),
    (AlState.PREOP, AlState.SAFEOP),
    (AlState.SAFEOP, AlState.OP),
}


class StateMachine:
    """Decides on AL control requests and keeps AL status.

    Args:
        enter: Checks and carries out a change, called with the old and the new state. It returns
            whether the change is complete; if not, `finish` or `refuse` follows. It raises
            `RefusedError` before changing anything; a change to a lower state is never refused.
        publish: Called with the new AL status and AL status code.
    """

    def __init__(
        self,
        enter: Callable[[AlState, AlState], bool],
        publish: Callable[[int, int], None],
    ) -> None:
        self._enter = enter
        self._publish = publish
        self.state = AlState.INIT
        self.error = False
        self.pending: AlState | None = None

    def request(self, control: int) -> None:
        """Answers a value written to AL control."""
        wanted = control & _STATE_MASK
        if self.error and not control & _ACKNOWLEDGE and wanted > self.state:
            return  # an error must be acknowledged before the way up
        self.pending = None
        self.error = False
        try:
            target = AlState(wanted) if wanted else None
        except ValueError:
            target = None
        if target is None:
            self._refuse(AlCode.UNKNOWN_STATE)
        elif target == AlState.BOOT:
            in_init = self.state == AlState.INIT
            self._refuse(AlCode.NO_BOOTSTRAP if in_init else AlCode.INVALID_CHANGE)
        elif target > self.state and (self.state, target) not in _STEPS_UP:
            self._refuse(AlCode.INVALID_CHANGE)
        else:
            self._change(target)

    def finish(self) -> None:
        """What a pending change waited for has come."""
        if self.pending is not None:
            self.state, self.pending = self.pending, None
            self._publish(self.state, AlCode.NONE)

    def refuse(self, code: int) -> None:
        """Refuses a pending change."""
        if self.pending is not None:
            self.pending = None
            self._refuse(code)

    def fall_back(self, target: AlState, code: int) -> None:
        """Goes to a lower state by itself, with the error flag."""
        if target < self.state:
            self._enter(self.state, target)
            self.state = target
        self.pending = None
        self._refuse(code)

    def _change(self, target: AlState) -> None:
        try:
            complete = target == self.state or self._enter(self.state, target)
        except RefusedError as refusal:
            self._refuse(refusal.code)
            return
        if complete:
            self.state = target
            self._publish(target, AlCode.NONE)
        else:
            self.pending = target

    def _refuse(self, code: int) -> None:
        self.error = True
        self._publish(self.state | AL_ERROR_FLAG, code)

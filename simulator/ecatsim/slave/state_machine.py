"""The AL state machine of a slave (ETG.1000.6 "EtherCAT state machine")."""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum

from ecatd.etg.al import AL_ERROR_FLAG, AlState

_STATE_MASK = 0x0F
_ACKNOWLEDGE = 0x10
_IDENTIFY = 0x20  # in AL control: requests the device ID; in AL status: the ID is there


class AlCode(IntEnum):
    """The AL status codes that devices report (ETG.1000.6 table "AL status codes")."""

    NONE = 0x0000
    INVALID_CHANGE = 0x0011
    UNKNOWN_STATE = 0x0012
    NO_BOOTSTRAP = 0x0013
    NO_FIRMWARE = 0x0014
    BOOT_MAILBOX = 0x0015
    MAILBOX = 0x0016
    SYNC_MANAGERS = 0x0017
    NO_OUTPUTS = 0x0019
    SYNCHRONIZATION = 0x001A
    WATCHDOG = 0x001B
    OUTPUTS = 0x001D
    INPUTS = 0x001E
    WATCHDOG_SETTINGS = 0x001F
    INPUT_MAPPING = 0x0024
    OUTPUT_MAPPING = 0x0025
    SYNC_STOPPED = 0x002C
    NO_SYNC = 0x002D
    DC_SETTINGS = 0x0030
    DC_CYCLE_TIME = 0x0035
    SYNC0_CYCLE_TIME = 0x0036
    EEPROM_NO_ACCESS = 0x0050
    EEPROM_ERROR = 0x0051
    MODULES = 0x0070


class RefusedError(Exception):
    """A state change is refused.

    Attributes:
        code: The AL status code to report.
        diagnosis: Five bytes of data for the emergency that may be sent, see `emergency.refused`.
    """

    def __init__(self, code: int, diagnosis: bytes = b"") -> None:
        super().__init__(f"AL status code 0x{code:04X}")
        self.code = code
        self.diagnosis = diagnosis


_STEPS_UP = {
    (AlState.INIT, AlState.BOOT),
    (AlState.INIT, AlState.PREOP),
    (AlState.PREOP, AlState.SAFEOP),
    (AlState.SAFEOP, AlState.OP),
}


_EMULATED = (AlState.PREOP, AlState.SAFEOP, AlState.OP)


def _is_allowed(state: AlState, target: AlState) -> bool:
    """Whether ETG.1000.6 allows the transition; BOOT is entered from INIT and left to INIT."""
    if target == state or (state, target) in _STEPS_UP:
        return True
    if AlState.BOOT in (state, target):
        return target == AlState.INIT
    return target < state


class StateMachine:
    """Answers AL control requests and keeps the AL status.

    Args:
        enter: Checks and carries out a change; called with the old and the new state. It returns
            whether the change is complete; if not, a call of `finish` or `refuse` must follow. To
            refuse a change, it raises `RefusedError` before it changes anything. It never refuses a
            change to a lower state.
        publish: Called with each new AL status and AL status code.
        bootstrap: Whether the slave has the state BOOT.
        identification: Returns the device identification (explicit device ID, ETG.1020), or None if
            the device has none.

    Attributes:
        state: The AL state.
        error: Whether the error flag is set.
        pending: The requested state while a change to it is not complete, or None.
    """

    def __init__(
        self,
        enter: Callable[[AlState, AlState], bool],
        publish: Callable[[int, int], None],
        *,
        bootstrap: bool = False,
        identification: Callable[[], int | None] = lambda: None,
    ) -> None:
        self._enter = enter
        self._publish = publish
        self._bootstrap = bootstrap
        self._identification = identification
        self._identify = False
        self.state = AlState.INIT
        self.error = False
        self.pending: AlState | None = None

    def reset(self) -> None:
        """Returns to INIT as at power-on, without calling `enter`."""
        self.state = AlState.INIT
        self.error = self._identify = False
        self.pending = None
        self._report()

    def request(self, control: int) -> None:
        """Handles a value written to AL control (register 0x0120).

        The error flag stays until the master acknowledges it (bit 4) or requests a lower state.
        """
        wanted = control & _STATE_MASK
        if self.error and not control & _ACKNOWLEDGE and wanted >= self.state:
            return
        self.pending = None
        self.error = False
        self._identify = bool(control & _IDENTIFY)
        try:
            target = AlState(wanted or -1)
        except ValueError:
            self._refuse(AlCode.UNKNOWN_STATE)
            return
        if not _is_allowed(self.state, target):
            self._refuse(AlCode.INVALID_CHANGE)
        elif target == AlState.BOOT and not self._bootstrap:
            self._refuse(AlCode.NO_BOOTSTRAP)
        else:
            self._change(target)

    def follow(self, control: int) -> None:
        """Enters any state written to AL control, as an ESC with device emulation does.

        Nothing is checked, and AL status shows the acknowledge bit as well (register 0x0141, bit
        0).
        """
        wanted = control & _STATE_MASK
        target = AlState(wanted) if wanted in _EMULATED else AlState.INIT
        self.pending = None
        for step in _EMULATED:
            if self.state < step <= target:
                self._enter(self.state, step)
                self.state = step
        if target < self.state:
            self._enter(self.state, target)
            self.state = target
        self._publish(control & (_STATE_MASK | AL_ERROR_FLAG), AlCode.NONE)

    def finish(self) -> None:
        """Completes a pending change."""
        if self.pending is not None:
            self.state, self.pending = self.pending, None
            self._report()

    def refuse(self, code: int) -> None:
        """Refuses a pending change."""
        if self.pending is not None:
            self.pending = None
            self._refuse(code)

    def fall_back(self, target: AlState, code: int) -> None:
        """Goes to a lower state without a request, with the error flag."""
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
            self._report()
        else:
            self.pending = target

    def _refuse(self, code: int) -> None:
        self.error = True
        self._publish(self.state | AL_ERROR_FLAG, code)

    def _report(self) -> None:
        """Publishes a state without an error; the AL status code may then be the device ID."""
        number = self._identification() if self._identify else None
        if number is None:
            self._publish(self.state, AlCode.NONE)
        else:
            self._publish(self.state | _IDENTIFY, number)

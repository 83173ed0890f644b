"""Power state machine of a drive (CiA 402-2, IEC 61800-7-201 "Finite state automaton")."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

_SWITCH_ON, _ENABLE_VOLTAGE, _QUICK_STOP, _ENABLE_OPERATION = 0x01, 0x02, 0x04, 0x08
_FAULT_RESET = 0x80
_VOLTAGE_ENABLED = 0x0010
_STAYING, _CURRENT_LIMIT = (5, 6, 7), 3


class PowerState(IntEnum):
    """States; the value is that of bits 0 to 3, 5 and 6 of the status word."""

    NOT_READY = 0x00
    SWITCH_ON_DISABLED = 0x40
    READY_TO_SWITCH_ON = 0x21
    SWITCHED_ON = 0x23
    OPERATION_ENABLED = 0x27
    QUICK_STOP_ACTIVE = 0x07
    FAULT_REACTION = 0x0F
    FAULT = 0x08


@dataclass(slots=True)
class Options:
    """Option codes: how the drive stops before it leaves OPERATION ENABLED.

    0 switches off at once, 1 is the slow down ramp (0x6084), 2 the quick stop ramp (0x6085), 3 the
    current limit. 5, 6 and 7 brake like 1, 2 and 3, and the drive stays in QUICK STOP ACTIVE.
    Values beyond are of the manufacturer, and brake like 3.

    Attributes:
        quick_stop: 0x605A: 0 to 3, 5 to 7, or a value of the manufacturer.
        shutdown: 0x605B: 0 or 1.
        disable: 0x605C: 0 or 1.
        fault_reaction: 0x605E: 0 to 3.
    """

    quick_stop: int = 2
    shutdown: int = 0
    disable: int = 0
    fault_reaction: int = 2


class PowerStateMachine:
    """The power state machine, which follows the control word.

    Attributes:
        state: The state.
        options: The option codes.
        stopping: The way in which the motor is stopped now (1 slow down ramp, 2 quick stop ramp, 3
            current limit), or 0.
    """

    def __init__(self) -> None:
        self.state = PowerState.SWITCH_ON_DISABLED
        self.options = Options()
        self.stopping = 0
        self._after: PowerState | None = None  # state after the ramp
        self._last = 0

    def command(self, word: int, *, faulty: bool = False) -> None:
        """Makes the transition that a control word commands, if there is one.

        Args:
            word: The control word.
            faulty: Whether the cause of a fault remains, so that the fault cannot be reset.
        """
        reset = word & _FAULT_RESET and not self._last & _FAULT_RESET
        self._last = word
        if self.state == PowerState.FAULT:
            if reset and not faulty:
                self._enter(PowerState.SWITCH_ON_DISABLED)
        elif self.state not in (PowerState.FAULT_REACTION, PowerState.NOT_READY):
            self._follow(word)

    def fault(self, *, coast: bool = False) -> None:
        """Enters the fault state, after stopping the motor if it is moving and the option says so.

        Args:
            coast: Whether the drive can no longer stop the motor, and switches off at once.
        """
        moving = (PowerState.OPERATION_ENABLED, PowerState.QUICK_STOP_ACTIVE)
        reaction = 0 if coast else self.options.fault_reaction
        if self.state == PowerState.FAULT or (
            self.state == PowerState.FAULT_REACTION and not coast
        ):
            return
        if self.state in moving and reaction:
            self._stop(reaction, PowerState.FAULT_REACTION, PowerState.FAULT)
        else:
            self._enter(PowerState.FAULT)

    def standstill(self) -> None:
        """Reports that the motor has come to a standstill, which ends a ramp."""
        if self._after is not None:
            self._enter(self._after)

    @property
    def status(self) -> int:
        """The bits of the status word that depend on the state."""
        voltage = 0 if self.state == PowerState.NOT_READY else _VOLTAGE_ENABLED
        return self.state | voltage

    def _enter(self, state: PowerState) -> None:
        self.state, self._after, self.stopping = state, None, 0

    def _stop(self, how: int, state: PowerState, after: PowerState | None) -> None:
        self.state, self._after, self.stopping = state, after, how

    def _follow(self, word: int) -> None:
        state, s = self.state, PowerState
        if not word & _ENABLE_VOLTAGE:
            self._enter(s.SWITCH_ON_DISABLED)
        elif not word & _QUICK_STOP:
            self._quick_stop()
        elif state == s.QUICK_STOP_ACTIVE:
            wanted = _SWITCH_ON | _ENABLE_OPERATION
            if self.options.quick_stop in _STAYING and word & wanted == wanted:
                self._enter(s.OPERATION_ENABLED)  # transition 16
        elif not word & _SWITCH_ON:
            self._leave(s.READY_TO_SWITCH_ON, self.options.shutdown)
        elif state in (s.READY_TO_SWITCH_ON, s.SWITCHED_ON, s.OPERATION_ENABLED):
            if word & _ENABLE_OPERATION:
                self._enter(s.OPERATION_ENABLED)
            else:
                self._leave(s.SWITCHED_ON, self.options.disable)

    def _leave(self, target: PowerState, option: int) -> None:
        """Carries out shutdown or disable operation; with a ramp, the state changes after it."""
        if self.state == PowerState.OPERATION_ENABLED and option:
            self._stop(option, PowerState.OPERATION_ENABLED, target)
        else:
            self._enter(target)

    def _quick_stop(self) -> None:
        code = self.options.quick_stop
        if self.state == PowerState.OPERATION_ENABLED and code:
            after = None if code in _STAYING else PowerState.SWITCH_ON_DISABLED
            how = code - 4 if code in _STAYING else min(code, _CURRENT_LIMIT)
            self._stop(how, PowerState.QUICK_STOP_ACTIVE, after)
        elif self.state != PowerState.QUICK_STOP_ACTIVE:
            self._enter(PowerState.SWITCH_ON_DISABLED)

"""Power state machine of a drive (CiA 402-2, IEC 61800-7-201 "Finite state automaton")."""

from __future__ import annotations

from enum import IntEnum

_SWITCH_ON, _ENABLE_VOLTAGE, _QUICK_STOP, _ENABLE_OPERATION = 0x01, 0x02, 0x04, 0x08
_FAULT_RESET = 0x80
_VOLTAGE_ENABLED = 0x0010


class PowerState(IntEnum):
    """States; the value is bits 0 to 3, 5 and 6 of the status word."""

    NOT_READY = 0x00
    SWITCH_ON_DISABLED = 0x40
    READY_TO_SWITCH_ON = 0x21
    SWITCHED_ON = 0x23
    OPERATION_ENABLED = 0x27
    QUICK_STOP_ACTIVE = 0x07
    FAULT_REACTION = 0x0F
    FAULT = 0x08


class PowerStateMachine:
    """Follows the control word.

    Attributes:
        state: The state.
    """

    def __init__(self) -> None:
        self.state = PowerState.SWITCH_ON_DISABLED
        self._last = 0

    def command(self, word: int) -> None:
        """Makes the transition that a control word asks for, if there is one."""
        reset = word & _FAULT_RESET and not self._last & _FAULT_RESET
        self._last = word
        if self.state == PowerState.FAULT:
            if reset:
                self.state = PowerState.SWITCH_ON_DISABLED
        elif self.state not in (PowerState.FAULT_REACTION, PowerState.NOT_READY):
            self._follow(word)

    def fault(self) -> None:
        """The drive detected a fault; it stops the motor first if that is enabled."""
        moving = (PowerState.OPERATION_ENABLED, PowerState.QUICK_STOP_ACTIVE)
        self.state = PowerState.FAULT_REACTION if self.state in moving else PowerState.FAULT

    def standstill(self) -> None:
        """The motor stands still after a quick stop or a fault reaction."""
        if self.state == PowerState.QUICK_STOP_ACTIVE:
            self.state = PowerState.SWITCH_ON_DISABLED
        elif self.state == PowerState.FAULT_REACTION:
            self.state = PowerState.FAULT

    @property
    def status(self) -> int:
        """The bits of the status word that the state decides."""
        voltage = 0 if self.state == PowerState.NOT_READY else _VOLTAGE_ENABLED
        return self.state | voltage

    def _follow(self, word: int) -> None:
        state, s = self.state, PowerState
        if not word & _ENABLE_VOLTAGE:
            self.state = s.SWITCH_ON_DISABLED
        elif not word & _QUICK_STOP:
            if state == s.OPERATION_ENABLED:
                self.state = s.QUICK_STOP_ACTIVE
            elif state != s.QUICK_STOP_ACTIVE:
                self.state = s.SWITCH_ON_DISABLED
        elif state == s.QUICK_STOP_ACTIVE:
            return  # with option code 2 the way out is through SWITCH_ON_DISABLED
        elif not word & _SWITCH_ON:
            self.state = s.READY_TO_SWITCH_ON
        elif state in (s.READY_TO_SWITCH_ON, s.SWITCHED_ON, s.OPERATION_ENABLED):
            on = word & _ENABLE_OPERATION
            self.state = s.OPERATION_ENABLED if on else s.SWITCHED_ON

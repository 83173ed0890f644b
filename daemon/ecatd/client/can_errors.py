"""Error frames of Linux (`linux/can/error.h`): what a record of a CAN channel is as one."""

from __future__ import annotations

from ecatd.shm.contract import CanKind, CanState

from .can import CanFrame

# Bits of the identifier.
_TX_TIMEOUT, _CONTROLLER, _BUS_OFF, _RESTARTED, _COUNTERS = 0x1, 0x4, 0x40, 0x100, 0x200
# Bits of byte 1 of the data, where the controller is concerned.
_RX_OVERFLOW, _RX_WARNING, _TX_WARNING, _RX_PASSIVE, _TX_PASSIVE, _ACTIVE = 1, 4, 8, 16, 32, 64
_STATES = {
    CanState.ACTIVE: (_ACTIVE, _ACTIVE),
    CanState.WARNING: (_TX_WARNING, _RX_WARNING),
    CanState.PASSIVE: (_TX_PASSIVE, _RX_PASSIVE),
}
"""Byte 1 by state, if the counter for sending is the larger one, and if that for receiving is."""


def error_frame(found: CanFrame) -> tuple[int, bytes]:
    """Identifier, without the flag of error frames, and data of a record that is no frame."""
    if found.kind == CanKind.STATE:
        identifier, data = _of_state(found)
    elif found.kind == CanKind.OVERFLOW:
        identifier, data = _CONTROLLER, bytes([0, _RX_OVERFLOW])
    else:
        identifier, data = _TX_TIMEOUT, b""
    return identifier, data.ljust(8, b"\0")


def _of_state(found: CanFrame) -> tuple[int, bytes]:
    state, sending, receiving = found.state
    counters = bytes([0, 0, 0, 0, sending, receiving])
    if state in _STATES:
        mine = _STATES[state][0 if sending >= receiving else 1]
        return _CONTROLLER | _COUNTERS, bytes([0, mine]) + counters
    if state == CanState.BUS_OFF:
        return _BUS_OFF | _COUNTERS, bytes(2) + counters
    return _RESTARTED, b""

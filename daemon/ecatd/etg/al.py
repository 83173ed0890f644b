"""AL states and AL status codes (ETG.1000.6, registers 0x0120, 0x0130 and 0x0134)."""

from __future__ import annotations

from enum import IntEnum

from ecatd.base.errors import UsageError


class AlState(IntEnum):
    """AL state of a slave; the value is that of bits 0 to 3 of the AL status register (0x0130)."""

    NONE = 0  # no answer: the slave is not reachable
    INIT = 1
    PREOP = 2
    BOOT = 3
    SAFEOP = 4
    OP = 8

    @classmethod
    def parse(cls, text: str) -> AlState:
        """Parses the name of a state: in any case, also with "-" or "_" as in `SAFE-OP`.

        Raises:
            UsageError: The text names no state that can be requested.
        """
        try:
            state = cls[text.upper().replace("-", "").replace("_", "")]
        except KeyError:
            state = cls.NONE
        if state is cls.NONE:
            raise UsageError(
                f"{text[:40]!r} is not an AL state: use INIT, PREOP, BOOT, SAFEOP or OP"
            )
        return state


AL_ERROR_FLAG = 0x10
"""Bit of the AL status register: the slave refused a state, or left its state by itself."""

AL_WATCHDOG = 0x001B
"""AL status code of a slave whose watchdog has expired: it got no process data for too long."""

AL_SYNCHRONIZATION = frozenset((0x001A, 0x002C, 0x002D, 0x0032, 0x0033, 0x0034, 0x0035))
"""AL status codes of slaves for which clocks or SYNC signals were missing or late."""

_NEEDS_SET_UP = frozenset((0x0021, 0x0022, 0x0023, 0x0060))
_FROM_OUTSIDE = frozenset((0x0000, 0x0018, 0x0019, AL_WATCHDOG, 0x002A, 0x002B, 0x0052))


def comes_from_outside(code: int) -> bool:
    """Whether an AL status code has a cause outside the slave, so that OP can be requested again.

    The slave lacked frames, clocks or SYNC signals, which can come back, or must be set up again.
    All other codes, also reserved ones and those of vendors, have a cause in the slave, which a new
    request does not change.
    """
    return code in _FROM_OUTSIDE or code in AL_SYNCHRONIZATION or needs_set_up(code)


def needs_set_up(code: int) -> bool:
    """Whether an AL status code means that the slave must be set up again from a lower state."""
    return code in _NEEDS_SET_UP


def al_remedy(code: int) -> str:
    """What a user can do about a slave that recovery leaves alone, by its AL status code."""
    if code in (0x0016, 0x0017, 0x001C, 0x001D, 0x001E, 0x0024, 0x0025, 0x0070):
        return (
            "its process data differ from those that were set up: compare `ecatctl pdos` with "
            "its manual"
        )
    if code in (0x001F, 0x0026, 0x0027, 0x0028, 0x0029, 0x002E, 0x0030, 0x0031, 0x0036, 0x0037):
        return "it refuses its settings: compare cycle, watchdog and [dc] with its manual"
    if code in (0x0006, 0x0050, 0x0051):
        return "its EEPROM is damaged or of another firmware: see its manual"
    if code == 0x0020:
        return "switch it off and on"
    return "look up the code in its manual, and correct what the manual says"


def al_state_text(register: int) -> str:
    """The AL status register in words, for example `SAFEOP+ERROR`."""
    if register & 0x0F == AlState.NONE:
        return "no answer"
    try:
        name = AlState(register & 0x0F).name
    except ValueError:
        name = f"0x{register & 0x0F:X}"
    return name + ("+ERROR" if register & AL_ERROR_FLAG else "")


_STATUS_TEXTS = {
    0x0000: "No error",
    0x0001: "Unspecified error",
    0x0002: "No memory",
    0x0003: "Invalid device setup",
    0x0006: "SII or EEPROM information does not match the firmware",
    0x0007: "Firmware update not successful",
    0x000E: "License error",
    0x0011: "Invalid requested state change",
    0x0012: "Unknown requested state",
    0x0013: "Bootstrap not supported",
    0x0014: "No valid firmware",
    0x0015: "Invalid mailbox configuration (BOOT)",
    0x0016: "Invalid mailbox configuration (PREOP)",
    0x0017: "Invalid sync manager configuration",
    0x0018: "No valid inputs available",
    0x0019: "No valid outputs",
    0x001A: "Synchronization error",
    0x001B: "Sync manager watchdog",
    0x001C: "Invalid sync manager types",
    0x001D: "Invalid output configuration",
    0x001E: "Invalid input configuration",
    0x001F: "Invalid watchdog configuration",
    0x0020: "Slave needs cold start",
    0x0021: "Slave needs INIT",
    0x0022: "Slave needs PREOP",
    0x0023: "Slave needs SAFEOP",
    0x0024: "Invalid input mapping",
    0x0025: "Invalid output mapping",
    0x0026: "Inconsistent settings",
    0x0027: "Free run not supported",
    0x0028: "Synchronization mode not supported",
    0x0029: "Free run needs three-buffer mode",
    0x002A: "Background watchdog",
    0x002B: "No valid inputs and outputs",
    0x002C: "Fatal synchronization error",
    0x002D: "No synchronization error: SYNC signal not received",
    0x002E: "Cycle time too small",
    0x0030: "Invalid DC SYNC configuration",
    0x0031: "Invalid DC latch configuration",
    0x0032: "PLL error",
    0x0033: "DC synchronization: I/O error",
    0x0034: "DC synchronization: timeout",
    0x0035: "DC: invalid SYNC cycle time",
    0x0036: "DC: SYNC0 cycle time does not fit the application",
    0x0037: "DC: SYNC1 cycle time does not fit the application",
    0x0041: "Mailbox: AoE error",
    0x0042: "Mailbox: EoE error",
    0x0043: "Mailbox: CoE error",
    0x0044: "Mailbox: FoE error",
    0x0045: "Mailbox: SoE error",
    0x004F: "Mailbox: VoE error",
    0x0050: "EEPROM not accessible from the slave's controller",
    0x0051: "EEPROM error",
    0x0052: "External hardware not ready",
    0x0060: "Slave restarted locally",
    0x0061: "Device identification value updated",
    0x0070: "Detected module list does not match",
    0x00F0: "Application controller available",
}


def al_status_text(code: int) -> str:
    """The standard text of an AL status code."""
    if code >= 0x8000:
        return "vendor-specific error; see the manual of the slave"
    return _STATUS_TEXTS.get(code, "reserved code; see the manual of the slave")

"""SDO abort codes (ETG.1000.6 and CiA 301, "SDO abort codes")."""

from __future__ import annotations

from ecatd.base.errors import SdoAbortError

TOGGLE = 0x05030000
TIMED_OUT = 0x05040000
INVALID_COMMAND = 0x05040001
OUT_OF_MEMORY = 0x05040005
UNSUPPORTED_ACCESS = 0x06010000
WRITE_ONLY = 0x06010001
READ_ONLY = 0x06010002
COUNT_NOT_ZERO = 0x06010003
NO_COMPLETE_ACCESS = 0x06010004
NO_OBJECT = 0x06020000
NOT_MAPPABLE = 0x06040041
PDO_LENGTH = 0x06040042
PARAMETER_INCOMPATIBLE = 0x06040043
INTERNAL_INCOMPATIBLE = 0x06040047
LENGTH_MISMATCH = 0x06070010
LENGTH_TOO_HIGH = 0x06070012
LENGTH_TOO_LOW = 0x06070013
NO_SUBINDEX = 0x06090011
VALUE_RANGE = 0x06090030
VALUE_TOO_HIGH = 0x06090031
VALUE_TOO_LOW = 0x06090032
GENERAL = 0x08000000
CANNOT_TRANSFER = 0x08000020
LOCAL_CONTROL = 0x08000021
DEVICE_STATE = 0x08000022

_TEXTS = {
    TOGGLE: "Toggle bit not changed",
    TIMED_OUT: "SDO protocol timeout",
    INVALID_COMMAND: "Client or server command specifier not valid or unknown",
    OUT_OF_MEMORY: "Out of memory",
    UNSUPPORTED_ACCESS: "Unsupported access to an object",
    WRITE_ONLY: "Attempt to read a write-only object",
    READ_ONLY: "Attempt to write a read-only object",
    COUNT_NOT_ZERO: "Subindex cannot be written, subindex 0 must be 0 for write access",
    NO_COMPLETE_ACCESS: "Complete access not supported for this object",
    0x06010005: "Object length exceeds mailbox size",
    0x06010006: "Object mapped to RxPDO, SDO download blocked",
    NO_OBJECT: "The object does not exist in the object dictionary",
    NOT_MAPPABLE: "The object cannot be mapped to the PDO",
    PDO_LENGTH: "The number and length of the mapped objects would exceed the PDO length",
    PARAMETER_INCOMPATIBLE: "General parameter incompatibility",
    INTERNAL_INCOMPATIBLE: "General internal incompatibility in the device",
    0x06060000: "Access failed due to a hardware error",
    LENGTH_MISMATCH: "Data type does not match, length of service parameter does not match",
    LENGTH_TOO_HIGH: "Data type does not match, length of service parameter too high",
    LENGTH_TOO_LOW: "Data type does not match, length of service parameter too low",
    NO_SUBINDEX: "Subindex does not exist",
    VALUE_RANGE: "Value range of parameter exceeded",
    VALUE_TOO_HIGH: "Value of parameter written too high",
    VALUE_TOO_LOW: "Value of parameter written too low",
    0x06090036: "Maximum value is less than minimum value",
    GENERAL: "General error",
    CANNOT_TRANSFER: "Data cannot be transferred or stored to the application",
    LOCAL_CONTROL: "Data cannot be transferred or stored because of local control",
    DEVICE_STATE: "Data cannot be transferred or stored because of the present device state",
    0x08000023: "Object dictionary dynamic generation failed or no object dictionary is present",
}


def abort_text(code: int) -> str:
    """The standard text of an abort code; for other codes a text that says so."""
    return _TEXTS.get(code, "not a standard abort code; see the manual of the slave")


def abort_error(code: int, message: str = "") -> SdoAbortError:
    """The error of an abort, with the text of its code; its message says more, if there is one."""
    return SdoAbortError(code, message, abort_text(code))

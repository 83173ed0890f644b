"""Error codes of slaves in words (ETG.1000.6; those of SDOs and emergencies also in CiA 301).

SDO abort codes, error codes of emergencies, and those of FoE.
"""

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

_ABORT_TEXTS = {
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


_ABORT_ADVICE = {
    "`ecatctl sdos SLAVE` lists the objects of the slave": (NO_OBJECT, NO_SUBINDEX),
    "`ecatctl sdos SLAVE OBJECT` shows which values it takes and who may read and write it": (
        *(READ_ONLY, WRITE_ONLY, UNSUPPORTED_ACCESS, COUNT_NOT_ZERO),
        *(LENGTH_MISMATCH, LENGTH_TOO_HIGH, LENGTH_TOO_LOW),
        *(VALUE_RANGE, VALUE_TOO_HIGH, VALUE_TOO_LOW),
    ),
    "read or write its subindices one by one": (NO_COMPLETE_ACCESS,),
    "many slaves allow this in PREOP only": (DEVICE_STATE, LOCAL_CONTROL, CANNOT_TRANSFER),
    "try again": (TOGGLE, TIMED_OUT),
    "the manual of the slave says when it refuses this": (
        *(PARAMETER_INCOMPATIBLE, INTERNAL_INCOMPATIBLE, GENERAL),
    ),
}


def abort_advice(code: int) -> str:
    """What somebody does next who has asked by hand; empty if there is nothing to say."""
    return next((advice for advice, codes in _ABORT_ADVICE.items() if code in codes), "")


def abort_text(code: int) -> str:
    """The standard text of an abort code; for other codes a text that says so."""
    return _ABORT_TEXTS.get(code, "not a standard abort code; see the manual of the slave")


def abort_error(code: int, message: str = "") -> SdoAbortError:
    """The error of an abort, with the text of its code; its message says more, if there is one."""
    return SdoAbortError(code, message, abort_text(code))


ERROR_CLASSES = {
    0x00: "error reset",
    0x10: "generic error",
    0x20: "current",
    0x21: "current, input side",
    0x22: "current inside the device",
    0x23: "current, output side",
    0x30: "voltage",
    0x31: "mains voltage",
    0x32: "voltage inside the device",
    0x33: "output voltage",
    0x40: "temperature",
    0x41: "ambient temperature",
    0x42: "device temperature",
    0x50: "device hardware",
    0x60: "device software",
    0x61: "internal software",
    0x62: "user software",
    0x63: "data set",
    0x70: "additional modules",
    0x80: "monitoring",
    0x81: "communication",
    0x82: "protocol error",
    0x90: "external error",
    0xA0: "state change refused",
    0xF0: "additional functions",
    0xFF: "device specific",
}
"""By the upper byte of an error code. Device profiles give a meaning to the lower byte."""


def error_class(code: int) -> str:
    """The class of an error code, such as `temperature`."""
    high = code >> 8
    main = high & 0xF0 or high  # 0x01 to 0x0F are no subclasses of "error reset"
    return ERROR_CLASSES.get(high) or ERROR_CLASSES.get(main, "unknown class")


def error_code_text(code: int) -> str:
    """An error code with its class: `error code 0x4210 (device temperature)`."""
    return f"error code 0x{code:04X} ({error_class(code)})"


def emergency_text(code: int, register: int) -> str:
    """What an emergency says: its error code and the error register (object 0x1001)."""
    return f"{error_code_text(code)}, error register 0x{register:02X}"


_FOE_FIRST = 0x8000
"""Older slaves leave this bit out."""

_FOE_TEXTS = {
    0x8000: "no further reason",
    0x8001: "it has no such file",
    0x8002: "access to this file is denied",
    0x8003: "it has no room for the file",
    0x8004: "the operation is not allowed now",
    0x8005: "the number of the packet is wrong",
    0x8006: "the file exists already",
    0x8007: "no such user",
    0x8008: "it takes this file in BOOT only",
    0x8009: "it does not take this file in BOOT",
    0x800A: "the password is wrong",
    0x800B: "an error in its program",
    0x800C: "the checksum in the file is wrong",
    0x800D: "the firmware is for other hardware",
    0x800F: "it has no such file",
    0x8010: "the header of the file is missing or wrong",
    0x8011: "its flash memory cannot be written",
}
_FOE_ADVICE = {
    0x8001: "check the name, also with or without its ending",
    0x8002: "it may want a password (--password), or the state BOOT (--boot)",
    0x8008: "add --boot",
    0x8009: "leave --boot out, or give the name that the manual of the slave says (--as)",
    0x800A: "give it with --password",
    0x800D: "the manual of the slave says which file fits",
    0x800F: "check the name, also with or without its ending",
}


def foe_text(code: int) -> str:
    """An error code in words, with advice if there is any."""
    known = code | _FOE_FIRST
    text = _FOE_TEXTS.get(known, "a code that the standard does not define")
    return f"{text}: {_FOE_ADVICE[known]}" if known in _FOE_ADVICE else text

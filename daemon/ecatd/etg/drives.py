"""Objects, bits and error codes of drives (CiA 402, which is IEC 61800-7-201)."""

from __future__ import annotations

from collections.abc import Mapping

from .error_codes import error_class

STATUSWORD, ERROR_CODE = 0x6041, 0x603F
AXES = 8
AXIS_OBJECTS = 0x800
"""Distance between the objects of two axes: the second axis begins at 0x6800 (ETG.6010)."""

OBJECTS_OF_ERRORS: Mapping[int, tuple[tuple[int, int], ...]] = {
    0x2310: ((0x6073, 0), (0x6075, 0)),
    0x2350: ((0x6073, 0), (0x6075, 0)),
    0x3210: ((0x6079, 0),),
    0x3220: ((0x6079, 0),),
    0x7121: ((0x6072, 0), (0x6073, 0)),
    0x8311: ((0x6072, 0), (0x6076, 0)),
    0x8611: ((0x6065, 0), (0x6066, 0)),
    0x8612: ((0x607D, 1), (0x607D, 2)),
}
"""Objects of the first axis that say when a drive reports an error code, or what it has measured.

Of each code those whose description in CiA 402-2 (IEC 61800-7-201) is about the quantity of the
code: max current and motor rated current, DC link circuit voltage, max torque and motor rated
torque, following error window and time out, software position limits."""

_STATE_MASK = 0x4F
_FAULTS = (0x08, 0x0F)
"""Fault, and fault reaction active."""

ERROR_TEXTS = {
    0x2310: "continuous overcurrent",
    0x2320: "short circuit or earth leakage",
    0x2330: "earth leakage",
    0x2340: "short circuit",
    0x2350: "load too high for too long (I²t)",
    0x3110: "mains overvoltage",
    0x3120: "mains undervoltage",
    0x3130: "phase failure",
    0x3210: "overvoltage of the DC link",
    0x3220: "undervoltage of the DC link",
    0x4210: "device too hot",
    0x4310: "drive too hot",
    0x6320: "wrong parameter",
    0x7121: "motor blocked",
    0x7122: "motor or commutation",
    0x7305: "first encoder",
    0x8311: "torque too high",
    0x8611: "following error: it lags behind its target by more than its window, object 0x6065",
    0x8612: "target beyond its limits",
}


def is_fault(statusword: int) -> bool:
    """Whether a drive with this statusword is in Fault, or on the way there."""
    return statusword & _STATE_MASK in _FAULTS


def error_text(code: int) -> str:
    """An error code of object 0x603F in words."""
    return f"error code 0x{code:04X} ({ERROR_TEXTS.get(code) or error_class(code)})"

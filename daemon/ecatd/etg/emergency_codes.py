"""Error codes of emergencies (CiA 301 and ETG.1000.6, "Emergency error codes"), in words."""

from __future__ import annotations

_CLASSES = {
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
    return _CLASSES.get(high) or _CLASSES.get(main, "unknown class")


def error_code_text(code: int) -> str:
    """An error code with its class: `error code 0x4210 (device temperature)`."""
    return f"error code 0x{code:04X} ({error_class(code)})"


def emergency_text(code: int, register: int) -> str:
    """What an emergency says: its error code and the error register (object 0x1001)."""
    return f"{error_code_text(code)}, error register 0x{register:02X}"

"""Error codes of FoE (ETG.1000.6, "FoE error"), in words."""

from __future__ import annotations

_FIRST = 0x8000
"""Older slaves leave this bit out."""

_TEXTS = {
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
_ADVICE = {
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
    known = code | _FIRST
    text = _TEXTS.get(known, "a code that the standard does not define")
    return f"{text}: {_ADVICE[known]}" if known in _ADVICE else text

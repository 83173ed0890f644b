"""Addresses as people write them: objects of slaves, and registers of slave controllers.

Commands, configuration, keys over Zenoh and names of signals all have the same notation:

- With a colon both parts are hexadecimal, as in ESI files and in all our output: `0x6000:11` and
  `6000:11` are index 0x6000, subindex 17.
- A part that stands alone is hexadecimal with `0x`, or decimal. Vendors print addresses in
  hexadecimal, so a bare number such as 6060 may be meant as 0x6060 or as 0x17AC. Where both are
  possible, ecatd asks which one, in place of using one of them.
"""

from __future__ import annotations

import re

from .errors import UsageError

INDEX_MOST, SUBINDEX_MOST, REGISTER_MOST = 0xFFFF, 0xFF, 0xFFFF
_PAIR = re.compile(r"(?:0[xX])?([0-9A-Fa-f]{1,4}):(?:0[xX])?([0-9A-Fa-f]{1,2})")
_HEXADECIMAL = re.compile(r"0[xX]([0-9A-Fa-f]{1,8})")
_DECIMAL = re.compile(r"[0-9]{1,10}")
_DIGITS = re.compile(r"[0-9A-Fa-f]{1,8}")


def address_text(index: int, subindex: int) -> str:
    """The address of an object as it is always printed: `0x6060:00`."""
    return f"0x{index:04X}:{subindex:02X}"


def parse_address(text: str) -> tuple[int, int] | None:
    """Parses an address with a colon, `0x60FF:00` or `60FF:00`.

    Returns:
        Index and subindex; None if the text is no such address.
    """
    match = _PAIR.fullmatch(text)
    return (int(match[1], 16), int(match[2], 16)) if match else None


def parse_number(text: str, what: str, most: int) -> int:
    """Parses an index, a subindex or the address of a register that stands alone.

    Args:
        text: `0x` and hexadecimal digits, or decimal digits.
        what: What it is, for the message: "index".
        most: The largest possible number.

    Raises:
        UsageError: It is no number, too large, or a bare number with two possible readings.
    """
    digits = len(f"{most:X}")
    if match := _HEXADECIMAL.fullmatch(text):
        value = int(match[1], 16)
        if value > most:
            raise UsageError(f"{text} is not a possible {what}: use 0x0 to 0x{most:X}")
        return value
    if not _DECIMAL.fullmatch(text):
        hint = ""
        if _DIGITS.fullmatch(text) and int(text, 16) <= most:
            hint = f"; if it is hexadecimal, write 0x{text.upper():0>{digits}}"
        raise UsageError(
            f"'{text[:40]}' is not a possible {what}: write a number, decimal or with 0x in "
            f"front{hint}"
        )
    value = int(text)
    if value > most:
        raise UsageError(f"{text} is not a possible {what}: use 0 to {most}")
    as_hexadecimal = int(text, 16)
    if value != as_hexadecimal <= most:
        raise UsageError(
            f"the {what} {text} can be 0x{as_hexadecimal:0{digits}X} or, read as a decimal number, "
            f"0x{value:0{digits}X}: write the one that you mean"
        )
    return value

"""Draws the course of a signal with Braille characters (Unicode U+2800): two columns, four rows.

The console of a machine without a desktop has no Braille: there it is one column of two rows.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from .glyphs import IS_CONSOLE

_BRAILLE = ((0x40, 0x04, 0x02, 0x01), (0x80, 0x20, 0x10, 0x08))
"""Bits of the dots of a character, by column, from below."""
STEPS = 1 if IS_CONSOLE else 2
"""Columns of a character."""
_BLOCKS = " ▄▀█"
"""Characters by their halves: bit 0 the lower one, bit 1 the upper one."""

Range = tuple[float, float] | None
"""Minimum and maximum in a piece of time; None if there was no value that can be trusted."""


def gather(values: Iterable[Range]) -> Range:
    """Minimum and maximum of some pieces together."""
    known = [value for value in values if value is not None]
    return (min(low for low, _ in known), max(high for _, high in known)) if known else None


def sparkline(values: Sequence[Range], width: int, *, braille: bool = not IS_CONSOLE) -> str:
    """The last values in a line, the newest at the right; each column has all from low to high.

    So a peak of one cycle is seen, however short it is.

    Args:
        values: Minima and maxima.
        width: Number of characters.
        braille: Whether the terminal has Braille characters.
    """
    dots = _BRAILLE if braille else ((1, 2),)
    rows, columns = len(dots[0]), len(dots)
    shown: list[Range] = list(values)[-columns * width :] if width else []
    shown = [*[None] * (columns * width - len(shown)), *shown]
    whole = gather(shown)
    if whole is None:
        return " " * width
    low, span = whole[0], whole[1] - whole[0]

    def level(value: float) -> int:
        return round((value - low) / span * (rows - 1)) if span > 0 else (rows - 1) // 2

    text = ""
    for place in range(0, columns * width, columns):
        bits = 0
        for column in range(columns):
            if (part := shown[place + column]) is not None:
                for row in range(level(part[0]), level(part[1]) + 1):
                    bits |= dots[column][row]
        text += (chr(0x2800 + bits) if bits else " ") if braille else _BLOCKS[bits]
    return text

"""Draws the course of a signal with Braille characters (Unicode U+2800): two columns, four rows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

_DOTS = ((0x40, 0x04, 0x02, 0x01), (0x80, 0x20, 0x10, 0x08))
"""Bits of the dots of a character, by column, from below."""
_HEIGHT = 4

Range = tuple[float, float] | None
"""Minimum and maximum in a piece of time; None if there was no value that can be trusted."""


def gather(values: Iterable[Range]) -> Range:
    """Minimum and maximum of some pieces together."""
    known = [value for value in values if value is not None]
    return (min(low for low, _ in known), max(high for _, high in known)) if known else None


def sparkline(values: Sequence[Range], width: int) -> str:
    """The last values in a line, the newest at the right; each column has all from low to high.

    So a peak of one cycle is seen, however short it is.

    Args:
        values: Minima and maxima.
        width: Number of characters.
    """
    shown: list[Range] = list(values)[-2 * width :]
    shown = [*[None] * (2 * width - len(shown)), *shown]
    whole = gather(shown)
    if whole is None:
        return " " * width
    low, span = whole[0], whole[1] - whole[0]

    def level(value: float) -> int:
        return round((value - low) / span * (_HEIGHT - 1)) if span > 0 else 1

    text = ""
    for place in range(0, 2 * width, 2):
        bits = 0
        for column in (0, 1):
            if (part := shown[place + column]) is not None:
                for row in range(level(part[0]), level(part[1]) + 1):
                    bits |= _DOTS[column][row]
        text += chr(0x2800 + bits) if bits else " "
    return text

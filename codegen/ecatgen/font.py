"""Widths of texts in Helvetica and in fonts with the same widths: Arial and Liberation Sans."""

from __future__ import annotations

FAMILY = "Arial, 'Liberation Sans', Helvetica, sans-serif"
LINE = 1.15
"""Height of a line, in units of the font size."""
MIDDLE = 0.358
"""Height of the middle of capital letters above the base line, in units of the font size."""

# Widths in 1/1000 of the font size, from the space to the tilde.
_REGULAR = """
278 278 355 556 556 889 667 191 333 333 389 584 278 333 278 278 556 556 556 556 556 556 556 556
556 556 278 278 584 584 584 556 1015 667 667 722 722 667 611 778 722 278 500 667 556 833 722 778
667 778 722 667 611 722 667 944 667 667 611 278 278 278 469 556 333 556 556 500 556 556 278 556
556 222 222 500 222 833 556 556 556 556 333 500 278 556 500 722 500 500 500 334 260 334 584
"""
_BOLD = """
278 333 474 556 556 889 722 238 333 333 389 584 278 333 278 278 556 556 556 556 556 556 556 556
556 556 333 333 584 584 584 611 975 722 722 722 722 667 611 778 722 278 556 722 611 833 722 778
667 778 722 667 611 722 667 944 667 667 611 333 278 333 584 556 333 556 611 556 611 556 333 611
611 278 278 556 278 889 611 611 611 611 389 556 333 611 556 778 556 556 500 389 280 389 584
"""
_WIDTHS = {False: tuple(map(int, _REGULAR.split())), True: tuple(map(int, _BOLD.split()))}
_LATIN, _WIDE = 556, 1000  # widths of letters with accents, and of letters of East Asia


def width(text: str, *, bold: bool = False) -> float:
    """Returns the width of one line of text, in units of the font size."""
    widths = _WIDTHS[bold]
    return (
        sum(
            widths[ord(c) - 32] if " " <= c <= "~" else _LATIN if c < "\u2e80" else _WIDE
            for c in text
        )
        / 1000
    )


def fitted(text: str, box_width: float, box_height: float, *, bold: bool = False) -> float:
    """Returns the largest font size at which a text fits into a box; width 0 means any width."""
    lines = text.split("\n")
    size = box_height / (LINE * len(lines))
    widest = max(width(line, bold=bold) for line in lines)
    return min(size, box_width / widest) if widest and box_width else size

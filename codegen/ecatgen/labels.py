"""Shortens names for icons, so that blocks get a sensible width."""

from __future__ import annotations

import re
from functools import lru_cache

from .font import width

WIDEST = 15.0
"""Widest label, in units of the font size."""

ELLIPSIS = "…"
_SHORTEST = 3  # letters of a word that are always kept
_WORD = re.compile(r"[A-Z]+(?![a-z])[0-9_]*|[A-Za-z][a-z]*[0-9_]*|[0-9_]+")


@lru_cache(maxsize=4096)  # equal slaves have equal names
def label(name: str) -> str:
    """Returns the name, with its longest words cut if it is too long for a label.

    Numbers stay, since they distinguish channels: `aiStandardChannel12StatusUnderrange` becomes
    `aiStandardChannel12StatusUnd…`.

    Args:
        name: A name in camel case.
    """
    words = _WORD.findall(name)
    cut = [0] * len(words)  # letters taken from the end of each word

    def text() -> str:
        return "".join(map(_shortened, words, cut))

    def left(n: int) -> int:
        return len(words[n].rstrip("0123456789_")) - cut[n]

    for n in sorted(range(len(words)), key=left, reverse=True):
        while left(n) > _SHORTEST and width(text()) > WIDEST:
            cut[n] += 1
    short = text()
    while width(short) > WIDEST:
        middle = len(short) // 2
        short = short[: middle - 1] + ELLIPSIS + short[middle + 1 :]
    return short


def _shortened(word: str, cut: int) -> str:
    if not cut:
        return word
    letters = word.rstrip("0123456789_")
    return letters[: len(letters) - cut] + ELLIPSIS + word[len(letters) :]

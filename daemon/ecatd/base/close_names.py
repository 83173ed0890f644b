"""Suggests the name that somebody has probably meant, for messages about a wrong one."""

from __future__ import annotations

from collections.abc import Iterable


def did_you_mean(name: str, known: Iterable[str], *, most: int = 1, cutoff: float = 0.6) -> str:
    """The question "did you mean 'slaves'?"; empty if no known name is close.

    Small and capital letters count as equal.

    Args:
        name: The wrong name.
        known: All right ones.
        most: How many of them are suggested at most.
        cutoff: How close they must be, from 0 to 1: see `difflib.get_close_matches`.
    """
    from difflib import get_close_matches  # not needed while everything is well

    names = {right.casefold(): right for right in known}
    close = get_close_matches(name.casefold(), names, most, cutoff)
    return f"did you mean {' or '.join(repr(names[item]) for item in close)}?" if close else ""

"""How long something is waited for, as messages say it."""

from __future__ import annotations

from typing import NamedTuple


class Patience(NamedTuple):
    """How long something is waited for, and what changes that.

    In a message: `f"no answer within {patience}"` becomes "no answer within 10 s
    (state_timeout_s)".

    Attributes:
        seconds: How long.
        changed_by: The key of the configuration, the option or the argument that changes it; empty
            if nothing does.
    """

    seconds: float
    changed_by: str = ""

    def __str__(self) -> str:
        return f"{self.seconds:g} s" + f" ({self.changed_by})" * bool(self.changed_by)

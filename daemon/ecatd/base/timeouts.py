"""How long something is waited for, as messages say it."""

from __future__ import annotations

from typing import NamedTuple


class Timeout(NamedTuple):
    """How long something is waited for, and what changes that.

    In a message: `f"no answer within {timeout}"` becomes "no answer within 5 s (timeout_s in
    [dc])", or "no answer within 2 s" if nothing changes it.

    Attributes:
        seconds: How long.
        changed_by: The option or the argument that changes it, or the key of the configuration with
            its table, as somebody must write it; empty if nothing does.
    """

    seconds: float
    changed_by: str = ""

    def __str__(self) -> str:
        changed_by = f" ({self.changed_by})" if self.changed_by else ""
        return f"{self.seconds:g} s{changed_by}"

"""Says which slaves need not be what ecatd has read of them, where a command shows or uses that."""

from __future__ import annotations

import sys
import time
from collections.abc import Collection, Sequence
from typing import Any

from ecatd.description.bus import Bus
from ecatd.operations.bus import SlaveAlState
from ecatd.operations.health import outdated

_NAMED_MAX = 8


def tell_outdated(
    bus: Bus, rows: Sequence[SlaveAlState], quiet: Collection[int] = ()
) -> list[dict[str, Any]]:
    """Says it in one line on stderr, with what to do next.

    Args:
        bus: The description.
        rows: The AL states of all slaves, as `ReadStates` is answered.
        quiet: Positions of slaves about which the line says nothing.

    Returns:
        The field `outdated` for `--json`: `position` and `text` of each of these slaves, and when
        ecatd read it, `read_at`, in Unix seconds, or None if it has never been there.
    """
    found = outdated(bus.slaves, rows)
    when = {row["position"]: row["read_at"] for row in rows}
    alike: dict[str, list[int]] = {}
    for position, why in found.items():
        if position not in quiet:
            alike.setdefault(why, []).append(position)
    if alike:
        told = "; ".join(f"{_labels(bus, who)}: {why}" for why, who in alike.items())
        moments = [when[position] for who in alike.values() for position in who]
        print(
            f"ecatctl: warning: {told}; {_of_when(moments)}. `ecatctl check` says what is wrong, "
            "and a restart of ecatd reads all slaves again",
            file=sys.stderr,
        )
    return [{"position": n, "text": why, "read_at": when[n]} for n, why in found.items()]


def _labels(bus: Bus, positions: Sequence[int]) -> str:
    labels = [bus.slaves[position].label for position in positions[:_NAMED_MAX]]
    more = len(positions) - _NAMED_MAX
    return ", ".join(labels) + (f" and {more} more" if more > 0 else "")


def _of_when(moments: Sequence[float | None]) -> str:
    whom = "it" if len(moments) == 1 else "them"
    first = min((moment for moment in moments if moment), default=None)
    if first is None:  # it was missing from the start on
        return f"what is used of {whom} is from the file `description` of [expected]"
    at = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(first))
    return f"what is used of {whom} is what ecatd read at {at}"

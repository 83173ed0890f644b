"""Finds slaves that have lost their power or their cable since the scan."""

from __future__ import annotations

from ..master.master import Master

_TRIES = 3  # a frame may get lost


def find_gone(master: Master) -> list[int]:
    """Positions of slaves that the scan has found, and that no longer answer.

    A slave that was without power has no station address, so it does not answer either.
    """
    gone = set(master.wire)
    for _ in range(_TRIES):
        if gone:
            gone -= {slave.position for slave in master.al_states.read() if slave.al_state}
    return sorted(gone)

"""Finds slaves that have lost their power or their cable since the scan."""

from __future__ import annotations

from ecatd.master.master import Master

_TRIES = 3  # a frame may get lost


def find_gone(master: Master) -> list[int]:
    """Returns the positions of slaves that the scan has found, but that do not answer any more.

    A slave that was without power has lost its station address, so it is among them.
    """
    gone = set(master.wire)
    for _ in range(_TRIES):
        if gone:
            gone -= {slave.position for slave in master.al_states.read() if slave.al_state}
    return sorted(gone)

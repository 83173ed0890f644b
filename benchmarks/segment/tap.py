"""Records what a master sends, so that the bare loop can send the same."""

from __future__ import annotations

import socket
from collections.abc import Callable
from typing import Any

from ecatd.model.errors import StateError

from .frames import BRD, ETHERTYPE, LRW, datagrams
from .peers import SIMULATOR

_ATTEMPTS = 200


def frames_of_a_cycle(run: Callable[[], Any]) -> list[bytes]:
    """The frames of one cycle of the engine, which each cycle begins with a broadcast read.

    Args:
        run: Has the engine exchange; the frames of its first cycles are taken afterwards.

    Raises:
        StateError: They are not what is expected.
    """
    with socket.socket(socket.AF_PACKET, socket.SOCK_RAW) as tap:
        tap.bind((SIMULATOR.far, ETHERTYPE))
        tap.settimeout(1.0)
        run()
        cycle: list[bytes] = []
        for _ in range(_ATTEMPTS):
            frame, (*_, kind, _, _) = tap.recvfrom(2048)
            if kind == socket.PACKET_OUTGOING:
                continue  # the answers
            first = datagrams(frame)[0]
            if first.command == BRD and cycle:
                return cycle
            if first.command == BRD or cycle:
                cycle.append(frame)
    raise StateError("the engine's frames are not recognised")


def counter(frames: list[bytes], slaves: int) -> int:
    """The sum of all working counters: 1 for a slave that is read from, 2 for one written to."""
    kinds = [item.command for frame in frames for item in datagrams(frame)]
    if LRW not in kinds or set(kinds) - {BRD, LRW}:
        raise StateError(f"datagrams with commands {kinds} are not what cells are exchanged with")
    return kinds.count(BRD) * slaves + 3 * slaves

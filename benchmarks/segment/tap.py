"""Records what a master sends, so that the bare loop can send the same, and what it gets."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Callable, Iterator
from typing import Any

from ecatd.bus.engine.engine import Index
from ecatd.model.errors import StateError

from .frames import BRD, ETHERTYPE, INDEX, LRW, datagrams, layout
from .peers import SIMULATOR, Pair

_ATTEMPTS = 200
_TAG = 11  # last byte of the source address; see `fill` in daemon/cyclic/frames.c


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


def answered(run: Callable[[], Any], pair: Pair = SIMULATOR) -> list[tuple[bytes, bytes]]:
    """A frame of each kind that a cycle has, with its answer.

    Args:
        run: Has the engine exchange with slaves in OP.
        pair: The interfaces.

    Raises:
        StateError: There are no frames, or none of them comes back.
    """
    with _listening(pair.far) as at_slaves, _listening(pair.near) as at_master:
        run()
        answers = {_identity(frame): frame for frame in _received(at_master)}
        back = (frame for frame in _received(at_slaves) if _identity(frame) in answers)
        sent = {layout(frame): frame for frame in back}
    if not sent:
        raise StateError("the engine's frames are not recognised")
    return [(frame, answers[_identity(frame)]) for frame in sent.values()]


@contextlib.contextmanager
def _listening(interface: str) -> Iterator[socket.socket]:
    """Takes what comes in there; what goes out is not seen by anybody."""
    with socket.socket(socket.AF_PACKET, socket.SOCK_RAW) as tap:
        tap.bind((interface, ETHERTYPE))
        tap.setblocking(False)
        yield tap


def _received(tap: socket.socket) -> Iterator[bytes]:
    """The cycle's frames that have come in."""
    with contextlib.suppress(BlockingIOError):
        while True:
            frame, (*_, kind, _, _) = tap.recvfrom(2048)
            if kind != socket.PACKET_OUTGOING and frame[INDEX] >= Index.ENGINE:
                yield frame


def _identity(frame: bytes) -> bytes:
    """Index and tag, which tell one frame of the engine from the next 16 000."""
    return bytes((frame[INDEX], frame[_TAG]))


def counter(frames: list[bytes], slaves: int) -> int:
    """The sum of all working counters: 1 for a slave that is read from, 2 for one written to."""
    kinds = [item.command for frame in frames for item in datagrams(frame)]
    if LRW not in kinds or set(kinds) - {BRD, LRW}:
        raise StateError(f"datagrams with commands {kinds} are not what cells are exchanged with")
    return kinds.count(BRD) * slaves + 3 * slaves

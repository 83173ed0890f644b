"""Records the frames of a master, so that the bare loop can send the same, and their answers."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Callable, Iterator
from typing import Any

from ecatd.base.errors import StateError
from ecatd.etg.frame_sizes import ETHERTYPE
from ecatd.master.engine.engine import Index

from .frames import BRD, INDEX, LRW, datagrams, layout
from .peers import SIMULATOR, Pair

_ATTEMPTS = 200
_TAG = 11  # last byte of the source address; see `fill` in daemon/cyclic/frames.c


def frames_of_a_cycle(run: Callable[[], Any]) -> list[bytes]:
    """Records the frames of one cycle of the engine, which begins each cycle with a broadcast read.

    Args:
        run: Makes the engine exchange; the frames are read afterwards.

    Raises:
        StateError: No complete cycle was recognised.
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
    """Records one frame of each layout that the engine sends, with its answer.

    Args:
        run: Makes the engine exchange with slaves in OP.
        pair: The veth pair.

    Returns:
        Pairs of a frame and its answer.

    Raises:
        StateError: The engine sends no frames, or none of them comes back.
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
    """Opens a socket that records EtherCAT frames on an interface."""
    with socket.socket(socket.AF_PACKET, socket.SOCK_RAW) as tap:
        tap.bind((interface, ETHERTYPE))
        tap.setblocking(False)
        yield tap


def _received(tap: socket.socket) -> Iterator[bytes]:
    """Yields the engine's frames that an interface has received so far."""
    with contextlib.suppress(BlockingIOError):
        while True:
            frame, (*_, kind, _, _) = tap.recvfrom(2048)
            if kind != socket.PACKET_OUTGOING and frame[INDEX] >= Index.ENGINE:
                yield frame


def _identity(frame: bytes) -> bytes:
    """Returns index and tag, which together repeat only after some 16 000 frames of the engine."""
    return bytes((frame[INDEX], frame[_TAG]))


def counter(frames: list[bytes], slaves: int) -> int:
    """Returns the expected sum of all working counters of a cycle.

    Each slave adds 1 for a broadcast read, and 3 for its outputs and inputs.

    Raises:
        StateError: The frames have other datagrams than broadcast reads and LRW.
    """
    kinds = [item.command for frame in frames for item in datagrams(frame)]
    if LRW not in kinds or set(kinds) - {BRD, LRW}:
        raise StateError(f"expected datagrams with BRD and LRW only, not with commands {kinds}")
    return kinds.count(BRD) * slaves + 3 * slaves

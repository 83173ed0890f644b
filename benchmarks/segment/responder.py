"""A program in the kernel that answers the frames of the cycle instead of the simulator.

The simulator shares the processors with the measured programs, and the system has to wake it for
each frame. Real slaves do not have this delay. Here an XDP program on the far end of the veth pair
gives the answers that the simulator gave before, within the system call that sends the frame. All
other frames still go to the simulator, which brings the slaves to OP and has their mailboxes and
registers. Meanwhile the process data of the slaves do not change.
"""

from __future__ import annotations

import contextlib
import json
import struct
import subprocess
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Self

from ecatd.base.errors import NotPermittedError, StateError

from . import tap
from .frames import BRD, BWR, ask, datagrams, encode, frame
from .peers import SIMULATOR as PAIR
from .peers import Pair, frame_socket

SIMULATOR, KERNEL = "simulator", "kernel"
"""The programs that can answer the frames of the cycle."""

Answered = tuple[bytes, bytes]
"""A frame as it was sent, and as it came back."""

_FRMW = 14
_OP = 8
_WATCHDOG = 0x0420
_SOURCE = slice(6, 12)
_REFUSED = 3  # exit status of the program


class Responder:
    """Answers frames in the kernel while it is entered.

    Args:
        program: Path of the built program `c/responder.c`.
        answered: Frames of the cycle with the answers of the simulator, from `tap.answered`.
        pair: The veth pair.

    Raises:
        NotPermittedError: This kernel has no XDP for veth, or the process may not use it.
        StateError: The slaves are not in OP; or one of the frames reads a distributed clock, whose
            answer would have to change.
    """

    def __init__(self, program: Path, answered: Sequence[Answered], pair: Pair = PAIR) -> None:
        for _, answer in answered:
            for command, data, _ in datagrams(answer):
                if command == BRD and data[0] != _OP:
                    raise StateError(f"AL status is 0x{data[0]:02X}: slaves are not in OP")
                if command == _FRMW:
                    raise StateError("the kernel cannot answer for distributed clocks")
        for sent, _ in answered[:1]:
            _switch_watchdogs_off(pair, sent[_SOURCE])
        self._process = subprocess.Popen(
            [program, pair.near, pair.far],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        assert self._process.stdin
        assert self._process.stdout
        self._stdin, self._stdout = self._process.stdin, self._process.stdout
        self._write(struct.pack("<H", len(answered)) + encode(answered))
        if self._stdout.readline() != b"ready\n":
            assert self._process.stderr
            reason = self._process.stderr.read().decode().strip()
            self.close()
            kind = NotPermittedError if self._process.returncode == _REFUSED else StateError
            raise kind(reason)

    def _write(self, data: bytes) -> None:
        try:
            self._stdin.write(data)
            self._stdin.flush()
        except BrokenPipeError:
            pass  # the next read reports it

    @property
    def counts(self) -> dict[str, int]:
        """EtherCAT frames so far: "answered" by the kernel, and "passed" on to the simulator."""
        self._write(b"?")
        found: dict[str, int] = json.loads(self._stdout.readline())
        return found

    def close(self) -> None:
        """Ends the program; from now on the simulator answers all frames again."""
        self._process.communicate()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _switch_watchdogs_off(pair: Pair, source: bytes) -> None:
    """Switches the watchdogs of all slaves off, because they will no longer see process data.

    The frame has the source address of the master, which would report a foreign master otherwise.
    """
    request = frame(BWR, 0, _WATCHDOG, bytes(2))
    with frame_socket(pair) as opened:
        ask(opened.exchange, request[: _SOURCE.start] + source + request[_SOURCE.stop :])


def obstacle(program: Path, pair: Pair = PAIR) -> str | None:
    """Returns the reason why this kernel cannot answer frames for this process, None if it can."""
    try:
        Responder(program, [], pair).close()
    except NotPermittedError as error:
        return str(error)
    return None


def possible(program: Path) -> tuple[str | None, tuple[str, ...]]:
    """Returns the result of `obstacle`, and the programs that can answer frames of the cycle."""
    reason = obstacle(program)
    return reason, (SIMULATOR,) if reason else (SIMULATOR, KERNEL)


@contextlib.contextmanager
def answering(who: str, program: Path, exchange: Callable[[], object]) -> Iterator[dict[str, int]]:
    """Selects the program that answers the frames of the cycle.

    Args:
        who: `SIMULATOR` or `KERNEL`.
        program: As for `Responder`.
        exchange: Makes the engine exchange for a while, to record the answers of the simulator.

    Yields:
        A dict. On exit, `Responder.counts` are put into it if the kernel answers.
    """
    counts: dict[str, int] = {}
    if who == SIMULATOR:
        yield counts
        return
    with Responder(program, tap.answered(exchange)) as kernel:
        yield counts
        counts |= kernel.counts

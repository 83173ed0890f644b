"""Functions by which a process of the daemon sets itself up: end with its parent, drop rights."""

from __future__ import annotations

import ctypes
import os
import signal
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

_PR_SET_PDEATHSIG = 1
_PR_SET_NAME = 15
_PR_SET_NO_NEW_PRIVS = 38
_PR_CAPBSET_DROP = 24
_PR_CAP_AMBIENT, _PR_CAP_AMBIENT_CLEAR_ALL = 47, 4
_CAPABILITY_VERSION_3 = 0x20080522
_CAP_LAST = 63

CAP_NET_ADMIN = 12
"""The capability to set up network interfaces (capabilities(7))."""

_CAP_NET_RAW, _CAP_IPC_LOCK, _CAP_SYS_NICE = 13, 14, 23
OF_A_SEGMENT = (_CAP_NET_RAW, CAP_NET_ADMIN, _CAP_SYS_NICE, _CAP_IPC_LOCK)
"""What the bus server needs, and a simulated segment: raw frames, setting up the interface,
real-time scheduling, locked memory. The service has no more."""

_CAP_CHOWN, _CAP_DAC_OVERRIDE, _CAP_FOWNER, _CAP_SYS_PTRACE = 0, 1, 3, 19
OF_ROOT = (*OF_A_SEGMENT, _CAP_CHOWN, _CAP_DAC_OVERRIDE, _CAP_FOWNER, _CAP_SYS_PTRACE)
"""What a bus server uses besides if root has started it by hand: it gives shared memory and sockets
to the group of the service, takes over files of the service, and sees which program has damaged
shared memory."""

OF_THE_SERVICE = (signal.SIGINT, signal.SIGHUP)
"""Signals that only the service handles. It starts its children with these signals blocked, since
they would end a child that has not called `leave_signals_to_the_service` yet."""

_LIBC = ctypes.CDLL(None, use_errno=True)


def set_title(command: Sequence[str]) -> None:
    """Has `ps` and `top` show another command for this process, as far as it has room for it.

    Args:
        command: The words of the command.
    """
    _LIBC.prctl(_PR_SET_NAME, command[0].encode(), 0, 0, 0)
    with suppress(OSError, ValueError, IndexError):
        # After the name in brackets; the fields 48 and 49 of proc(5) are arg_start and arg_end.
        fields = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
        begin, end = int(fields[45]), int(fields[46])
        if 0 < begin < end:
            words = b"".join(word.encode() + b"\0" for word in command)[: end - begin - 1]
            ctypes.memmove(begin, words.ljust(end - begin, b"\0"), end - begin)


def die_with_parent(parent: int, number: int = signal.SIGTERM) -> None:
    """Has the kernel send a signal to this process when its parent ends.

    Call it after entering a namespace: entering one clears this setting in the kernel. The kernel
    also sends the signal when only the thread ends that started this process.

    Args:
        parent: Process ID of the parent; if it has ended already, the signal is sent at once.
        number: Number of the signal.
    """
    _LIBC.prctl(_PR_SET_PDEATHSIG, number, 0, 0, 0)
    if os.getppid() != parent:
        os.kill(os.getpid(), number)


def leave_signals_to_the_service() -> None:
    """Ignores the signals that a terminal or an administrator sends to the service.

    The service handles them for its children: SIGINT ends it, and on SIGHUP it reads its
    configuration.
    """
    for number in OF_THE_SERVICE:
        signal.signal(number, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, OF_THE_SERVICE)


def leave_processor(cpu: int) -> None:
    """Keeps this process and its future children off the processor of the engine.

    A program that runs there between two cycles displaces the engine's data from the caches, and a
    long system call of it makes the engine wait.

    Args:
        cpu: Number of the engine's processor.
    """
    others = os.sched_getaffinity(0) - {cpu}
    if others:
        os.sched_setaffinity(0, others)


def offer_to_oom_killer(score: int) -> None:
    """Has the kernel choose this process before others if there is no memory left.

    Args:
        score: -1000 (never) to 1000 (first). If the process has a higher score already, this does
            nothing: without rights, a process cannot lower its score.
    """
    file = Path("/proc/self/oom_score_adj")
    with suppress(OSError, ValueError):
        if int(file.read_text()) < score:
            file.write_text(str(score))


class _CapHeader(ctypes.Structure):
    _fields_ = (("version", ctypes.c_uint32), ("pid", ctypes.c_int))


class _CapData(ctypes.Structure):
    _fields_ = tuple((n, ctypes.c_uint32) for n in ("effective", "permitted", "inheritable"))


_OF_THIS_THREAD = ctypes.byref(_CapHeader(_CAPABILITY_VERSION_3, 0))


def lower(capability: int) -> None:
    """Puts a capability out of effect, for this thread and for those that it starts from now on.

    What this process does by mistake, or is made to do, then happens without it. `raised` puts it
    into effect for a moment.
    """
    _put_into_effect(capability, False)


@contextmanager
def raised(capability: int) -> Iterator[None]:
    """Puts a capability into effect for the block, in this thread, if this process has it."""
    changed = _put_into_effect(capability, True)
    try:
        yield
    finally:
        if changed:
            _put_into_effect(capability, False)


def _put_into_effect(capability: int, wanted: bool) -> bool:
    """Puts a permitted capability into effect, or out of it; returns whether that was a change."""
    data = (_CapData * 2)()
    _LIBC.capget(_OF_THIS_THREAD, ctypes.byref(data))
    part, bit = data[capability // 32], 1 << capability % 32
    if not part.permitted & bit or bool(part.effective & bit) == wanted:
        return False
    part.effective ^= bit
    done: int = _LIBC.capset(_OF_THIS_THREAD, ctypes.byref(data))
    return done == 0


def drop_rights(but: Collection[int] = ()) -> None:
    """Drops capabilities for good: neither this process nor its children can regain one.

    Call it before the process has other threads: each thread has its own capabilities.

    Args:
        but: Capabilities that it keeps, if it has them.
    """
    _LIBC.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)
    for capability in set(range(_CAP_LAST + 1)) - set(but):
        _LIBC.prctl(_PR_CAPBSET_DROP, capability, 0, 0, 0)  # may fail: needs CAP_SETPCAP
    _LIBC.prctl(_PR_CAP_AMBIENT, _PR_CAP_AMBIENT_CLEAR_ALL, 0, 0, 0)
    data = (_CapData * 2)()
    _LIBC.capget(_OF_THIS_THREAD, ctypes.byref(data))
    for number, part in enumerate(data):
        kept = sum(1 << capability % 32 for capability in but if capability // 32 == number)
        part.effective, part.permitted = part.effective & kept, part.permitted & kept
        part.inheritable = 0
    _LIBC.capset(_OF_THIS_THREAD, ctypes.byref(data))

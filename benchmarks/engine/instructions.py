"""Counts the instructions that a thread executes outside the kernel."""

from __future__ import annotations

import ctypes
import os
import platform
import struct

_SYSCALL = {"x86_64": 298, "aarch64": 241, "riscv64": 241}  # perf_event_open
_HARDWARE, _INSTRUCTIONS = 0, 1
_EXCLUDE_KERNEL, _EXCLUDE_HYPERVISOR = 1 << 5, 1 << 6
_ATTRIBUTES = 64  # bytes: PERF_ATTR_SIZE_VER0

_libc = ctypes.CDLL(None, use_errno=True)


def obstacle() -> str | None:
    """Returns the reason why instructions cannot be counted here, None if they can."""
    try:
        Counter(os.getpid()).close()
    except OSError as error:
        return f"the processor's counters cannot be used: {error.strerror}"
    return None


class Counter:
    """Counts the instructions of a thread of this process, as `perf stat -e instructions:u` does.

    Args:
        thread: Number of the thread.

    Raises:
        OSError: The machine cannot count instructions; many virtual machines have no counters.
    """

    def __init__(self, thread: int) -> None:
        attributes = struct.pack(
            "<IIQQQQQ",
            *(_HARDWARE, _ATTRIBUTES, _INSTRUCTIONS, 0, 0, 0),
            _EXCLUDE_KERNEL | _EXCLUDE_HYPERVISOR,
        ).ljust(_ATTRIBUTES, b"\0")
        number = _SYSCALL.get(platform.machine(), -1)
        self._fd = _libc.syscall(number, attributes, thread, -1, -1, 0)
        if self._fd < 0:
            raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))

    def read(self) -> int:
        """Returns the count so far."""
        return int.from_bytes(os.read(self._fd, 8), "little")

    def close(self) -> None:
        """Stops counting."""
        os.close(self._fd)

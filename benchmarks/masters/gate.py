"""Keeps frames from the raw sockets of a process while it is not its turn.

Several masters are measured in turns on one interface. Each frame costs time for every open
socket, so those of masters that wait take nothing in.
"""

from __future__ import annotations

import contextlib
import os
import socket
import struct
from ctypes import addressof, create_string_buffer

_ATTACH_FILTER, _DETACH_FILTER = 26, 27
_RETURN = 0x06
_NOTHING = struct.pack("HBBI", _RETURN, 0, 0, 0)


class Gate:
    """All AF_PACKET sockets that this process has opened by now."""

    def __init__(self) -> None:
        self._sockets = []
        for name in os.listdir("/proc/self/fd"):  # noqa: PTH208  a Path per entry serves nobody
            with contextlib.suppress(OSError):  # the one that lists, and what is no socket
                found = socket.socket(fileno=os.dup(int(name)))
                if found.family == socket.AF_PACKET:
                    self._sockets.append(found)
                else:
                    found.close()

    def close(self) -> None:
        """Lets nothing in."""
        code = create_string_buffer(_NOTHING)
        program = struct.pack("HxxxxxxQ", 1, addressof(code))
        for item in self._sockets:
            item.setsockopt(socket.SOL_SOCKET, _ATTACH_FILTER, program)

    def open(self) -> None:
        """Lets in what comes from now on."""
        for item in self._sockets:
            with contextlib.suppress(OSError):
                while item.recv(1, socket.MSG_DONTWAIT):
                    pass
            item.setsockopt(socket.SOL_SOCKET, _DETACH_FILTER, 0)

"""The relay (`daemon/cyclic/relay.h`): the way of mailbox and register frames past the cycle."""

from __future__ import annotations

import ctypes
import os
import socket
import struct
from collections.abc import Sequence

from ecatd.model.errors import EcatError

from .engine import LIBRARY, Engine

_WINDOW_US = 1000
"""CYCLIC_RELAY_WINDOW_NS of `relay.h`."""

_ANSWER_US = 2000
"""A frame that is not back after this time is lost; a round through 1000 slaves takes a half."""

_LONG_US = 500
"""A frame is hardly ever longer on the wire, also where the machine is busy."""

_PATIENCE_MAX_US = 50_000
_MARGIN_US = 1000
_RECEIVE_US = 1000
_SEND_US = 20_000


class _Settings(ctypes.Structure):
    """`cyclic_relay_settings` of `relay.h`."""

    _fields_ = (
        ("share", ctypes.c_double),
        ("patience_ns", ctypes.c_uint64),
        ("answer_ns", ctypes.c_uint64),
        ("priority", ctypes.c_int32),
    )


def _declare(lib: ctypes.CDLL) -> ctypes.CDLL:
    pointer, integer = ctypes.c_void_p, ctypes.c_int
    lib.cyclic_relay_new.restype = pointer
    lib.cyclic_relay_new.argtypes = [integer, integer, integer, integer, pointer]
    lib.cyclic_relay_follow.argtypes = [pointer, pointer]
    lib.cyclic_relay_follow.restype = None
    lib.cyclic_relay_set_socket.argtypes = [pointer, ctypes.c_uint32, integer]
    lib.cyclic_relay_set_socket.restype = None
    lib.cyclic_relay_free.argtypes = [pointer]
    lib.cyclic_relay_free.restype = None
    return lib


_LIB = _declare(LIBRARY)


class Relay:
    """One relay; see `relay.h` for what each call means.

    Args:
        sockets: One from `open_socket` for each interface, with the indices of SOEM and of register
            access: one, or two with cable redundancy. They are the relay's from now on.
        share: Share of the time that the cycle leaves free in which its frames may be on the wire,
            above 0 to 1.
        priority: SCHED_FIFO priority, below that of the engine; 0 for ordinary scheduling.

    Attributes:
        soem: The end for SOEM. Receiving blocks for a millisecond at most.
        registers: The end for `Datagrams`.
        timeout_us: When a client that got no answer can be sure that none will come.

    Raises:
        EcatError: The relay cannot be made.
    """

    def __init__(
        self, sockets: Sequence[socket.socket], share: float = 1.0, priority: int = 0
    ) -> None:
        # No frame should have to go before its share allows it.
        patience_us = min(round(_LONG_US * (1 - share) / share), _PATIENCE_MAX_US)
        self.timeout_us = patience_us + _WINDOW_US + _ANSWER_US + _MARGIN_US
        self._ports = list(sockets)
        self.soem, soem_end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.registers, registers_end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._ends = soem_end, registers_end
        for option, limit_us in ((socket.SO_RCVTIMEO, _RECEIVE_US), (socket.SO_SNDTIMEO, _SEND_US)):
            limit = struct.pack("@ll", 0, limit_us)  # struct timeval
            self.soem.setsockopt(socket.SOL_SOCKET, option, limit)
        settings = _Settings(share, patience_us * 1000, _ANSWER_US * 1000, priority)
        fds = [item.fileno() for item in (*self._ends, *self._ports)]
        self._relay = _LIB.cyclic_relay_new(
            *(fds if len(fds) == 4 else (*fds, -1)), ctypes.byref(settings)
        )
        if not self._relay:
            reason = os.strerror(ctypes.get_errno())
            self._close_sockets()
            raise EcatError(f"the relay for mailbox frames does not start: {reason}")

    def follow(self, engine: Engine | None) -> None:
        """Has frames wait for the free time of the engine's cycle, until the engine stops."""
        _LIB.cyclic_relay_follow(self._relay, None if engine is None else engine.handle)

    def set_socket(self, port: int, new: socket.socket) -> None:
        """Replaces the socket of an interface that went and came back; it is the relay's then."""
        _LIB.cyclic_relay_set_socket(self._relay, port, new.fileno())
        self._ports[port].close()
        self._ports[port] = new

    def close(self) -> None:
        """Ends the relay; no other call may follow."""
        if self._relay:
            _LIB.cyclic_relay_free(self._relay)
            self._relay = None
            self._close_sockets()

    def _close_sockets(self) -> None:
        for item in (self.soem, self.registers, *self._ends, *self._ports):
            item.close()

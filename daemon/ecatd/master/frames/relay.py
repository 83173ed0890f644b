"""The relay (`daemon/cyclic/relay.h`): sends mailbox and register frames between two cycles."""

from __future__ import annotations

import ctypes
import os
import socket
from collections.abc import Sequence

from ecatd.base.errors import EcatError

from ..engine.engine import LIBRARY, Engine

_WINDOW_US = 1000
"""CYCLIC_RELAY_WINDOW_NS of `relay.h`."""

_ANSWER_US = 2000
"""A frame that is not back after this time is lost. Through 1000 slaves it takes half of it."""

_LONG_US = 500
"""A frame is hardly ever on the wire for longer than this, even if the machine is busy."""

_MARGIN_US = 1000


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
    lib.cyclic_relay_new.argtypes = [integer, integer, integer, pointer]
    lib.cyclic_relay_follow.argtypes = [pointer, pointer]
    lib.cyclic_relay_follow.restype = None
    lib.cyclic_relay_set_socket.argtypes = [pointer, ctypes.c_uint32, integer]
    lib.cyclic_relay_set_socket.restype = None
    lib.cyclic_relay_set_share.argtypes = [pointer, ctypes.c_double, ctypes.c_uint64]
    lib.cyclic_relay_set_share.restype = None
    lib.cyclic_relay_free.argtypes = [pointer]
    lib.cyclic_relay_free.restype = None
    return lib


_LIB = _declare(LIBRARY)


class Relay:
    """One relay; see `relay.h` for what each call means.

    Args:
        sockets: One socket from `open_for_control` for each interface: one, or two with cable
            redundancy. The relay owns them from now on.
        share: The share of the free time of the cycle in which frames of the relay may be on the
            wire: above 0 and up to 1.
        priority: SCHED_FIFO priority, below that of the engine; 0 for ordinary scheduling.

    Attributes:
        client: The socket that `Datagrams` uses.
        timeout_us: Microseconds after which no answer to a frame can come any more.

    Raises:
        EcatError: The relay cannot be made.
    """

    def __init__(
        self, sockets: Sequence[socket.socket], share: float = 1.0, priority: int = 0
    ) -> None:
        patience_us = self._patience_us(share)
        self._ports = list(sockets)
        self.client, self._end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        settings = _Settings(share, patience_us * 1000, _ANSWER_US * 1000, priority)
        fds = [item.fileno() for item in self._ports]
        self._relay = _LIB.cyclic_relay_new(
            self._end.fileno(), *(fds if len(fds) == 2 else (*fds, -1)), ctypes.byref(settings)
        )
        if not self._relay:
            reason = os.strerror(ctypes.get_errno())
            self._close_sockets()
            raise EcatError(f"the relay for mailbox frames does not start: {reason}")

    def _patience_us(self, share: float) -> int:
        """Returns the longest time that frames wait for their share; sets `timeout_us` for it."""
        # It is long enough for every frame, so no frame is sent before its share allows it.
        patience_us = round(_LONG_US * (1 - share) / share)
        self.timeout_us = patience_us + _WINDOW_US + _ANSWER_US + _MARGIN_US
        return patience_us

    def set_share(self, share: float) -> None:
        """Changes the share of the free time, which also changes `timeout_us`."""
        _LIB.cyclic_relay_set_share(self._relay, share, 1000 * self._patience_us(share))

    @property
    def handle(self) -> int:
        """The `cyclic_relay_t *`, for the ring of the relay's frames."""
        return int(self._relay)

    def follow(self, engine: Engine | None) -> None:
        """Makes frames wait for the free time of the engine's cycle, until the engine stops.

        With None, frames are sent at once.
        """
        _LIB.cyclic_relay_follow(self._relay, None if engine is None else engine.handle)

    def set_socket(self, port: int, new: socket.socket) -> None:
        """Replaces the socket of an interface that went away and came back; the relay owns it."""
        _LIB.cyclic_relay_set_socket(self._relay, port, new.fileno())
        self._ports[port].close()
        self._ports[port] = new

    def close(self) -> None:
        """Ends the relay and closes its sockets. No other call may follow."""
        if self._relay:
            _LIB.cyclic_relay_free(self._relay)
            self._relay = None
            self._close_sockets()

    def _close_sockets(self) -> None:
        for item in (self.client, self._end, *self._ports):
            item.close()

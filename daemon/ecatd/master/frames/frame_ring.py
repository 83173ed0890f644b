"""Rings with the last frames that were sent and received (`daemon/cyclic/frame_ring.h`)."""

from __future__ import annotations

import ctypes
import os

from ecatd.base.errors import EcatError

from ..engine.engine import LIBRARY

_MIB = 1 << 20


def _declare(lib: ctypes.CDLL) -> ctypes.CDLL:
    pointer, u64 = ctypes.c_void_p, ctypes.c_uint64
    lib.cyclic_frame_ring_new.restype = pointer
    lib.cyclic_frame_ring_new.argtypes = [u64]
    lib.cyclic_frame_ring_read.restype = ctypes.c_uint32
    lib.cyclic_frame_ring_read.argtypes = [
        *(pointer, ctypes.POINTER(u64), ctypes.c_char_p, ctypes.c_uint32)
    ]
    lib.cyclic_frame_ring_find.restype = u64
    lib.cyclic_frame_ring_find.argtypes = [pointer, u64]
    lib.cyclic_frame_ring_end.restype = u64
    lib.cyclic_frame_ring_end.argtypes = [pointer]
    for name in ("set_frame_ring", "relay_set_frame_ring"):
        getattr(lib, f"cyclic_{name}").argtypes = [pointer, pointer]
        getattr(lib, f"cyclic_{name}").restype = None
    lib.cyclic_frame_ring_free.argtypes = [pointer]
    lib.cyclic_frame_ring_free.restype = None
    return lib


_LIB = _declare(LIBRARY)


class FrameRing:
    """The last frames of one thread: the engine, or the relay.

    Args:
        size: Bytes of memory, at least 16384.

    Raises:
        EcatError: There is not enough memory.
    """

    def __init__(self, size: int) -> None:
        self._ring = _LIB.cyclic_frame_ring_new(size)
        if not self._ring:
            reason = os.strerror(ctypes.get_errno())
            raise EcatError(
                f"no memory for the last frames ({size / _MIB:g} MiB): {reason}. Give "
                f"flight_recorder.memory_mb a smaller value, or 0"
            )

    def of_engine(self, engine: int) -> None:
        """Makes an engine (`Engine.handle`) write into the ring; call it before it starts."""
        _LIB.cyclic_set_frame_ring(engine, self._ring)

    def of_relay(self, relay: int) -> None:
        """Makes a relay (`Relay.handle`) write into the ring."""
        _LIB.cyclic_relay_set_frame_ring(relay, self._ring)

    def read(self, position: int, room: int) -> tuple[int, bytes]:
        """Reads records (`cyclic_frame_record`); see `cyclic_frame_ring_read`.

        Args:
            position: Position to begin at: 0, or that from the last call.
            room: Most bytes to return, at least 4096.

        Returns:
            The position for the next call, and whole records.
        """
        at = ctypes.c_uint64(position)
        buffer = ctypes.create_string_buffer(room)
        length = _LIB.cyclic_frame_ring_read(self._ring, ctypes.byref(at), buffer, room)
        return at.value, buffer.raw[:length]

    def find(self, time_ns: int) -> int:
        """The position of the last record that is not newer than a time; else of the oldest one."""
        return int(_LIB.cyclic_frame_ring_find(self._ring, time_ns))

    @property
    def end(self) -> int:
        """The position behind the newest record."""
        return int(_LIB.cyclic_frame_ring_end(self._ring))

    def close(self) -> None:
        """Frees the memory. Close the engine or relay that writes into it before."""
        if self._ring:
            _LIB.cyclic_frame_ring_free(self._ring)
            self._ring = None

"""The distributed clocks of a segment (see `Segment`)."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

from .links import MAX_SLAVES, Handle, checked


@dataclass(frozen=True, slots=True)
class Clock:
    """The distributed clock of a slave at one moment.

    Attributes:
        local_ns: Local time in ns since power-on.
        system_ns: Local copy of the system time in ns: local time plus offset.
        offset_ns: System time offset, register 0x0920.
        delay_ns: System time delay, register 0x0928.
        difference_ns: Mean lead over the reference clock, register 0x092C.
        drift_ppm: Error of its oscillator; positive is fast.
        trim_ppm: Correction of the rate by its time control loop.
    """

    local_ns: int
    system_ns: int
    offset_ns: int
    delay_ns: int
    difference_ns: int
    drift_ppm: float
    trim_ppm: float


class _Clock(ctypes.Structure):
    _fields_ = (
        ("local_ns", ctypes.c_int64),
        ("system_ns", ctypes.c_int64),
        ("offset_ns", ctypes.c_int64),
        ("delay_ns", ctypes.c_uint32),
        ("difference_ns", ctypes.c_int64),
        ("drift_ppm", ctypes.c_double),
        ("trim_ppm", ctypes.c_double),
    )


def signatures() -> dict[str, tuple[type | None, list[type]]]:
    """Returns result and argument types of the C functions that this module calls."""
    segment, number = ctypes.c_void_p, ctypes.c_int
    return {
        "esc_set_clock": (number, [segment, number, ctypes.c_void_p, ctypes.c_void_p]),
        "esc_step_clock": (number, [segment, number, ctypes.c_int64]),
        "esc_clocks": (number, [segment, ctypes.POINTER(_Clock), number]),
        "esc_latch": (number, [segment, number, number, number]),
    }


class Clocks(Handle):
    """The methods of `Segment` for distributed clocks."""

    def set_clock(
        self, position: int, *, drift_ppm: float | None = None, offset_ns: int | None = None
    ) -> None:
        """Sets properties of the oscillator of a slave; None keeps one as it is.

        Args:
            position: Position of the slave.
            drift_ppm: Error of the oscillator from now on; positive is fast.
            offset_ns: Local time that the clock has at power-on; the clock jumps by the change.
        """
        drift = None if drift_ppm is None else ctypes.byref(ctypes.c_double(drift_ppm))
        offset = None if offset_ns is None else ctypes.byref(ctypes.c_int64(offset_ns))
        checked(self._lib.esc_set_clock(self._handle, position, drift, offset))

    def step_clock(self, position: int, ns: int) -> None:
        """Steps the local time of a slave by `ns` nanoseconds, forward or back, as a fault."""
        checked(self._lib.esc_step_clock(self._handle, position, ns))

    def clocks(self) -> list[Clock]:
        """Returns the distributed clocks of all slaves, all read at the same moment."""
        clocks = (_Clock * MAX_SLAVES)()
        count = checked(self._lib.esc_clocks(self._handle, clocks, MAX_SLAVES))
        names = [name for name, _ in _Clock._fields_]
        return [Clock(*(getattr(clock, name) for name in names)) for clock in clocks[:count]]

    def clock(self, position: int) -> Clock:
        """Returns the distributed clock of a slave now; `clocks` is for comparing several."""
        return self.clocks()[position]

    def latch(self, position: int, unit: int, rising: bool) -> None:
        """Makes an edge at latch input 0 or 1 of a slave, now (registers 0x09A8 to 0x09CF)."""
        checked(self._lib.esc_latch(self._handle, position, unit, rising))

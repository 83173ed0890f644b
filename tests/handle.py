"""A handle of the C client, with every code as it is: for tests of what clients are told."""

import ctypes
from collections.abc import Callable

from ecatd.shm import contract as shm

LIB = shm.LIBRARY
EARG, EDOWN, ELAYOUT, EBUS, EOWNED, ECLAIM, ELEASE, ERANGE, ETIMEOUT, ESTALE, EBUSY = (
    -1,
    -2,
    -3,
    -5,
    -7,
    -8,
    -9,
    -10,
    -11,
    -12,
    -15,
)


class Handle:
    """`Handle("ecat0").sample()` is `ecat_sample()`; numbers that are floats become `double`."""

    def __init__(self, bus: str) -> None:
        self.bus = ctypes.c_void_p()
        assert LIB.ecat_open(ctypes.byref(self.bus), bus.encode()) == 0

    def __getattr__(self, name: str) -> Callable[..., int]:
        function = getattr(LIB, f"ecat_{name}")

        def call(*arguments: object) -> int:
            converted = [ctypes.c_double(a) if isinstance(a, float) else a for a in arguments]
            return int(function(self.bus, *converted))

        return call

    def close(self) -> None:
        if self.bus is not None:
            LIB.ecat_close(self.bus)
        self.bus = None  # type: ignore[assignment]

    def __enter__(self) -> "Handle":
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    @property
    def error(self) -> str:
        function = LIB.ecat_error
        function.restype = ctypes.c_char_p
        return str(function(self.bus).decode())

    @property
    def instance(self) -> int:
        function = LIB.ecat_instance
        function.restype = ctypes.c_uint64
        return int(function(self.bus))

    def value(self, signal: int) -> float:
        """Raw value of an entry in the last sample."""
        return self._found(self.read, signal, ctypes.c_double())

    def integer(self, signal: int) -> int:
        """The same as an integer of 64 bits."""
        return int(self._found(self.read_int, signal, ctypes.c_int64()))

    def physical(self, signal: int) -> float:
        """Physical value of an entry in the last sample."""
        return self._found(self.read_physical, signal, ctypes.c_double())

    def _found(
        self, read: Callable[..., int], signal: int, place: ctypes.c_double | ctypes.c_int64
    ) -> float:
        assert read(signal, ctypes.byref(place)) == 0, self.error
        return place.value

"""A connection to the shared memory of one bus: its life, and what all calls have in common."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import NoReturn, Self

from ecatd.model.errors import (
    EcatError,
    LeaseError,
    NoAnswerError,
    NotPermittedError,
    OwnedError,
    StateError,
    UnreachableError,
    UsageError,
)
from ecatd.shm import Errno

from .structs import QUICK, WAITING

_ERRORS: dict[int, type[EcatError]] = {
    Errno.EARG: UsageError,
    Errno.EDOWN: UnreachableError,
    Errno.ELAYOUT: StateError,
    Errno.EPERM: NotPermittedError,
    Errno.EBUS: StateError,
    Errno.ESIGNAL: StateError,
    Errno.EOWNED: OwnedError,
    Errno.ECLAIM: StateError,
    Errno.ELEASE: LeaseError,
    Errno.ERANGE: UsageError,
    Errno.ETIMEOUT: NoAnswerError,
    Errno.ESTALE: UnreachableError,
    Errno.EFULL: StateError,
    Errno.ESTATE: StateError,
}
_SLICE = 0.1
"""Seconds that a call waits at most before Python may look for signals such as Ctrl-C."""

PADDING = 8
"""Bytes behind an image that may be read."""


class _Memory:
    """An `ecat_t`, closed when nobody needs it any more: images of the last sample lie in it."""

    def __init__(self, bus: str) -> None:
        pointer = ctypes.c_void_p()
        code = WAITING.ecat_open(ctypes.byref(pointer), bus.encode())
        self.address: int = pointer.value or 0
        if code != 0:
            raise _error(self.address, code)

    def __del__(self, close: object = QUICK.ecat_close) -> None:
        close(self.address)  # type: ignore[operator]


def _error(address: int, code: int) -> EcatError:
    text = QUICK.ecat_error(address).decode("utf-8", "replace")
    return _ERRORS.get(code, EcatError)(text)


def text_of(data: bytes) -> str:
    """A text of the shared memory."""
    return data.decode("utf-8", "replace")


class Connection:
    """A connection to one bus; belongs to one thread at a time.

    Args:
        bus: Name of the bus.

    Raises:
        UnreachableError: No daemon serves the bus.
        NotPermittedError: This user may not read it.
        StateError: The daemon has another version.
    """

    # Of the `ecat_t`. It is not there while a thread waits in a call, and after `close`, so that
    # the calls of others fail without a test in each of them: see `__getattr__`.
    _address: int

    def __init__(self, bus: str = "ecat0") -> None:
        self._name = bus
        self._memory: _Memory | None = None
        self._memory = _Memory(bus)
        self._address = self._memory.address
        self._gone = False  # the daemon was not there when it was last looked for
        self._unsure = False  # the daemon may be another one than before
        self._instance = int(QUICK.ecat_instance(self._address))

    def close(self) -> None:
        """Releases all claims and forgets the bus.

        Raises:
            UsageError: Another thread waits with this client.
        """
        if self._memory is not None:
            QUICK.ecat_release_all(self._address)
            del self._address
            self._memory = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def name(self) -> str:
        """Name of the bus."""
        return self._name

    def __getattr__(self, name: str) -> NoReturn:
        if name == "_address":
            raise self._unusable()
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def _unusable(self) -> EcatError:
        if self._memory is None:
            return StateError(f"this client of bus '{self._name}' is closed; make a new one")
        return UsageError(
            f"another thread is waiting with this client of bus '{self._name}': "
            f"a client belongs to one thread, so open one for each"
        )

    def _fail(self, code: int) -> NoReturn:
        """Raises what a code stands for."""
        assert self._memory is not None
        self._gone = code == Errno.EDOWN
        self._unsure = True
        raise _error(self._memory.address, code)

    def _check(self, code: int) -> int:
        if code < 0:
            self._fail(code)
        return code

    def _live(self, code: int) -> int:
        """Checks a call that needs the daemon, and that finds it again after a restart."""
        if code < 0:
            self._fail(code)
        if self._unsure:
            self._gone = self._unsure = False
            instance = int(QUICK.ecat_instance(self._address))
            if instance != self._instance:
                self._instance = instance
                self._renew()
        return code

    def _renew(self) -> None:
        """The daemon has been started again: places in the image and units may be others."""

    @contextmanager
    def _waiting(self) -> Iterator[int]:
        """Keeps other threads out while this one waits without the GIL."""
        taken = True
        try:  # from here on, since Ctrl-C may come at any place
            address = vars(self).pop("_address", 0)
            if not address:
                taken = False
                raise self._unusable()
            yield address
        finally:
            if taken and self._memory is not None:
                self._address = self._memory.address

    def _ring(self, function: Callable[..., int], *arguments: float) -> None:
        """Changes claims; the engine answers at the end of a cycle."""
        with self._waiting() as address:
            code = function(address, *arguments)
        self._live(code)

    def _wait(self, function: Callable[..., int], name: str, timeout: float, *what: int) -> None:
        if any(number < 0 for number in what):
            raise UsageError(f"{min(what)} is nothing to wait for")
        end = time.monotonic() + timeout
        gone = self._gone
        with self._waiting() as address:
            while True:
                # A thread may be stopped, and be back long after the end.
                left = max(end - time.monotonic(), 0) if timeout > 0 else timeout
                code = function(address, *what, min(left, _SLICE))
                in_vain = code == Errno.ETIMEOUT or (gone and code == Errno.EDOWN)
                if not (in_vain and left > _SLICE):
                    break
        if code == Errno.ETIMEOUT:
            raise NoAnswerError(
                f"bus '{self._name}': the {name} that was waited for did not come within "
                f"{timeout:g} s"
            )
        self._live(code)

    def _image(self, number: int) -> memoryview:
        """The last sample of a domain in place, and padding; it keeps the connection alive."""
        size = ctypes.c_size_t()
        address = QUICK.ecat_image(self._address, number, ctypes.byref(size))
        if not address:
            self._fail(Errno.EARG)
        data = (ctypes.c_char * (size.value + PADDING)).from_address(address)
        data.memory = self._memory  # type: ignore[attr-defined]
        return memoryview(data).cast("B").toreadonly()

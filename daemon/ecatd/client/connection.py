"""A connection to the shared memory of one bus: how it begins and ends, and how calls are made.

The parts of a `Client` share one `Connection`. Only this module knows when the C client can be
called, which error a code stands for, and that the daemon was started again.
"""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NoReturn

from ecatd.base.errors import (
    BusyError,
    EcatError,
    LeaseError,
    NoAnswerError,
    NotPermittedError,
    OwnedError,
    StateError,
    UnreachableError,
    UsageError,
)
from ecatd.base.timeouts import Timeout
from ecatd.shm.contract import Direction, Errno

from .arguments import text
from .structs import QUICK, WAITING, SignalStruct, SummaryStruct

ERRORS: dict[int, type[EcatError]] = {
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
    Errno.EFULL: BusyError,
    Errno.ESTATE: StateError,
}
_SLICE = 0.1
"""Most seconds that a call waits before Python can handle signals such as Ctrl-C."""

PADDING = 8
"""Bytes behind an image that may be read, too."""


class _Memory:
    """An `ecat_t`. It is closed when no image of a last sample in it is used any more."""

    def __init__(self, bus: bytes) -> None:
        pointer = ctypes.c_void_p()
        code = WAITING.ecat_open(ctypes.byref(pointer), bus)
        self.address: int = pointer.value or 0
        if code != 0:
            raise _error(self.address, code)

    def __del__(self, close: object = QUICK.ecat_close) -> None:
        close(self.address)  # type: ignore[operator]


def _error(address: int, code: int) -> EcatError:
    return ERRORS.get(code, EcatError)(text_of(QUICK.ecat_error(address)))


def text_of(data: bytes) -> str:
    """A text of the shared memory."""
    return data.decode("utf-8", "replace")


class Connection:
    """A connection to one bus; belongs to one thread at a time.

    Args:
        bus: Name of the bus.
        renewed: Called after the daemon was started again, when places in the image and units may
            have changed.

    Attributes:
        bus: Name of the bus.
        images: The last sample of each domain in place, with `PADDING` bytes behind it.
        instance: 64 bits that differ after each start of the daemon, as last seen.
        unsure: Whether a call has failed since `instance` was read: the daemon may be another one.

    Raises:
        UnreachableError: No daemon serves the bus.
        NotPermittedError: This user may not read it.
        StateError: The daemon has another version.
    """

    # The first argument of every function of `ecat.h`. The attribute does not exist while a thread
    # waits in a call, nor after `close`. So calls of other threads fail without a check in each of
    # them: see `__getattr__`.
    address: int

    def __init__(self, bus: str, renewed: Callable[[], None] = lambda: None) -> None:
        self.bus = bus
        self._memory: _Memory | None = None
        self._memory = _Memory(text("bus", bus))
        self.address = self._memory.address
        self._renewed = renewed
        self._gone = False  # the daemon was not there at the last attempt
        self.unsure = False
        self.instance = int(QUICK.ecat_instance(self.address))
        self.images = self._find_images()

    @property
    def closed(self) -> bool:
        """Whether `close` was called."""
        return self._memory is None

    def close(self) -> None:
        """Releases all outputs and forgets the bus.

        Raises:
            UsageError: Another thread waits with this connection.
        """
        if self._memory is not None:
            QUICK.ecat_release_all(self.address)
            del self.address
            self._memory = None
            self.images = []

    def __getattr__(self, name: str) -> NoReturn:
        if name == "address":
            raise self._unusable()
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def _unusable(self) -> EcatError:
        if self._memory is None:
            return StateError(f"this client of bus '{self.bus}' is closed; make a new one")
        return UsageError(
            f"another thread is waiting with this client of bus '{self.bus}': "
            f"a client belongs to one thread, so open one for each"
        )

    # --- calls of the C client --------------------------------------------------------------------

    def fail(self, code: int) -> NoReturn:
        """Raises the error that a code stands for."""
        assert self._memory is not None
        self._gone = code == Errno.EDOWN
        self.unsure = True
        raise _error(self._memory.address, code)

    def check(self, code: int) -> int:
        """The result of a call. If it is negative, raises the error that it stands for."""
        if code < 0:
            self.fail(code)
        return code

    def check_live(self, code: int) -> int:
        """Checks the result of a call that needs the daemon, and finds it again after a restart."""
        if code < 0:
            self.fail(code)
        if self.unsure:
            self._gone = self.unsure = False
            instance = int(QUICK.ecat_instance(self.address))
            if instance != self.instance:
                self.instance = instance
                self.images = self._find_images()
                self._renewed()
        return code

    @contextmanager
    def waiting(self) -> Iterator[int]:
        """Keeps other threads out while this one waits without the GIL; yields `address`."""
        taken = True
        try:  # inside the `try`, since Ctrl-C may come at any place
            address = vars(self).pop("address", 0)
            if not address:
                taken = False
                raise self._unusable()
            yield address
        finally:
            if taken and self._memory is not None:
                self.address = self._memory.address

    def ask_engine(self, function: Callable[..., int], *arguments: float) -> None:
        """Changes who owns outputs; the engine answers at the end of a cycle."""
        with self.waiting() as address:
            code = function(address, *arguments)
        self.check_live(code)

    def wait(self, function: Callable[..., int], name: str, timeout: float, *what: int) -> None:
        """Waits in a function of the C client whose last argument is a timeout.

        Args:
            function: Of `WAITING`.
            name: What the call waits for, for the message.
            timeout: Seconds.
            what: Arguments of the function, none negative.

        Raises:
            NoAnswerError: It did not come in time.
            UnreachableError: The daemon has ended, or is not back in time.
            UsageError: An argument is negative.
        """
        if any(number < 0 for number in what):
            raise UsageError(f"{min(what)} is not a number to wait for: give 0 or more")
        end = time.monotonic() + timeout
        gone = self._gone
        with self.waiting() as address:
            while True:
                # A thread may be stopped, and go on long after the time-out.
                left = max(end - time.monotonic(), 0) if timeout > 0 else timeout
                code = function(address, *what, min(left, _SLICE))
                in_vain = code == Errno.ETIMEOUT or (gone and code == Errno.EDOWN)
                if not (in_vain and left > _SLICE):
                    break
        if code == Errno.ETIMEOUT:
            raise NoAnswerError(
                f"bus '{self.bus}': the {name} that was waited for did not come within "
                f"{Timeout(timeout, 'timeout')}"
            )
        self.check_live(code)

    def summarize(
        self,
        signals: ctypes.Array[ctypes.c_int],
        found: ctypes.Array[SummaryStruct],
        cycles: int,
        timeout: float,
    ) -> None:
        """Looks at entries for some cycles; see `Client.summarize`."""
        with self.waiting() as address:
            code = WAITING.ecat_summarize(address, signals, len(signals), cycles, timeout, found)
        if code == Errno.ETIMEOUT:
            raise NoAnswerError(
                f"bus '{self.bus}': no cycle came within {Timeout(timeout, 'timeout')}"
            )
        self.check_live(code)

    # --- what several parts of a client ask -------------------------------------------------------

    @property
    def cycle(self) -> int:
        """Number of the last finished cycle."""
        return int(QUICK.ecat_cycle(self.address))

    def wait_cycles(self, cycles: int, timeout: float) -> None:
        """Waits for the end of so many more cycles than at the last sample or wait; see `wait`."""
        self.wait(WAITING.ecat_wait, "cycle", timeout, cycles)

    def signal(self, number: int) -> SignalStruct:
        """The description of an entry from the daemon.

        Raises:
            UsageError: There is no entry with this number.
        """
        raw = SignalStruct()
        self.check(QUICK.ecat_signal(self.address, number, ctypes.byref(raw)))
        return raw

    def lookup(self, name: str, direction: int = Direction.ANY) -> int:
        """The number of an entry by name: "slave/entry"; raises `StateError` without one."""
        return self.check(QUICK.ecat_lookup(self.address, text("what", name), direction))

    def image(self, domain: int) -> memoryview:
        """The last sample of a domain in place, and padding; it keeps the memory alive.

        Raises:
            UsageError: There is no such domain.
        """
        size = ctypes.c_size_t()
        address = QUICK.ecat_image(self.address, domain, ctypes.byref(size))
        if not address:
            self.fail(Errno.EARG)
        data = (ctypes.c_char * (size.value + PADDING)).from_address(address)
        data.memory = self._memory  # type: ignore[attr-defined]
        return memoryview(data).cast("B").toreadonly()

    def _find_images(self) -> list[memoryview]:
        return [self.image(domain) for domain in range(QUICK.ecat_domain_count(self.address))]

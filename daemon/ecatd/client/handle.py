"""The functions of `ecat.h` as methods, with exceptions in the place of codes.

Entries are named by their handles, which are numbers; `Client` has objects for them.
"""

from __future__ import annotations

import ctypes
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import NoReturn, Self

from ecatd import shm
from ecatd.model.errors import (
    EcatError,
    LeaseError,
    NoAnswerError,
    NotPermittedError,
    OwnedError,
    SdoAbortError,
    StateError,
    UnreachableError,
    UsageError,
)
from ecatd.shm import Direction, Errno

from .info import DomainInfo, SlaveInfo
from .structs import QUICK, WAITING, DomainStruct, SignalStruct, SlaveStruct

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
}
_SLICE = 0.1
"""Seconds that a call waits at most before Python may look for signals such as Ctrl-C."""

_PADDING = 8
"""Bytes behind an image that may be read."""


class _Connection:
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


class Handle:
    """A connection to one bus; belongs to one thread at a time.

    Args:
        bus: Name of the bus.

    Raises:
        UnreachableError: No daemon serves the bus.
        NotPermittedError: This user may not read it.
        StateError: The daemon has another version.
    """

    def __init__(self, bus: str = "ecat0") -> None:
        self._connection: _Connection | None = _Connection(bus)
        self._name = bus
        self._waits = threading.Lock()  # held while a thread waits in a call
        self._gone = False  # the daemon was not there when it was last looked for
        self._unsure = False  # the daemon may be another one than before
        self._instance = int(QUICK.ecat_instance(self._address))

    def close(self) -> None:
        """Releases all claims and forgets the bus.

        Raises:
            UsageError: Another thread waits with this client.
        """
        if self._connection is not None:
            QUICK.ecat_release_all(self._address)
            self._connection = None

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

    @property
    def _address(self) -> int:
        if self._connection is None or self._waits.locked():
            raise self._unusable()
        return self._connection.address

    def _unusable(self) -> EcatError:
        if self._connection is None:
            return StateError(f"this client of bus '{self._name}' is closed; make a new one")
        return UsageError(
            f"another thread is waiting with this client of bus '{self._name}': "
            f"a client belongs to one thread, so open one for each"
        )

    def _fail(self, code: int) -> NoReturn:
        """Raises what a code stands for."""
        assert self._connection is not None
        self._gone = code == Errno.EDOWN
        self._unsure = True
        raise _error(self._connection.address, code)

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
        address = self._address
        if not self._waits.acquire(blocking=False):
            raise self._unusable()
        try:
            yield address
        finally:
            self._waits.release()

    def _ring(self, function: Callable[..., int], *arguments: float) -> None:
        """Changes claims; the engine answers at the end of a cycle."""
        with self._waiting() as address:
            code = function(address, *arguments)
        self._live(code)

    # --- the bus ----------------------------------------------------------------------------------

    @property
    def fingerprint(self) -> int:
        """64 bits that differ when the bus is another one."""
        return int(QUICK.ecat_fingerprint(self._address))

    @property
    def instance(self) -> int:
        """64 bits that differ after each start of the daemon."""
        return int(QUICK.ecat_instance(self._address))

    @property
    def cycle_time(self) -> float:
        """Base cycle in seconds."""
        return float(QUICK.ecat_cycle_time(self._address))

    @property
    def cycle(self) -> int:
        """Number of the last finished cycle."""
        return int(QUICK.ecat_cycle(self._address))

    def slaves(self) -> list[SlaveInfo]:
        """All slaves, with their present state."""
        address, raw = self._address, SlaveStruct()
        found = []
        for position in range(QUICK.ecat_slave_count(address)):
            self._check(QUICK.ecat_slave(address, position, ctypes.byref(raw)))
            found.append(
                SlaveInfo(
                    position,
                    text_of(raw.name),
                    raw.vendor,
                    raw.product,
                    raw.revision,
                    raw.serial,
                    raw.al_state,
                    raw.al_code,
                    raw.domain,
                    bool(raw.has_outputs),
                    shm.Outputs(raw.outputs),
                    bool(raw.owned),
                )
            )
        return found

    def expect(self, position: int, vendor: int, product: int, revision: int = 0) -> None:
        """Raises `StateError` unless the slave at `position` is this one (revision 0: any)."""
        self._check(QUICK.ecat_expect(self._address, position, vendor, product, revision))

    def find(self, vendor: int, product: int, nth: int = 0) -> int:
        """The position of the `nth` slave with this identity; raises `StateError` without one."""
        return self._check(QUICK.ecat_find(self._address, vendor, product, nth))

    def find_name(self, name: str) -> int:
        """The position of the only slave with this name; raises `StateError` without one."""
        return self._check(QUICK.ecat_find_name(self._address, name.encode()))

    def bind(
        self, position: int, index: int, subindex: int = 0, direction: int = Direction.ANY
    ) -> int:
        """The handle of an entry; raises `StateError` if the slave has none such."""
        return self._check(QUICK.ecat_bind(self._address, position, index, subindex, direction))

    def lookup(self, name: str, direction: int = Direction.ANY) -> int:
        """The handle of an entry by name: "slave/entry"; raises `StateError` without one."""
        return self._check(QUICK.ecat_lookup(self._address, name.encode(), direction))

    def _signal_count(self) -> int:
        return int(QUICK.ecat_signal_count(self._address))

    def _signal_struct(self, number: int) -> SignalStruct:
        raw = SignalStruct()
        self._check(QUICK.ecat_signal(self._address, number, ctypes.byref(raw)))
        return raw

    # --- the image --------------------------------------------------------------------------------

    def sample(self) -> None:
        """Takes one consistent image of every domain; all reads until the next call see it.

        It is also the heartbeat that keeps the outputs which this client owns.

        Raises:
            UnreachableError: The daemon no longer delivers; the last values stay readable.
            StateError: The daemon was started again, with another bus.
        """
        self._live(QUICK.ecat_sample(self._address))

    def sample_domain(self, number: int) -> None:
        """The same for one domain; what was read of the others stays."""
        self._live(QUICK.ecat_sample_domain(self._address, number))

    def domain(self, number: int = 0) -> DomainInfo:
        """What is known about the last sample of a domain."""
        raw = DomainStruct()
        self._check(QUICK.ecat_domain(self._address, number, ctypes.byref(raw)))
        return DomainInfo(
            text_of(raw.name),
            raw.divider,
            raw.cycle,
            raw.time_ns,
            raw.age,
            raw.wkc,
            raw.wkc_expected,
            shm.WkcState(raw.wkc_state),
        )

    def _image(self, number: int) -> memoryview:
        """The last sample of a domain in place, and padding; it keeps the connection alive."""
        size = ctypes.c_size_t()
        address = QUICK.ecat_image(self._address, number, ctypes.byref(size))
        if not address:
            self._fail(Errno.EARG)
        memory = (ctypes.c_char * (size.value + _PADDING)).from_address(address)
        memory.connection = self._connection  # type: ignore[attr-defined]
        return memoryview(memory).cast("B").toreadonly()

    def validity(self, signal: int) -> shm.Validity:
        """What an entry of the last sample is worth."""
        return shm.Validity(self._check(QUICK.ecat_validity(self._address, signal)))

    def read(self, signal: int) -> float:
        """Raw value of the last sample: exact for up to 53 bits."""
        value = ctypes.c_double()
        self._check(QUICK.ecat_read(self._address, signal, ctypes.byref(value)))
        return value.value

    def read_int(self, signal: int) -> int:
        """Raw value as signed integer of 64 bits."""
        value = ctypes.c_int64()
        self._check(QUICK.ecat_read_int(self._address, signal, ctypes.byref(value)))
        return value.value

    def read_physical(self, signal: int) -> float:
        """Raw value * scale + offset, in the signal's unit."""
        value = ctypes.c_double()
        self._check(QUICK.ecat_read_physical(self._address, signal, ctypes.byref(value)))
        return value.value

    # --- outputs ----------------------------------------------------------------------------------

    def claim_slave(self, position: int, lease: float = 0.0) -> None:
        """Claims all outputs of a slave, or none; see `Client.claim`."""
        self._ring(WAITING.ecat_claim, position, lease)

    def release_slave(self, position: int) -> None:
        """Gives the outputs of a slave back; they go to their safe values."""
        self._ring(WAITING.ecat_release, position)

    def claim_entry(self, signal: int, lease: float = 0.0) -> None:
        """Claims one output."""
        self._ring(WAITING.ecat_claim_entry, signal, lease)

    def release_entry(self, signal: int) -> None:
        """Gives one output back."""
        self._ring(WAITING.ecat_release_entry, signal)

    def write(self, signal: int, value: float) -> None:
        """Stages a raw value; raises `UsageError` if it does not fit the entry."""
        self._check(QUICK.ecat_write(self._address, signal, value))

    def write_int(self, signal: int, value: int) -> None:
        """Stages a raw integer; one of 64 bits may be given signed or unsigned."""
        if not -(1 << 63) <= value < 1 << 64:
            raise UsageError(f"{value} does not fit 64 bits")
        self._check(QUICK.ecat_write_int(self._address, signal, value))

    def write_physical(self, signal: int, value: float) -> None:
        """Stages a physical value."""
        self._check(QUICK.ecat_write_physical(self._address, signal, value))

    def commit(self) -> None:
        """Publishes all staged outputs at once; they go out with the next cycle.

        Raises:
            LeaseError: This client has lost its outputs; claim them again.
        """
        self._check(QUICK.ecat_commit(self._address))

    # --- waiting ----------------------------------------------------------------------------------

    def wait(self, cycles: int = 1, timeout: float = 1.0) -> None:
        """Waits for the end of so many more cycles than at the last sample or wait.

        Args:
            cycles: How many.
            timeout: Seconds.

        Raises:
            NoAnswerError: They did not come in time.
            UnreachableError: The daemon has ended (told within 100 ms), or is not back in time.
        """
        self._wait(WAITING.ecat_wait, "cycle", timeout, cycles)

    def wait_domain(self, number: int, exchanges: int = 1, timeout: float = 1.0) -> None:
        """The same for so many more exchanges of a domain."""
        self._wait(WAITING.ecat_wait_domain, "exchange", timeout, number, exchanges)

    def _wait(self, function: Callable[..., int], name: str, timeout: float, *what: int) -> None:
        if any(number < 0 for number in what):
            raise UsageError(f"{min(what)} is nothing to wait for")
        end = time.monotonic() + timeout
        gone = self._gone
        with self._waiting() as address:
            while True:
                left = end - time.monotonic() if timeout > 0 else timeout
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

    # --- requests ---------------------------------------------------------------------------------

    def sdo_start(self, position: int, index: int, subindex: int, data: bytes | None = None) -> int:
        """Starts an SDO upload, or a download of `data`; returns the handle of the request."""
        length = len(data) if data is not None else 0
        return self._live(
            QUICK.ecat_sdo_start(self._address, position, index, subindex, data, length)
        )

    def state_start(self, position: int, state: int) -> int:
        """Asks for an AL state of a slave (1 INIT, 2 PREOP, 4 SAFEOP, 8 OP); returns the handle."""
        return self._live(QUICK.ecat_state_start(self._address, position, state))

    def poll(self, request: int) -> bytes | None:
        """What was uploaded, or None while the request runs.

        Raises:
            SdoAbortError: The slave refused.
        """
        buffer = ctypes.create_string_buffer(shm.REQUEST_BYTES)
        length, abort = ctypes.c_size_t(), ctypes.c_uint32()
        code = QUICK.ecat_poll(
            self._address,
            request,
            buffer,
            len(buffer),
            ctypes.byref(length),
            ctypes.byref(abort),
        )
        if code == Errno.EBUSY:
            return None
        if code == Errno.EABORT:
            raise SdoAbortError(abort.value, text_of(QUICK.ecat_error(self._address)))
        self._check(code)
        return buffer.raw[: length.value]

    def wait_request(self, request: int, timeout: float) -> None:
        """Waits until `poll` has an answer. Nothing is sampled meanwhile: a lease goes on running.

        Raises:
            NoAnswerError: It has not come in time.
        """
        self._wait(WAITING.ecat_wait_request, "answer", timeout, request)

    def cancel(self, request: int) -> None:
        """Gives a request up; the slave may have been asked already."""
        self._check(QUICK.ecat_cancel(self._address, request))

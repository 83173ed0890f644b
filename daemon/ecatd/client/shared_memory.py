"""The process image from Python, through the C client (`client_c`).

```python
with Client("ecat0") as bus:
    bus.claim(0)
    target, velocity = bus.bind(0, 0x60FF), bus.bind(0, 0x606C)
    bus.wait()
    bus.sample()
    print(bus.read(velocity))
    bus.write(target, 1000)
    bus.commit()
```
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from ecatd import shm
from ecatd.model.errors import (
    EcatError,
    NoAnswerError,
    NotPermittedError,
    SdoAbortError,
    StateError,
    UnreachableError,
    UsageError,
)
from ecatd.shm import Direction, Errno

INPUT, OUTPUT, ANY = Direction

_ERRORS: dict[int, type[EcatError]] = {
    Errno.EARG: UsageError,
    Errno.EDOWN: UnreachableError,
    Errno.ELAYOUT: StateError,
    Errno.EPERM: NotPermittedError,
    Errno.EBUS: StateError,
    Errno.ESIGNAL: StateError,
    Errno.EOWNED: StateError,
    Errno.ECLAIM: StateError,
    Errno.ELEASE: StateError,
    Errno.ERANGE: UsageError,
    Errno.ETIMEOUT: NoAnswerError,
    Errno.ESTALE: UnreachableError,
    Errno.EFULL: StateError,
    Errno.ESYS: EcatError,
}


class _SlaveInfo(ctypes.Structure):
    """`ecat_slave_info` of `ecat.h`."""

    _fields_ = (
        ("vendor", ctypes.c_uint32),
        ("product", ctypes.c_uint32),
        ("revision", ctypes.c_uint32),
        ("serial", ctypes.c_uint32),
        ("name", ctypes.c_char_p),
        ("al_state", ctypes.c_uint),
        ("al_code", ctypes.c_uint),
        ("domain", ctypes.c_int),
        ("has_outputs", ctypes.c_int),
        ("outputs", ctypes.c_int),
        ("owned", ctypes.c_int),
    )


class _SignalInfo(ctypes.Structure):
    """`ecat_signal_info` of `ecat.h`."""

    _fields_ = (
        ("slave", ctypes.c_int),
        ("index", ctypes.c_uint),
        ("subindex", ctypes.c_uint),
        ("output", ctypes.c_int),
        ("type", ctypes.c_uint),
        ("bit_length", ctypes.c_uint),
        ("domain", ctypes.c_int),
        ("bit_offset", ctypes.c_uint),
        ("scale", ctypes.c_double),
        ("offset", ctypes.c_double),
        ("minimum", ctypes.c_double),
        ("maximum", ctypes.c_double),
        ("pdo", ctypes.c_uint),
        ("pdo_name", ctypes.c_char_p),
        ("name", ctypes.c_char_p),
        ("unit", ctypes.c_char_p),
    )


class _OutputInfo(ctypes.Structure):
    """`ecat_output_info` of `ecat.h`."""

    _fields_ = (
        ("owner", ctypes.c_int),
        ("owned", ctypes.c_int),
        ("state", ctypes.c_int),
        ("reason", ctypes.c_int),
        ("since_cycle", ctypes.c_uint64),
        ("age", ctypes.c_double),
        ("pid", ctypes.c_uint),
        ("program", ctypes.c_char * 33),
    )


class _DomainInfo(ctypes.Structure):
    """`ecat_domain_info` of `ecat.h`."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("divider", ctypes.c_uint),
        ("cycle", ctypes.c_uint64),
        ("time_ns", ctypes.c_uint64),
        ("age", ctypes.c_double),
        ("wkc", ctypes.c_uint),
        ("wkc_expected", ctypes.c_uint),
        ("wkc_state", ctypes.c_int),
    )


@dataclass(frozen=True, slots=True)
class SlaveInfo:
    """One slave: identity, AL status register and code, and who decides its outputs."""

    position: int
    name: str
    vendor: int
    product: int
    revision: int
    serial: int
    al_state: int
    al_code: int
    domain: int
    has_outputs: bool
    outputs: shm.Outputs
    owned: bool


@dataclass(frozen=True, slots=True)
class Signal:
    """One PDO entry; `number` is the handle for `Client.read` and `Client.write`."""

    number: int
    slave: int
    index: int
    subindex: int
    output: bool
    data_type: int
    bit_length: int
    domain: int
    bit_offset: int
    scale: float
    offset: float
    minimum: float
    maximum: float
    pdo: int
    pdo_name: str
    name: str
    unit: str

    @property
    def address(self) -> str:
        """The address as it is always printed: `0x6060:00`."""
        return f"0x{self.index:04X}:{self.subindex:02X}"


@dataclass(frozen=True, slots=True)
class DomainInfo:
    """The last sample of a domain: cycle, CLOCK_MONOTONIC in ns, age in seconds, counters."""

    name: str
    divider: int
    cycle: int
    time_ns: int
    age: float
    wkc: int
    wkc_expected: int
    wkc_state: shm.WkcState


def _library() -> ctypes.CDLL:
    lib = shm.LIBRARY
    bus, i, u, d = ctypes.c_void_p, ctypes.c_int, ctypes.c_uint, ctypes.c_double
    pointer = ctypes.c_void_p
    signatures: dict[str, tuple[object, list[object]]] = {
        "open": (i, [pointer, ctypes.c_char_p]),
        "close": (None, [bus]),
        "error": (ctypes.c_char_p, [bus]),
        "slave_count": (i, [bus]),
        "signal_count": (i, [bus]),
        "domain_count": (i, [bus]),
        "fingerprint": (ctypes.c_uint64, [bus]),
        "cycle_time": (d, [bus]),
        "slave": (i, [bus, i, pointer]),
        "signal": (i, [bus, i, pointer]),
        "find": (i, [bus, ctypes.c_uint32, ctypes.c_uint32, u]),
        "expect": (i, [bus, i, ctypes.c_uint32, ctypes.c_uint32, ctypes.c_uint32]),
        "bind": (i, [bus, i, u, u, i]),
        "claim": (i, [bus, i, d]),
        "release": (i, [bus, i]),
        "sample": (i, [bus]),
        "sample_domain": (i, [bus, i]),
        "domain": (i, [bus, i, pointer]),
        "read": (i, [bus, i, pointer]),
        "read_int": (i, [bus, i, pointer]),
        "read_physical": (i, [bus, i, pointer]),
        "write": (i, [bus, i, d]),
        "write_int": (i, [bus, i, ctypes.c_int64]),
        "write_physical": (i, [bus, i, d]),
        "commit": (i, [bus]),
        "wait": (i, [bus, u, d]),
        "cycle": (ctypes.c_uint64, [bus]),
        "wait_domain": (i, [bus, i, u, d]),
        "lookup": (i, [bus, ctypes.c_char_p, i]),
        "validity": (i, [bus, i]),
        "claim_entry": (i, [bus, i, d]),
        "release_entry": (i, [bus, i]),
        "output": (i, [bus, i, pointer]),
        "state_start": (i, [bus, i, u]),
        "sdo_start": (i, [bus, i, u, u, ctypes.c_char_p, ctypes.c_size_t]),
        "poll": (i, [bus, i, pointer, ctypes.c_size_t, pointer, pointer]),
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(lib, f"ecat_{name}")
        function.restype = result
        function.argtypes = arguments
    return lib


_LIB = _library()


class Client:
    """A connection to one bus; see `ecat.h` for the contract of each call.

    Args:
        bus: Name of the bus.

    Raises:
        UnreachableError: No daemon serves the bus.
        NotPermittedError: This user may not read it.
    """

    def __init__(self, bus: str = "ecat0") -> None:
        handle = ctypes.c_void_p()
        code = _LIB.ecat_open(ctypes.byref(handle), bus.encode())
        self._handle: ctypes.c_void_p | None = handle
        if code != 0:
            error = self._error(code)
            self.close()
            raise error
        self.name = bus

    def _error(self, code: int) -> EcatError:
        text = _LIB.ecat_error(self._bus).decode("utf-8", "replace")
        return _ERRORS.get(code, EcatError)(text)

    def _check(self, code: int) -> int:
        if code < 0:
            raise self._error(code)
        return code

    @property
    def _bus(self) -> ctypes.c_void_p:
        if self._handle is None:
            raise StateError("this client is closed")
        return self._handle

    def close(self) -> None:
        """Releases all claims and forgets the bus."""
        if self._handle is not None:
            _LIB.ecat_close(self._handle)
            self._handle = None

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
    def fingerprint(self) -> int:
        """64 bits that differ when the bus is another one."""
        return int(_LIB.ecat_fingerprint(self._bus))

    @property
    def cycle_time(self) -> float:
        """Base cycle in seconds."""
        return float(_LIB.ecat_cycle_time(self._bus))

    @property
    def cycle(self) -> int:
        """Number of the last finished cycle."""
        return int(_LIB.ecat_cycle(self._bus))

    def slaves(self) -> list[SlaveInfo]:
        """All slaves, with their present state."""
        found = []
        for position in range(_LIB.ecat_slave_count(self._bus)):
            raw = _SlaveInfo()
            self._check(_LIB.ecat_slave(self._bus, position, ctypes.byref(raw)))
            found.append(
                SlaveInfo(
                    position,
                    raw.name.decode("utf-8", "replace"),
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

    def signals(self) -> list[Signal]:
        """All entries of the process image."""
        return [self.signal(n) for n in range(_LIB.ecat_signal_count(self._bus))]

    def signal(self, number: int) -> Signal:
        """What is known about an entry."""
        raw = _SignalInfo()
        self._check(_LIB.ecat_signal(self._bus, number, ctypes.byref(raw)))
        return Signal(
            number,
            raw.slave,
            raw.index,
            raw.subindex,
            bool(raw.output),
            raw.type,
            raw.bit_length,
            raw.domain,
            raw.bit_offset,
            raw.scale,
            raw.offset,
            raw.minimum,
            raw.maximum,
            raw.pdo,
            raw.pdo_name.decode("utf-8", "replace"),
            raw.name.decode("utf-8", "replace"),
            raw.unit.decode("utf-8", "replace"),
        )

    def expect(self, position: int, vendor: int, product: int, revision: int = 0) -> None:
        """Raises `StateError` unless the slave at `position` is this one (revision 0: any)."""
        self._check(_LIB.ecat_expect(self._bus, position, vendor, product, revision))

    def find(self, vendor: int, product: int, nth: int = 0) -> int:
        """The position of the `nth` slave with this identity; raises `StateError` without one."""
        return self._check(_LIB.ecat_find(self._bus, vendor, product, nth))

    def bind(self, position: int, index: int, subindex: int = 0, direction: int = ANY) -> int:
        """The handle of an entry; raises `StateError` if the slave has none such."""
        return self._check(_LIB.ecat_bind(self._bus, position, index, subindex, direction))

    def claim(self, position: int, lease: float = 0.0) -> None:
        """Becomes the owner of a slave's outputs; `lease` in seconds, 0 for the default."""
        self._check(_LIB.ecat_claim(self._bus, position, lease))

    def release(self, position: int) -> None:
        """Gives the outputs back; they go to their safe values."""
        self._check(_LIB.ecat_release(self._bus, position))

    def sample(self) -> None:
        """Takes one consistent image of every domain; all reads until the next call see it."""
        self._check(_LIB.ecat_sample(self._bus))

    def sample_domain(self, number: int) -> None:
        """The same for one domain; what was read of the others stays."""
        self._check(_LIB.ecat_sample_domain(self._bus, number))

    def domain(self, number: int = 0) -> DomainInfo:
        """What is known about the last sample of a domain."""
        raw = _DomainInfo()
        self._check(_LIB.ecat_domain(self._bus, number, ctypes.byref(raw)))
        return DomainInfo(
            raw.name.decode("utf-8", "replace"),
            raw.divider,
            raw.cycle,
            raw.time_ns,
            raw.age,
            raw.wkc,
            raw.wkc_expected,
            shm.WkcState(raw.wkc_state),
        )

    def read(self, signal: int) -> float:
        """Raw value of the last sample."""
        value = ctypes.c_double()
        self._check(_LIB.ecat_read(self._bus, signal, ctypes.byref(value)))
        return value.value

    def read_int(self, signal: int) -> int:
        """Raw value as integer."""
        value = ctypes.c_int64()
        self._check(_LIB.ecat_read_int(self._bus, signal, ctypes.byref(value)))
        return value.value

    def read_physical(self, signal: int) -> float:
        """Raw value * scale + offset, in the signal's unit."""
        value = ctypes.c_double()
        self._check(_LIB.ecat_read_physical(self._bus, signal, ctypes.byref(value)))
        return value.value

    def write(self, signal: int, value: float) -> None:
        """Stages a raw value; raises `UsageError` if it does not fit the entry."""
        self._check(_LIB.ecat_write(self._bus, signal, value))

    def write_int(self, signal: int, value: int) -> None:
        """Stages a raw integer."""
        if not -(1 << 63) <= value < 1 << 64:
            raise UsageError(f"{value} does not fit 64 bits")
        self._check(_LIB.ecat_write_int(self._bus, signal, ctypes.c_int64(value).value))

    def write_physical(self, signal: int, value: float) -> None:
        """Stages a physical value."""
        self._check(_LIB.ecat_write_physical(self._bus, signal, value))

    def commit(self) -> None:
        """Publishes all staged outputs at once; they go out with the next cycle."""
        self._check(_LIB.ecat_commit(self._bus))

    def wait(self, cycles: int = 1, timeout: float = 1.0) -> None:
        """Waits for the end of so many more cycles; raises when they do not come in time."""
        self._check(_LIB.ecat_wait(self._bus, cycles, timeout))

    def sdo_start(self, position: int, index: int, subindex: int, data: bytes | None = None) -> int:
        """Starts an SDO upload, or a download of `data`; returns the handle of the request."""
        length = len(data) if data is not None else 0
        return self._check(_LIB.ecat_sdo_start(self._bus, position, index, subindex, data, length))

    def poll(self, request: int) -> bytes | None:
        """What was uploaded, or None while the request runs.

        Raises:
            SdoAbortError: The slave refused.
        """
        buffer = ctypes.create_string_buffer(512)
        length, abort = ctypes.c_size_t(), ctypes.c_uint32()
        code = _LIB.ecat_poll(
            self._bus, request, buffer, 512, ctypes.byref(length), ctypes.byref(abort)
        )
        if code == Errno.EBUSY:
            return None
        if code == Errno.EABORT:
            raise SdoAbortError(abort.value, _LIB.ecat_error(self._bus).decode("utf-8", "replace"))
        self._check(code)
        return buffer.raw[: length.value]

"""The functions of `ecat.h` as methods, with exceptions in the place of codes.

Entries are named by their handles, which are numbers; `Client` has objects for them.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence

from ecatd import shm
from ecatd.model.errors import SdoAbortError, UsageError
from ecatd.shm import Direction, Errno

from .connection import Connection, text_of
from .info import DomainInfo, SlaveInfo
from .structs import QUICK, WAITING, DomainStruct, SignalStruct, SlaveStruct

_VALIDITIES = tuple(shm.Validity)


class Handle(Connection):
    """A connection to one bus; belongs to one thread at a time.

    Args:
        bus: Name of the bus.

    Raises:
        UnreachableError: No daemon serves the bus.
        NotPermittedError: This user may not read it.
        StateError: The daemon has another version.
    """

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

    def validity(self, signal: int) -> shm.Validity:
        """What an entry of the last sample is worth."""
        code: int = QUICK.ecat_validity(self._address, signal)
        return _VALIDITIES[code] if code >= 0 else self._fail(code)

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

    def claim_entries(self, signals: Sequence[int], lease: float = 0.0) -> None:
        """Claims outputs, which may be of several slaves: all at once, or none."""
        numbers = (ctypes.c_int * len(signals))(*signals)
        self._ring(WAITING.ecat_claim_entries, ctypes.addressof(numbers), len(signals), lease)

    def release_entries(self, signals: Sequence[int]) -> None:
        """Gives outputs back, all in the same cycle."""
        numbers = (ctypes.c_int * len(signals))(*signals)
        self._ring(WAITING.ecat_release_entries, ctypes.addressof(numbers), len(signals))

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

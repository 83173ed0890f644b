"""The links of a segment: cables, power, the path of frames, frame faults (see `Segment`)."""

from __future__ import annotations

import ctypes
import errno
import os
from dataclasses import dataclass
from enum import IntEnum

from ecatd.base.errors import EcatError, StateError, UsageError

MAX_FAULTS = 32
MAX_SLAVES = 1024


class FaultKind(IntEnum):
    """The effect of a fault on a frame (enum esc_fault_kind); `value` is that of the `FrameFault`.

    Attributes:
        DROP: The frame is lost, on the way to the first slave (value 0) or on the way back (1).
        DELAY: The frame comes back `value` ns late, and other frames may overtake it. At most 64
            frames can be under way at a time; further ones are lost.
        DUPLICATE: The frame comes back twice.
        CORRUPT: The frame comes back with `value` adjacent bits inverted (0 counts as 1).
        NOISE: The frame is damaged on its way to `slave`, which counts an invalid frame and an RX
            error (0x0300). The ports behind it count forwarded errors (0x0308), and the processing
            units that the frame still passes count it at 0x030C. The master does not get the frame.
            A frame that does not reach that slave is not damaged.
        WKC: The frame comes back with `value` added to the working counter of each logical
            datagram.
    """

    DROP = 0
    DELAY = 1
    DUPLICATE = 2
    CORRUPT = 3
    NOISE = 4
    WKC = 5


@dataclass(frozen=True, slots=True)
class FrameFault:
    """A fault of frames, which strikes the same frames in every run.

    It can strike frames in the cycles `first`, `first + every`, and so on. A cycle begins with a
    frame at the first interface whose first logical datagram has an address not above that of the
    previous process data frame. Cycles are numbered from 1, as in `Counters.cycles`; frames before
    the first cycle belong to cycle 0.

    Attributes:
        kind: Effect on the frames.
        first: The first cycle in which it may strike.
        count: Largest number of frames that it strikes; 0 = no limit.
        every: Number of cycles from one in which it may strike to the next.
        probability: Probability with which it strikes a frame, 0 to 1.
        seed: Seed of chance, which also depends on the cycle and the place of the frame in it.
        slave: The slave in front of which noise damages frames.
        value: Parameter in ns, bits or counts; see `FaultKind`.
        process_data_only: Whether frames without logical datagrams are left alone.
    """

    kind: FaultKind
    first: int = 0
    count: int = 1
    every: int = 1
    probability: float = 1.0
    seed: int = 1
    slave: int = 0
    value: int = 0
    process_data_only: bool = True


@dataclass(frozen=True, slots=True)
class InjectedFault:
    """A fault that was added to the segment.

    Attributes:
        id: Number that `inject` returned.
        fault: The fault.
        struck: Number of frames that it has struck.
    """

    id: int
    fault: FrameFault
    struck: int


@dataclass(frozen=True, slots=True)
class Passage:
    """The result of passing a frame through the segment.

    Attributes:
        frame: The frame as it leaves.
        exit: The interface through which it leaves, or None if it is lost.
        copies: How many times it leaves.
        delay_ns: Delay in ns by a fault.
    """

    frame: bytes
    exit: int | None
    copies: int
    delay_ns: int


class _Passage(ctypes.Structure):
    _fields_ = (
        ("exit", ctypes.c_int32),
        ("copies", ctypes.c_int32),
        ("delay_ns", ctypes.c_int64),
    )


class _Fault(ctypes.Structure):
    _fields_ = (
        ("id", ctypes.c_int32),
        ("kind", ctypes.c_uint32),
        ("first", ctypes.c_uint64),
        ("every", ctypes.c_uint64),
        ("count", ctypes.c_uint64),
        ("probability", ctypes.c_double),
        ("seed", ctypes.c_uint64),
        ("value", ctypes.c_int64),
        ("slave", ctypes.c_uint32),
        ("process_data_only", ctypes.c_uint32),
        ("struck", ctypes.c_uint64),
    )


def signatures() -> dict[str, tuple[type | None, list[type]]]:
    """Returns result and argument types of the C functions that this module calls."""
    segment, number, buffer = ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p
    size, time = ctypes.c_size_t, ctypes.c_int64
    return {
        "esc_connect": (number, [segment, number, number, number]),
        "esc_exchange_ports": (number, [segment, number]),
        "esc_close_ring": (number, [segment, number, number]),
        "esc_break_link": (number, [segment, number, number, number]),
        "esc_order": (number, [segment, number, ctypes.POINTER(ctypes.c_uint16), number]),
        "esc_power": (number, [segment, number, number]),
        "esc_pass": (number, [segment, number, buffer, size, time, ctypes.POINTER(_Passage)]),
        "esc_inject": (number, [segment, ctypes.POINTER(_Fault)]),
        "esc_clear_faults": (number, [segment, number]),
        "esc_get_faults": (number, [segment, ctypes.POINTER(_Fault), number]),
    }


def checked(result: int) -> int:
    """Returns the result of a C function, or raises the error for a negative one."""
    if result < 0:
        raise EcatError(f"the slave controllers refused a call: {os.strerror(-result)}")
    return result


def _check_fault(fault: FrameFault) -> None:
    limits = (
        ("first", fault.first, 0, 2**64 - 1),
        ("count", fault.count, 0, 2**64 - 1),
        ("every", fault.every, 1, 2**64 - 1),
        ("probability", fault.probability, 0, 1),
        ("seed", fault.seed, 0, 2**64 - 1),
        ("slave", fault.slave, 0, MAX_SLAVES - 1),
    )
    values = {
        FaultKind.DROP: (0, 1),
        FaultKind.DELAY: (0, 10_000_000_000),
        FaultKind.CORRUPT: (0, 8 * 2048),
    }
    value = ("value", fault.value, *values.get(fault.kind, (-(2**63), 2**63 - 1)))
    for name, number, lowest, highest in (*limits, value):
        if not lowest <= number <= highest:
            raise UsageError(
                f"fault {fault.kind.name}: {name} is {number}, use {lowest} to {highest}"
            )


class Handle:
    """The C library and its segment, which all parts of `Segment` share."""

    _lib: ctypes.CDLL
    _pointer: int | None  # None once it is closed

    @property
    def _handle(self) -> int:
        if not self._pointer:
            raise StateError("the segment is closed")
        return self._pointer


class Links(Handle):
    """The methods of `Segment` for cables, power and frames."""

    # --- slaves and links ----------------------------------------------------------------------

    def connect(self, slave: int, parent: int, port: int) -> None:
        """Plugs port 0 of a slave into a port of another one.

        A frame passes port 0, the processing unit, and then the slaves at ports 3, 1 and 2.
        Positions are those of auto-increment addresses only if slaves are added in that order.

        Args:
            slave: Position of the slave.
            parent: Position of the slave nearer to the interface.
            port: Port of the parent, 1 to 3.

        Raises:
            UsageError: There is no such slave or port, the port is taken, or the parent is behind
                the slave.
        """
        result = self._lib.esc_connect(self._handle, slave, parent, port)
        if result == -errno.ELOOP:
            raise UsageError(f"slave {parent} is behind slave {slave}: the links would be a loop")
        self._check_plug(result, slave, parent, port)

    def close_ring(self, slave: int, port: int) -> None:
        """Plugs the second interface into a port of a slave.

        Raises:
            UsageError: There is no such slave or port, or the port is taken.
        """
        self._check_plug(self._lib.esc_close_ring(self._handle, slave, port), slave, slave, port)

    def exchange_ports(self, slave: int) -> None:
        """Exchanges the cables at the ports 0 and 1 of a slave, when all links have been made.

        Raises:
            UsageError: There is no such slave, or it does not have both ports.
        """
        result = self._lib.esc_exchange_ports(self._handle, slave)
        if result == -errno.ENXIO:
            raise UsageError(f"slave {slave} does not have both port 0 and port 1")
        self.check_slave(result, slave)

    def break_link(self, slave: int, port: int, broken: bool) -> None:
        """Breaks or heals a link.

        Args:
            slave: Position of the slave at one end.
            port: Port of this slave, 0 to 3.
            broken: True breaks the link, False heals it.

        Raises:
            UsageError: There is no such slave, or nothing is plugged in there.
        """
        result = self._lib.esc_break_link(self._handle, slave, port, broken)
        if result == -errno.ENOTCONN:
            raise UsageError(f"nothing is plugged into port {port} of slave {slave}")
        self.check_slave(result, slave)

    def order(self, interface: int = 0) -> list[int]:
        """Returns the slaves that process a frame from an interface, 0 or 1, in order."""
        order = (ctypes.c_uint16 * MAX_SLAVES)()
        count = checked(self._lib.esc_order(self._handle, interface, order, MAX_SLAVES))
        return list(order[:count])

    # --- power ---------------------------------------------------------------------------------

    def power(self, slave: int, on: bool) -> None:
        """Switches a slave off, or on again as at its first power-on.

        Off: the links at all its ports go down, and station address, AL state, FMMUs, sync
        managers, memory and pending events are lost. On: the SII image is loaded again. The device
        is not notified.

        Raises:
            UsageError: There is no such slave.
        """
        self.check_slave(self._lib.esc_power(self._handle, slave, on), slave)

    # --- frames --------------------------------------------------------------------------------

    def process(self, frame: bytes) -> bytes | None:
        """Passes an Ethernet frame from the first interface; None if it does not come back there.

        The call does not wait for a delay by a fault; see `enter`.
        """
        passage = self.enter(frame)
        return passage.frame if passage.exit == 0 else None

    def enter(self, frame: bytes, interface: int = 0, now_ns: int = 0) -> Passage:
        """Passes an Ethernet frame through the segment, as its thread does.

        Args:
            frame: The frame, without check sequence.
            interface: The interface through which it enters, 0 or 1.
            now_ns: Time at which it enters (CLOCK_MONOTONIC); 0 = now.
        """
        buffer = ctypes.create_string_buffer(frame, len(frame))
        passage = _Passage()
        checked(self._lib.esc_pass(self._handle, interface, buffer, len(frame), now_ns, passage))
        leaves = passage.exit if passage.exit >= 0 else None
        return Passage(buffer.raw, leaves, passage.copies, passage.delay_ns)

    # --- faults --------------------------------------------------------------------------------

    def inject(self, fault: FrameFault) -> int:
        """Adds a fault and returns its number for `clear`.

        Finished faults stay in the list of `faults` until their place is needed.

        Raises:
            UsageError: A value is out of its range.
            StateError: There are 32 faults already that are not finished.
        """
        _check_fault(fault)
        entry = _Fault(
            0,
            fault.kind,
            fault.first,
            fault.every,
            fault.count,
            fault.probability,
            fault.seed,
            fault.value,
            fault.slave,
            fault.process_data_only,
            0,
        )
        result = self._lib.esc_inject(self._handle, entry)
        if result == -errno.ENOSPC:
            raise StateError(f"a segment has at most {MAX_FAULTS} frame faults: clear one first")
        return self.check_slave(result, fault.slave)

    def clear(self, fault: int | None = None) -> None:
        """Removes a fault by its number, or all faults.

        Raises:
            UsageError: There is no such fault.
        """
        result = self._lib.esc_clear_faults(self._handle, -1 if fault is None else fault)
        if result == -errno.ENOENT:
            raise UsageError(f"there is no frame fault {fault}")
        checked(result)

    def faults(self) -> list[InjectedFault]:
        """Returns the faults, oldest first, each with the number of frames that it has struck."""
        entries = (_Fault * MAX_FAULTS)()
        count = checked(self._lib.esc_get_faults(self._handle, entries, MAX_FAULTS))
        return [
            InjectedFault(
                entry.id,
                FrameFault(
                    FaultKind(entry.kind),
                    entry.first,
                    entry.count,
                    entry.every,
                    entry.probability,
                    entry.seed,
                    entry.slave,
                    entry.value,
                    bool(entry.process_data_only),
                ),
                entry.struck,
            )
            for entry in entries[:count]
        ]

    def drop(self, count: int) -> None:
        """Drops the next `count` frames, including those without process data."""
        if count > 0:
            self.inject(FrameFault(FaultKind.DROP, count=count, process_data_only=False))

    # --- errors --------------------------------------------------------------------------------

    @staticmethod
    def check_slave(result: int, slave: int) -> int:
        """Returns the result of a C function for a slave, or raises the error that it means."""
        if result == -errno.ENODEV:
            raise UsageError(f"there is no slave {slave}")
        return checked(result)

    def _check_plug(self, result: int, slave: int, parent: int, port: int) -> None:
        if result == -errno.ENODEV:
            raise UsageError(f"there is no slave {slave} or no slave {parent}")
        if result == -errno.ENXIO:
            raise UsageError(
                f"nothing can be plugged into port {port} of slave {parent}: its port descriptor "
                "(register 0x0007) does not have it, or it is port 0, which leads to the master"
            )
        if result == -errno.EADDRINUSE:
            raise UsageError(f"port {port} of slave {parent} is taken")
        checked(result)

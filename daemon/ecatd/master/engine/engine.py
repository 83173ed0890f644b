"""The cyclic engine (`daemon/cyclic`) as seen from Python."""

from __future__ import annotations

import ctypes
import errno
import os
import socket
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

from ecatd.base import native
from ecatd.base.errors import EcatError, NotPermittedError, UnreachableError
from ecatd.config.resolve.can import CanChannel
from ecatd.shm.contract import Setting

from .can import safe_of, terminal_of
from .process_image import DomainImage

_NO_SIGNAL = 0xFFFFFFFF


class EventType(IntEnum):
    """`cyclic_event_type`."""

    CLAIMED = 1
    SAFE = 2
    WKC = 3
    REQUEST = 4
    SEND = 5
    SLAVES = 6
    RING = 7
    CLOCK = 8
    OVERRUN = 9
    REFUSED = 10
    MALFORMED = 11
    STOPPED = 12
    CONFLICT = 13
    CAN_STATE = 14
    CAN_ENDED = 15
    CAN_REFUSED = 16
    CAN_CONFLICT = 17
    CAN_OVERFLOW = 18
    CAN_MALFORMED = 19


class Event(ctypes.Structure):
    """`cyclic_event` of `cyclic.h`."""

    _fields_ = (
        ("type", ctypes.c_uint32),
        ("slave", ctypes.c_int32),
        ("slot", ctypes.c_int32),
        ("value", ctypes.c_uint32),
        ("cycle", ctypes.c_uint64),
    )
    type: int
    slave: int
    slot: int
    value: int
    cycle: int


class Index(IntEnum):
    """`cyclic_index`: a socket accepts a frame by the index of the frame's first datagram."""

    CONTROL = 0x00
    ENGINE = 0x80
    LAST = 0xFF


class _Settings(ctypes.Structure):
    """`cyclic_settings` of `cyclic.h`."""

    _fields_ = tuple(
        (name, ctypes.c_int32)
        for name in (
            "priority",
            "cpu",
            "lock_memory",
            "busy_receive",
            "poll_ns",
            "wkc_limit",
            "free_running",
        )
    )


class Clock(ctypes.Structure):
    """`cyclic_clock` of `cyclic.h`: the distributed clock that the cycle follows."""

    _fields_ = (
        ("address", ctypes.c_uint32),
        ("position", ctypes.c_int32),
        ("phase_ns", ctypes.c_int32),
        ("lock_ns", ctypes.c_uint32),
    )


@dataclass(slots=True)
class RealTime:
    """Real-time settings that the engine asks the system for.

    Attributes:
        priority: SCHED_FIFO priority, 0 for ordinary scheduling.
        cpu: CPU to run on, -1 for any.
        lock_memory: Whether the memory of the process is locked.
        busy_receive: Whether the engine polls for the answer and never sleeps.
        poll_us: Microseconds for which the engine polls before it sleeps, without `busy_receive`.
            It polls only where answers usually come within this time.
        dma_latency_us: Longest time that processors may need to wake up, in microseconds;
            -1 leaves it as it is.
        wkc_limit: Number of bad working counters in a row after which outputs take their safe
            values; 0: never.
        free_running: Whether each cycle starts as soon as the one before has ended. For
            measurements without slaves.
    """

    priority: int = 80
    cpu: int = -1
    lock_memory: bool = True
    busy_receive: bool = False
    poll_us: int = 30
    dma_latency_us: int = -1
    wkc_limit: int = 0
    free_running: bool = False


@dataclass(slots=True)
class Grant:
    """The system's answer to one real-time setting.

    Attributes:
        setting: The setting.
        wanted: Whether it was asked for.
        value: The value asked for; see `ecat_setting`.
        error: errno if the system refused it, else 0.
    """

    setting: Setting
    wanted: bool
    value: int = 0
    error: int = 0


def _library() -> ctypes.CDLL:
    lib = native.load("ecatd", "ecat_cyclic")
    pointer, u32, i32 = ctypes.c_void_p, ctypes.c_uint32, ctypes.c_int32
    lib.cyclic_new.restype = pointer
    lib.cyclic_new.argtypes = [pointer, ctypes.c_int, ctypes.c_int, ctypes.c_int, u32]
    lib.cyclic_open_socket.argtypes = [ctypes.c_char_p, u32, u32]
    lib.cyclic_set_clock.argtypes = [pointer, pointer]
    lib.cyclic_set_clock.restype = None
    lib.cyclic_set_socket.argtypes = [pointer, u32, ctypes.c_int]
    lib.cyclic_set_socket.restype = None
    lib.cyclic_add_datagram.argtypes = [pointer, u32, i32, *[u32] * 4, i32, u32, i32]
    lib.cyclic_set_safe.argtypes = [pointer, u32, ctypes.c_char_p, ctypes.c_char_p]
    double = ctypes.c_double
    lib.cyclic_use_limits.argtypes = [pointer, pointer, u32]
    lib.cyclic_set_stop.argtypes = [pointer, u32, u32, u32, ctypes.c_uint64]
    lib.cyclic_set_copy.argtypes = [pointer, u32, u32, double, double, i32]
    lib.cyclic_set_follow.argtypes = [pointer, u32, u32, i32]
    lib.cyclic_add_can.argtypes = [pointer, pointer]
    lib.cyclic_add_can_safe.argtypes = [pointer, pointer]
    lib.cyclic_set_wkc_limit.argtypes = [pointer, i32]
    lib.cyclic_set_wkc_limit.restype = None
    lib.cyclic_listen.argtypes = [pointer, u32]
    lib.cyclic_listen.restype = None
    lib.cyclic_stopping.argtypes = [pointer]
    lib.cyclic_attend.argtypes = [pointer, u32]
    lib.cyclic_start.argtypes = [pointer, pointer]
    lib.cyclic_wait_event.argtypes = [pointer, pointer, ctypes.c_int64]
    lib.cyclic_reply.argtypes = [pointer, u32, u32, u32, u32, i32, u32, ctypes.c_char_p, u32]
    lib.cyclic_reply.restype = None
    for name in ("scheduling_error", "affinity_error", "memory_error", "slack_error"):
        getattr(lib, f"cyclic_{name}").argtypes = [pointer]
    lib.cyclic_publish_layout.argtypes = [pointer]
    lib.cyclic_publish_layout.restype = None
    for name in ("make_safe", "restart_counting", "stop", "free"):
        getattr(lib, f"cyclic_{name}").argtypes = [pointer]
        getattr(lib, f"cyclic_{name}").restype = None
    return lib


LIBRARY = _LIB = _library()
"""The C library of the engine. The relay is part of it, and uses it too."""


def open_socket(interface: str, first: int, last: int) -> socket.socket:
    """Opens a raw socket for EtherCAT frames whose first datagram has an index `first` to `last`.

    Raises:
        NotPermittedError: The process may not use raw sockets.
        UnreachableError: The interface cannot be used.
    """
    fd = _LIB.cyclic_open_socket(interface.encode(), first, last)
    if fd < 0:
        message = f"cannot open a raw EtherCAT socket on '{interface}': {os.strerror(-fd)}"
        raise (NotPermittedError if -fd in (errno.EPERM, errno.EACCES) else UnreachableError)(
            message
        )
    return socket.socket(fileno=fd)


def publish_layout(address: int) -> None:
    """Writes the layout version into shared memory: from now on clients may open it."""
    _LIB.cyclic_publish_layout(address)


class Engine:
    """One engine; see `cyclic.h` for what each call means.

    Args:
        address: Address of the header of the filled shared memory.
        out_fd: File descriptor of the `.out` shared memory.
        sockets: One socket from `open_socket` for each interface: one, or two with cable
            redundancy. The engine owns them from now on, and `close` closes them.
        run: 32 bits that go into the source address of its frames, and tell this run from others.

    Raises:
        EcatError: The engine cannot be made; the message gives the reason.
    """

    def __init__(
        self, address: int, out_fd: int, sockets: Sequence[socket.socket], run: int
    ) -> None:
        self._sockets = list(sockets)
        self._dma_latency = -1
        self._splits = 0
        fds = [item.fileno() for item in sockets]
        self._engine = _LIB.cyclic_new(
            address, out_fd, fds[0], fds[1] if len(fds) > 1 else -1, run & 0xFFFFFFFF
        )
        if not self._engine:
            raise EcatError(f"the cyclic engine: {os.strerror(ctypes.get_errno())}")

    @property
    def handle(self) -> int:
        """The `cyclic_t`, for the relay."""
        return int(self._engine)

    def set_clock(self, clock: Clock) -> None:
        """Makes the cycle follow a reference clock. Call it before `start`."""
        _LIB.cyclic_set_clock(self._engine, ctypes.byref(clock))

    def set_socket(self, port: int, new: socket.socket) -> None:
        """Replaces the socket of an interface that went away and came back; the engine owns it."""
        _LIB.cyclic_set_socket(self._engine, port, new.fileno())
        self._sockets[port].close()
        self._sockets[port] = new

    def add_domain(self, domain: DomainImage) -> None:
        """Adds the datagrams of a domain; raises `EcatError` if the engine has no room for one."""
        for item in domain.datagrams:
            code = _LIB.cyclic_add_datagram(
                self._engine,
                domain.number,
                item.command,
                domain.address,
                item.offset,
                item.length,
                item.wkc_expected,
                item.group,
                self._splits + item.split if item.split else 0,
                int(item.closes),
            )
            if code != 0:
                raise EcatError(f"datagram refused by the engine: {os.strerror(-code)}")
        self._splits += max((item.split for item in domain.datagrams), default=0)

    def set_safe(self, slave: int, value: bytes, hold: bytes) -> None:
        """Sets a slave's safe values: bits set in `hold` keep their last value, others use `value`.

        Both have as many bytes as the slave has outputs.
        """
        _LIB.cyclic_set_safe(self._engine, slave, value, hold)

    def use_limits(self, most: int) -> list[int]:
        """Takes the limits of all outputs from the signal table, which has changed.

        It returns when the engine uses all of them, from one cycle on; `start` does this first.

        Args:
            most: Number of signals that are returned, at most.

        Returns:
            Signals whose values were beyond the new limits, and are at the nearer one now.

        Raises:
            EcatError: There is no memory.
        """
        held = (ctypes.c_uint32 * most)()
        count = _LIB.cyclic_use_limits(self._engine, held, most)
        if count < 0:
            raise EcatError(f"other limits of outputs: {os.strerror(-count)}")
        return held[:count]

    def set_wkc_limit(self, limit: int) -> None:
        """Changes `RealTime.wkc_limit`."""
        _LIB.cyclic_set_wkc_limit(self._engine, limit)

    def set_stop(self, controlword: int, statusword: int, value: int, patience: float) -> None:
        """Sets how a drive that lost its owner is stopped; see `cyclic_set_stop`.

        Call it before `start`.

        Args:
            controlword: Signal of object 0x6040 of CiA 402.
            statusword: Signal of object 0x6041.
            value: Controlword to send while the drive still moves.
            patience: Seconds after which the controlword takes its safe value in any case.
        """
        code = _LIB.cyclic_set_stop(
            self._engine, controlword, statusword, value, int(patience * 1e9)
        )
        if code != 0:
            raise EcatError(f"stop of signal {controlword} refused: {os.strerror(-code)}")

    def set_copy(
        self, source: int | None, target: int, factor: float, offset: float, controlword: int = -1
    ) -> None:
        """Makes the engine copy an input to an output in every cycle.

        Call it after `set_stop` of the drive, and before `start`.

        Args:
            source: Signal of the input; None if it is not on the bus. The output is then safe, and
                nobody can claim it.
            target: Signal of the output.
            factor: Raw output = raw input * factor + offset.
            offset: See `factor`.
            controlword: Signal of the controlword of the drive with the output: while it is brought
                to a stop, the output has its safe value. -1: none.
        """
        number = _NO_SIGNAL if source is None else source
        code = _LIB.cyclic_set_copy(self._engine, number, target, factor, offset, controlword)
        if code != 0:
            raise EcatError(f"copy of signal {source} to {target} refused: {os.strerror(-code)}")

    def set_follow(self, source: int, target: int, controlword: int = -1) -> None:
        """Makes the value of an input the safe value of an output of the same type and unit.

        Call it after `set_safe` and `set_stop` of the slave, and before `set_copy` and `start`.

        Args:
            source: Signal of the input.
            target: Signal of the output.
            controlword: As in `set_copy`; the output keeps its value during the stop.
        """
        code = _LIB.cyclic_set_follow(self._engine, source, target, controlword)
        if code != 0:
            raise EcatError(f"signal {target} cannot follow {source}: {os.strerror(-code)}")

    def add_can(self, channel: CanChannel) -> None:
        """Adds the next CAN channel of the shared memory. Call it before `start`.

        Raises:
            EcatError: The process data of the terminal do not have the frames.
        """
        code = _LIB.cyclic_add_can(self._engine, ctypes.byref(terminal_of(channel)))
        if code != 0:
            raise EcatError(f"CAN channel of slave {channel.slave} refused: {os.strerror(-code)}")
        for frame in channel.safe:
            code = _LIB.cyclic_add_can_safe(self._engine, ctypes.byref(safe_of(frame, channel)))
            if code != 0:
                raise EcatError(f"safe CAN frame refused: {os.strerror(-code)}")

    @property
    def stopping(self) -> int:
        """Number of drives that are being stopped, and of safe CAN frames still to be sent."""
        return int(_LIB.cyclic_stopping(self._engine))

    def start(self, wanted: RealTime) -> list[Grant]:
        """Starts the cyclic exchange, and returns what the system granted of the settings."""
        settings = _Settings(
            wanted.priority,
            wanted.cpu,
            int(wanted.lock_memory),
            int(wanted.busy_receive),
            wanted.poll_us * 1000,
            wanted.wkc_limit,
            int(wanted.free_running),
        )
        latency = self._hold_dma_latency(wanted.dma_latency_us)
        code = _LIB.cyclic_start(self._engine, ctypes.byref(settings))
        if code != 0:
            raise EcatError(f"the cyclic engine does not start: {os.strerror(-code)}")
        return [
            Grant(
                Setting.SCHEDULING,
                wanted.priority > 0,
                wanted.priority,
                _LIB.cyclic_scheduling_error(self._engine),
            ),
            Grant(
                Setting.AFFINITY,
                wanted.cpu >= 0,
                wanted.cpu,
                _LIB.cyclic_affinity_error(self._engine),
            ),
            Grant(Setting.MEMORY, wanted.lock_memory, 0, _LIB.cyclic_memory_error(self._engine)),
            Grant(Setting.TIMER_SLACK, True, 1, _LIB.cyclic_slack_error(self._engine)),
            latency,
            Grant(Setting.BUSY_RECEIVE, wanted.busy_receive),
        ]

    def _hold_dma_latency(self, wanted_us: int) -> Grant:
        """Keeps processors out of deep sleep, by holding `/dev/cpu_dma_latency` open."""
        error = 0
        if wanted_us >= 0:
            try:
                self._dma_latency = os.open("/dev/cpu_dma_latency", os.O_WRONLY | os.O_CLOEXEC)
                os.write(self._dma_latency, wanted_us.to_bytes(4, sys.byteorder))
            except OSError as refused:
                error = refused.errno or errno.EIO
        return Grant(Setting.DMA_LATENCY, wanted_us >= 0, wanted_us, error)

    def restart_counting(self) -> None:
        """Sets all counters and histograms of the engine back to zero."""
        _LIB.cyclic_restart_counting(self._engine)

    def make_safe(self) -> None:
        """Sets all outputs to their safe values from the next cycle on, and refuses claims."""
        _LIB.cyclic_make_safe(self._engine)

    def attend(self, cycles: int) -> bool:
        """Tells the engine that the control side works; else it makes outputs safe after `cycles`.

        Returns:
            False: too late, the outputs are safe already.
        """
        return bool(_LIB.cyclic_attend(self._engine, cycles) == 0)

    def wait_event(self, timeout: float) -> Event | None:
        """Returns the next event, or None after `timeout` seconds. Only one thread may call it."""
        event = Event()
        if _LIB.cyclic_wait_event(self._engine, ctypes.byref(event), int(timeout * 1e9)):
            return event
        return None

    def listen(self, slot: int) -> None:
        """Lets the engine send one more event when a slot has new requests.

        The engine sends one REQUEST event for a slot, and then none until this is called. So a
        client that rings its doorbell without end cannot flood the events.
        """
        _LIB.cyclic_listen(self._engine, slot)

    def reply(
        self,
        slot: int,
        cell: int,
        generation: int,
        seq: int,
        status: int,
        abort_code: int,
        data: bytes,
    ) -> None:
        """Answers a client's request; see `cyclic_reply`."""
        _LIB.cyclic_reply(
            self._engine, slot, cell, generation, seq, status, abort_code, data, len(data)
        )

    def stop(self) -> None:
        """Ends the exchange after the current cycle."""
        _LIB.cyclic_stop(self._engine)

    def close(self) -> None:
        """Stops and frees the engine, and closes its sockets. No other call may follow."""
        if self._engine:
            _LIB.cyclic_free(self._engine)
            self._engine = None
            for item in self._sockets:
                item.close()
            if self._dma_latency >= 0:
                os.close(self._dma_latency)

"""Masters in Python programs, measured in the same way as `ping.c` measures the bare loop."""

from __future__ import annotations

import contextlib
import os
import resource
import socket
import struct
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from ctypes import addressof, create_string_buffer
from typing import Any

from ecatd.base.errors import StateError

from .. import histogram

_PRIORITY = 80
_WARM_UP = 0.05
_PATIENCE = 10.0
_WATCHDOG = 0x0420
_TIMEOUT_US = 10_000
_ATTACH_FILTER, _DETACH_FILTER = 26, 27
_TAKE_NOTHING = struct.pack("HBBI", 0x06, 0, 0, 0)  # BPF: return 0


class _Master(ABC):
    """A master with slaves in OP, which exchanges process data on command.

    Several masters take turns on one interface. The kernel needs time to deliver each frame to
    every open socket, so the sockets of waiting masters have a filter that rejects all frames.

    Args:
        interface: The network interface of the slaves.
    """

    def __init__(self, interface: str) -> None:
        self._exchange = self._start(interface)
        self._sockets = []
        for name in os.listdir("/proc/self/fd"):  # noqa: PTH208  no Path is needed
            with contextlib.suppress(OSError):  # no socket, or closed since it was listed
                found = socket.socket(fileno=os.dup(int(name)))
                if found.family == socket.AF_PACKET:
                    self._sockets.append(found)
                else:
                    found.close()
        self._close_sockets()

    @abstractmethod
    def _start(self, interface: str) -> Callable[[], bool]:
        """Brings the slaves to OP, and returns a function that exchanges process data once.

        The function returns whether the exchange was complete.
        """

    def _close_sockets(self) -> None:
        """Rejects all frames from now on."""
        code = create_string_buffer(_TAKE_NOTHING)
        program = struct.pack("HxxxxxxQ", 1, addressof(code))
        for item in self._sockets:
            item.setsockopt(socket.SOL_SOCKET, _ATTACH_FILTER, program)

    def _open_sockets(self) -> None:
        """Accepts frames from now on, and drops those that are still queued."""
        for item in self._sockets:
            with contextlib.suppress(OSError):
                while item.recv(1, socket.MSG_DONTWAIT):
                    pass
            item.setsockopt(socket.SOL_SOCKET, _DETACH_FILTER, 0)

    def __call__(self, *, rate: float, seconds: float, cpu: int) -> dict[str, Any]:
        """Exchanges process data for some seconds and returns the results.

        Args:
            rate: Cycles per second, 0 for free-running.
            seconds: Duration of the measurement.
            cpu: The processor that the master runs on.
        """
        before = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {cpu})
        granted = _real_time()
        self._open_sockets()
        try:
            self._cycles(rate, _WARM_UP)
            slept = resource.getrusage(resource.RUSAGE_THREAD).ru_nvcsw
            samples, lost, missed, taken = self._cycles(rate, seconds)
            sleeps = resource.getrusage(resource.RUSAGE_THREAD).ru_nvcsw - slept
        finally:
            self._close_sockets()
            if granted:
                os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
            os.sched_setaffinity(0, before)
        return {
            "cycles": len(samples),
            "rate": len(samples) / taken,
            "lost_frames": lost,
            "missed_cycles": missed,
            "sleeps": sleeps,
            "buckets": {"exchange": histogram.pairs(histogram.of_samples(samples))},
            "real_time": granted,
        }

    def _cycles(self, rate: float, seconds: float) -> tuple[list[int], int, int, float]:
        """Exchanges process data for some seconds.

        Returns:
            The times of the exchanges in ns, the number of failed exchanges, the number of missed
            deadlines, and the seconds taken.
        """
        clock, exchange = time.monotonic_ns, self._exchange
        period = round(1e9 / rate) if rate else 0
        samples: list[int] = []
        lost = missed = 0
        begin = now = due = clock()
        end = begin + round(seconds * 1e9)
        while now < end:
            if period:
                due += period
                if due < now:  # skips the missed deadlines, but keeps to the grid
                    missed += (now - due) // period + 1
                    due += ((now - due) // period + 1) * period
                time.sleep((due - clock()) * 1e-9 if due > clock() else 0)
            start = clock()
            if exchange():
                now = clock()
                samples.append(now - start)
            else:
                lost += 1
                now = clock()
        return samples, lost, missed, (now - begin) * 1e-9


def _real_time() -> bool:
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    except PermissionError:
        return False
    return True


class Soem(_Master):
    """pysoem: SOEM with Python bindings, the way in which most Python programs use EtherCAT.

    `send_processdata()` and `receive_processdata()` are measured, with the socket that pysoem
    opens.
    """

    def _start(self, interface: str) -> Callable[[], bool]:
        import pysoem

        master = pysoem.Master()
        master.open(interface)
        count = master.config_init()
        if count <= 0:
            raise StateError("pysoem finds no slaves")
        for slave in master.slaves:
            slave._fpwr(_WATCHDOG, bytes(2))
        master.config_map()
        master.state_check(pysoem.SAFEOP_STATE, 2_000_000)
        master.state = pysoem.OP_STATE
        master.write_state()

        def exchange() -> bool:
            master.send_processdata()
            # LRW: each slave is written to (2) and read from (1).
            return bool(master.receive_processdata(_TIMEOUT_US) == 3 * count)

        end = time.monotonic() + _PATIENCE
        while master.read_state() != pysoem.OP_STATE:
            exchange()
            if time.monotonic() > end:
                raise StateError("pysoem does not bring the slaves to OP")
        return exchange


class Kickcat(_Master):
    """kickcat: a master in C++ with Python bindings; `process_data()` is measured."""

    def _start(self, interface: str) -> Callable[[], bool]:
        import kickcat

        link = kickcat.create_link(interface, "")
        link.set_timeout(_TIMEOUT_US / 1e6)
        bus = kickcat.Bus(link)
        bus.init(0.0)  # no watchdogs: they would expire while other masters have their turns
        bus.create_mapping()
        bus.request_state(kickcat.State.SAFE_OP)
        bus.wait_for_state(kickcat.State.SAFE_OP, _PATIENCE)
        for slave in bus.slaves():
            slave.set_output_bytes(bytes(slave.output_size))
        bus.request_state(kickcat.State.OPERATIONAL)
        bus.wait_for_state(kickcat.State.OPERATIONAL, _PATIENCE, bus.process_data)

        def exchange() -> bool:
            try:
                bus.process_data()
            except RuntimeError:  # a working counter is wrong
                return False
            return True

        return exchange

"""An engine without a daemon, on a simulated line in the same process: what the tests drive.

The slaves are brought to OP by register writes of this file, so that nothing but the engine, the
segment and a client is under test.
"""

import contextlib
import fcntl
import functools
import inspect
import socket
import struct
import subprocess
import sys
import threading
import time
import uuid
from pathlib import Path

from benchmarks.segment.frames import BRD, FrameSocket, ask, frame

from ecatd.base import network_namespace as namespace
from ecatd.client import Client
from ecatd.description.bus import Bus, Slave
from ecatd.etg.pdo import Entry, Pdo
from ecatd.master.engine.engine import Engine, Index, RealTime, open_socket
from ecatd.master.engine.process_image import lay_out
from ecatd.master.engine.shared_memory import SharedMemory
from ecatd.shm.files import make_folder
from ecatsim.net import netlink
from ecatsim.rigs import library as rigs
from ecatsim.simulation import Simulation
from ecatsim.slave.sync_managers import derive

SIZE = 32  # bytes of outputs, and of inputs, of a slave of `line:N`
APWR, BWR = 2, 8
MASTER, SECOND = "ecat-master", "ecat-master2"
RUN = 0x1234ABCD


def in_namespace(test):
    """Runs the test in a process without threads, which can enter a namespace."""
    file = Path(inspect.getfile(test))

    @functools.wraps(test)
    def run(*arguments, **keywords):
        code = (
            f"import sys; sys.path[:0] = [{str(file.parent)!r}, {str(file.parents[2])!r}]; "
            f"import {file.stem} as t; "
            f"t.{test.__name__}.__wrapped__(*{arguments!r}, **{keywords!r})"
        )
        result = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=False
        )
        assert result.returncode == 0, result.stderr + result.stdout

    return run


def switch(interface, up):
    """Switches an interface on or off, as an administrator does."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        request = struct.pack("16sH14x", interface.encode(), 0)
        (flags,) = struct.unpack("16xH14x", fcntl.ioctl(control, 0x8913, request))
        flags = flags | 1 if up else flags & ~1
        fcntl.ioctl(control, 0x8914, struct.pack("16sH14x", interface.encode(), flags))


def slave(position, domain=0):
    entries = [
        [Entry(base + i, 1, f"{i}", 0x0005, 8) for i in range(SIZE)] for base in (0x7000, 0x6000)
    ]
    return Slave(
        position,
        "line",
        1,
        2,
        3,
        address=0x1000 + position,
        domain=domain,
        outputs=[Pdo(0x1600, "o", 0, entries[0])],
        inputs=[Pdo(0x1A00, "i", 1, entries[1])],
    )


class Bench:
    """A line of `count` slaves in OP and an engine that exchanges with them."""

    def __init__(self, count, *, domains=(), dividers=(1,), ring=False, cycle_us=2000, rig=None):
        self.count = count
        self.cycle_us = cycle_us
        namespace.enter_new()
        what = rigs.make(rig or f"line:{count}")
        what.ring = ring
        netlink.create_veth("sim", MASTER)
        if ring:
            netlink.create_veth("sim2", SECOND)
        self.simulation = Simulation(what)
        self.esc = self.simulation.segment
        self.esc.start("sim", "sim2") if ring else self.esc.start("sim")
        self._end = threading.Event()
        self._thread = threading.Thread(target=self.simulation.run, args=(self._end.is_set,))
        self._thread.start()
        domains = domains or [0] * count
        self.bus = Bus(
            f"e{uuid.uuid4().hex[:8]}", cycle_us, [slave(i, domains[i]) for i in range(count)]
        )
        self.image = lay_out(self.bus, set())
        for domain, divider in zip(self.image.domains, dividers, strict=True):
            domain.divider = divider
        self.engine = self.shared = None
        self.wire = FrameSocket(MASTER)
        if ring:  # frames shall come back where they were sent, until the engine is there
            self.esc.break_link(count - 1, 1, True)
        self._set_up()
        if ring:
            self.esc.break_link(count - 1, 1, False)

    def _broadcast(self, address, data):
        counter = ask(self.wire.exchange, frame(BWR, 0, address, data))[1]
        assert counter == self.count, (counter, hex(address))

    def _request(self, state):
        self._broadcast(0x0120, struct.pack("<H", state | 0x10))
        while ask(self.wire.exchange, frame(BRD, 0, 0x0130, bytes(1)))[0][0] != state:
            time.sleep(0.001)

    def _set_up(self):
        self._request(1)
        outputs, inputs = settings = derive(None, SIZE, SIZE)
        for channel, sm in enumerate(settings):
            self._broadcast(
                0x0800 + 8 * channel, struct.pack("<HHBBBB", sm.start, SIZE, sm.control, 0, 1, 0)
            )
        self._broadcast(0x0420, bytes(2))  # no watchdog
        for item in self.bus.slaves:
            base = self.image.domains[item.domain].address
            fmmus = b"".join(
                struct.pack("<IHBBHBBB3x", base + offset, SIZE, 0, 7, sm.start, 0, kind, 1)
                for offset, sm, kind in (
                    (item.output_offset, outputs, 2),
                    (item.input_offset, inputs, 1),
                )
            )
            for address, data in ((0x0600, fmmus), (0x0010, struct.pack("<H", item.address))):
                assert ask(self.wire.exchange, frame(APWR, -item.position, address, data))[1] == 1
        for state in (2, 4, 8):
            self._request(state)

    def start(self, clock=None, **real_time):
        self.shared = shared = SharedMemory(self.bus.name, make_folder(print))
        shared.fill(self.bus, self.image, 500_000_000, 10_000_000_000)
        names = (MASTER, SECOND) if self.simulation.rig.ring else (MASTER,)
        sockets = [open_socket(name, Index.ENGINE, Index.LAST) for name in names]
        self.engine = Engine(shared.address, shared.out_fd, sockets, RUN)
        for domain in self.image.domains:
            self.engine.add_domain(domain)
        if clock:
            self.engine.set_clock(clock)
        self.engine.start(RealTime(50, lock_memory=False, **real_time))
        while shared.header.cycle < 2:
            time.sleep(0.001)
        shared.publish()
        return self

    def client(self):
        return Client(self.bus.name)

    def events(self, patience=0.3):
        while (event := self.engine.wait_event(patience)) is not None:
            yield event

    def stop(self):
        if self.engine:
            self.engine.close()
            self.shared.close()
            self.engine = None

    def close(self):
        self.stop()
        self.wire.close()
        self._end.set()
        self._thread.join()
        self.simulation.close()


@contextlib.contextmanager
def bench(count, **options):
    made = Bench(count, **options)
    try:
        yield made
    finally:
        made.close()

"""Who owns an output, for how long, and what is said when that ends; with the C client."""

import ctypes
import math
import os
import re
import signal
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from raw_slot import RawSlot

from conftest import CYCLE_TIME_US, Daemon, names, naming, wait_for
from ecatd.base.errors import UsageError
from ecatd.client import Outputs, Reason
from ecatd.shm import contract as shm
from handle import EARG, ELEASE, EOWNED, ERANGE, ESTALE, Handle

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

DRIVE, EL2008 = 0, 3


CONFIG = "[gateway]\nlisten = []\n[outputs]\nlease_cycles = 7\nlease_max_ms = 50000\n"


@pytest.fixture(scope="module")
def daemon(start_shared: Callable[..., Daemon]) -> Daemon:
    return start_shared("troll", config=CONFIG)


def lease(daemon: Daemon, slot: int = 0) -> float:
    """The lease in force in seconds, as everybody may see it."""
    rows = {row["slot"]: row for row in daemon.ctl_json("claims")["owners"]}
    return float(rows[slot]["lease_ms"]) / 1e3


@contextmanager
def child(program: Callable[[], object]) -> Iterator[None]:
    """A forked process that has run a program; it stays until it is killed in the end."""
    ready, tell = os.pipe()
    pid = os.fork()
    if pid == 0:
        try:
            program()
            os.write(tell, b"y")
            while True:
                signal.pause()
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(1)
    os.close(tell)
    try:
        assert os.read(ready, 1) == b"y"
        yield
    finally:
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        os.close(ready)


def own_lamps(daemon: Daemon) -> None:
    handle = Handle(daemon.bus)
    while (code := handle.claim(EL2008, 50.0)) == ESTALE:
        pass  # a busy machine exchanges nothing for a while
    assert code == 0, handle.error
    assert handle.write(handle.bind(EL2008, 0x7000, 1, 1), 1.0) == 0
    assert handle.commit() == 0


def test_the_lease_is_that_of_what_is_owned(daemon: Daemon) -> None:
    with Handle(daemon.bus) as client, Handle(daemon.bus) as other:
        lamps = [client.bind(EL2008, 0x7000 + 16 * n, 1, 1) for n in range(3)]
        assert client.claim_entry(lamps[0], 20.0) == 0
        assert lease(daemon) == 20
        assert client.claim(DRIVE, 70.0) == 0
        assert lease(daemon) == 50  # more is cut
        assert client.release(DRIVE) == 0
        assert lease(daemon) == 20
        assert client.claim_entry(lamps[0], 10.0) == 0  # is owned, and not for a shorter time
        assert lease(daemon) == 20
        assert client.claim_entry(lamps[0], 30.0) == 0
        assert lease(daemon) == 30
        # What is refused changes nothing.
        assert other.claim_entry(lamps[1], 40.0) == 0
        wanted = (ctypes.c_int * 2)(lamps[2], lamps[1])
        assert client.claim_entries(wanted, ctypes.c_size_t(2), 50.0) == EOWNED
        wait_for(lambda: lease(daemon) == 30, daemon)
        assert client.release_entry(lamps[0]) == 0
        assert client.claim_entry(lamps[0], 0.0001) == 0
        assert lease(daemon) == 7 * CYCLE_TIME_US / 1e6  # less is not granted


def test_r15_a_killed_owner_is_gone_and_has_released_nothing(daemon: Daemon) -> None:
    """However the engine meets the client that takes its slot; see ecat_slot_begin()."""
    with daemon.client() as eye:
        lamp = eye.signal(EL2008, 0x7000, 1)
        for _ in range(30):
            with child(lambda: own_lamps(daemon)):
                wait_for(lambda: eye.output(lamp).state is Outputs.ACTIVE, daemon)
            with Handle(daemon.bus) as successor:
                while (code := successor.claim(DRIVE, 0.0)) == ESTALE:
                    pass
                assert code == 0
                assert eye.output(lamp).state is Outputs.SAFE
                # GONE if the successor came between two cycles
                assert eye.output(lamp).reason in (Reason.DIED, Reason.GONE)


def test_r16_who_takes_a_slot_slowly_is_no_release(daemon: Daemon) -> None:
    with daemon.client() as eye, Handle(daemon.bus) as client:
        lamp = eye.signal(EL2008, 0x7000, 1)
        assert client.claim(EL2008, 50.0) == 0
        raw = RawSlot(daemon.bus)
        # As far as a client gets that is interrupted while it takes the slot of a dead one.
        slot = shm.struct("ecat_out_slot").from_buffer(raw.memory, raw.at)
        slot.generation = slot.generation + 1
        raw.bell.generation = 0
        wait_for(lambda: eye.output(lamp).owner is None, daemon)
        assert eye.output(lamp).reason is Reason.GONE
        assert client.write(lamp.number, 1.0) == 0  # does not know yet
        assert client.commit() == ELEASE
        names(client.error, "written over", "place")
        assert client.write(lamp.number, 1.0) == ELEASE
        assert client.claim(EL2008, 50.0) == 0
        assert client.write(lamp.number, 1.0) == 0
        assert client.commit() == 0
        client.release_all()
        wait_for(lambda: eye.output(lamp).owner is None, daemon)
        assert eye.output(lamp).reason is Reason.RELEASED


def test_a_forked_process_leaves_the_outputs_alone(daemon: Daemon) -> None:
    with Handle(daemon.bus) as client, daemon.client() as eye:
        lamp = eye.signal(EL2008, 0x7000, 1)
        other = client.bind(EL2008, 0x7010, 1, 1)
        assert client.claim_entry(lamp.number, 50.0) == 0
        assert client.write(lamp.number, 1.0) == 0
        assert client.commit() == 0
        request = client.sdo_start(DRIVE, 0x1018, 1, None, 0)
        raw = RawSlot(daemon.bus)

        def try_all() -> None:
            before = bytes(raw.memory)
            assert client.sample() == 0  # reading is allowed
            assert client.read(lamp.number, ctypes.byref(ctypes.c_double())) == 0
            for code in (
                client.commit(),
                client.claim_entry(other, 1.0),
                client.release_entry(lamp.number),
                client.sdo_start(DRIVE, 0x1018, 1, None, 0),
                client.cancel(request),
            ):
                assert code == EARG
                names(client.error, "forked")
            client.close()
            assert bytes(raw.memory) == before
            with Handle(daemon.bus) as own:
                assert own.claim_entry(lamp.number, 1.0) == EOWNED
                assert own.claim_entry(other, 1.0) == 0

        with child(try_all):
            pass
        assert eye.output(lamp).state is Outputs.ACTIVE
        assert client.write(lamp.number, 0.0) == 0
        assert client.commit() == 0
        assert client.wait_request(request, 30.0) == 0
        assert client.poll(request, None, 0, None, None) == 0


def test_a_forked_process_takes_a_slot_of_its_own(start_daemon: Callable[..., Daemon]) -> None:
    """Also where its parent had opened the file of the slots already, which locks them."""
    daemon = start_daemon("troll", config=CONFIG)
    with Handle(daemon.bus) as client, daemon.client() as eye:
        lamps = [eye.signal(EL2008, 0x7000 + 16 * n, 1) for n in range(3)]
        assert client.claim_entry(lamps[0].number, 50.0) == 0
        assert eye.output(lamps[0]).program  # from that file
        with child(lambda: eye.claim(lamps[1], lease=50.0)):
            eye.claim(lamps[2], lease=50.0)
            assert len({eye.output(lamp).owner for lamp in lamps} - {None}) == 3


def test_a_forked_process_keeps_no_slot(daemon: Daemon) -> None:
    with Handle(daemon.bus) as client, daemon.client() as eye:
        lamp = eye.signal(EL2008, 0x7000, 1)
        assert client.claim(EL2008, 50.0) == 0
        before = eye.output(lamp).owner
        with child(lambda: None):
            client.release_all()
            wait_for(lambda: eye.output(lamp).owner is None, daemon)
            assert client.claim(EL2008, 50.0) == 0
            assert eye.output(lamp).owner == before


def test_a_program_name_does_nothing_to_a_terminal(daemon: Daemon) -> None:
    comm = Path("/proc/self/comm")
    name = comm.read_text()
    with Handle(daemon.bus) as hostile, Handle(daemon.bus) as client:
        comm.write_bytes(b"\x1b[2J\xc2\x9b31m\x07")
        try:
            assert hostile.claim(EL2008, 50.0) == 0
        finally:
            comm.write_text(name)
        assert client.claim(EL2008, 0.0) == EOWNED
        assert "belongs to ?[2J??31m? (pid" in client.error


RIG = """
from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.datatypes import DataType
from ecatsim import Rig
from ecatsim.devices.generic import Loopback

def entries(index):
    return [
        Entry(index, 1, "single", DataType.REAL32, 32),
        Entry(index, 2, "double", DataType.REAL64, 64),
        Entry(index, 3, "whole", DataType.INTEGER16, 16),
    ]

class Reals(Loopback):
    product = 0x3234
    rx_pdos = (Pdo(0x1600, "Outputs", 0, entries(0x7000)),)
    tx_pdos = (Pdo(0x1A00, "Inputs", 1, entries(0x6000)),)
    _data = bytes(14)

def rig():
    return Rig("reals", [Reals()])
"""


def test_only_numbers_go_out(start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    """A program whose computation diverges must not drive a plant with what it gets."""
    rig = tmp_path / "reals.py"
    rig.write_text(RIG)
    daemon = start_daemon(str(rig), config=CONFIG)
    largest = float.fromhex("0x1.fffffep127")
    with Handle(daemon.bus) as client, daemon.client() as python:
        single, double, whole = (client.bind(0, 0x7000, n, 1) for n in (1, 2, 3))
        assert client.claim(0, 50.0) == 0
        for signal_ in (single, double, whole):
            for wrong in (math.nan, math.inf, -math.inf):
                for write in (client.write, client.write_physical):
                    assert write(signal_, wrong) == ERANGE
                    assert re.match(r"-?(nan|inf) is out of range for 0x7000:", client.error)
        for wrong in (1e300, -1e300, 3.5e38):
            assert client.write(single, wrong) == ERANGE
            assert "numbers from -3.40282346638529e+38 to 3.40282346638529e+38 are" in client.error
        assert client.write(single, largest) == 0
        assert client.write(double, -1e300) == 0
        assert client.commit() == 0

        def arrived() -> bool:
            assert client.sample() == 0
            return (client.value(single), client.value(double)) == (largest, -1e300)

        wait_for(arrived, daemon)
        client.release_all()
        with python.claim(0, lease=50.0):
            for subindex in (1, 2):
                output = python.signal(0, 0x7000, subindex)
                with pytest.raises(UsageError, match=naming(output.address, "out of range")):
                    output.raw = math.nan
                with pytest.raises(UsageError, match=naming(output.address, "out of range")):
                    output.value = math.inf

"""A daemon that goes and comes back: what its clients see of it, without an engine."""

import ctypes
import os
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from test_shared_memory import make_bus

from conftest import SHM
from ecatd.base.file_locks import release
from ecatd.description.bus import Bus
from ecatd.master.engine.process_image import lay_out
from ecatd.master.engine.shared_memory import SharedMemory
from ecatd.shm import contract as shm
from handle import EBUS, ECLAIM, EDOWN, ELAYOUT, ETIMEOUT, LIB, Handle

NOW = 1 << 62
"""Time of the last cycle where no engine runs: always just now."""


def serve(bus: Bus) -> SharedMemory:
    made = SharedMemory(bus.name, SHM)
    made.fill(bus, lay_out(bus, set()), 5_000_000, 500_000_000)
    made.header.cycle_end_ns = NOW
    made.publish()
    return made


def kill(shared: SharedMemory) -> None:
    """What is left of a daemon that was killed: files, without a lock, and an old cycle."""
    shared.header.cycle_end_ns = 1
    release(shared.fd, shm.LOCK_DAEMON)
    os.close(shared.out_fd)


@pytest.fixture
def bus() -> Iterator[Bus]:
    made = make_bus()
    yield made
    for left in SHM.glob(f"{made.name}*"):
        left.unlink()


@pytest.fixture
def handle(bus: Bus) -> Iterator[Handle]:
    shared = serve(bus)
    with Handle(bus.name) as made:
        assert made.sample() == 0
        kill(shared)
        yield made


def returned(handle: Handle) -> int:
    """The code of a sample, once the client has had the time to look for the daemon again."""
    time.sleep(0.03)
    return handle.sample()


def test_nothing_is_kept_of_a_daemon_that_is_gone(bus: Bus) -> None:
    """Not even where the client looked who owned an output, for which it maps all slots."""
    shared = serve(bus)
    with Handle(bus.name) as handle:
        output = handle.bind(1, 0x7000, 1, 1)
        for _ in range(3):
            at = shared.address + shared.header.outputs_offset
            (shm.struct("ecat_shm_output") * (output + 1)).from_address(at)[output].owner = 0
            kill(shared)
            assert handle.sample() == EDOWN
            assert handle.output(output, ctypes.create_string_buffer(256)) == 0
            shared = serve(bus)
            assert returned(handle) == 0
            assert not [path for path in open_files() if path.startswith(f"{shared.out_path} ")]


def test_more_slots_than_the_daemon_has_are_not_used(bus: Bus) -> None:
    shared = serve(bus)
    shared.header.slot_count = 4
    with Handle(bus.name) as handle:
        assert handle.claim(1, 0.1) == ELAYOUT
    shared.close()


def open_files() -> list[str]:
    """Deleted files that this process has open."""
    found = []
    for file in Path("/proc/self/fd").iterdir():
        with suppress(FileNotFoundError):
            found.append(str(file.readlink()))
    return [path for path in found if path.endswith(" (deleted)")]


def test_a_reader_goes_on_with_the_next_daemon(bus: Bus, handle: Handle) -> None:
    before = handle.instance
    info = (ctypes.c_char_p * 20)()  # larger than any of the structs of ecat.h
    LIB.ecat_slave(handle.bus, 0, info)
    name = info[2]  # the pointer to the name, after four numbers of 32 bits
    assert handle.sample() == EDOWN
    assert "has ended" in handle.error
    assert handle.sample() == EDOWN
    assert "start it with" in handle.error
    shared = serve(bus)
    assert returned(handle) == 0
    assert handle.instance not in (before, 0)
    assert LIB.ecat_slave(handle.bus, 0, info) == 0
    assert info[2] == name
    shared.close()


def test_values_are_never_those_of_nothing(bus: Bus, handle: Handle) -> None:
    """From the first call that says that the daemon is back, reads see its image."""
    from test_shared_memory import put_image

    assert handle.sample() == EDOWN
    assert handle.value(0) == 0
    shared = serve(bus)
    put_image(shared, b"\0\0\1\0")
    time.sleep(0.03)
    assert handle.wait(0, 0.0) == 0
    assert handle.value(0) == 1
    shared.close()


def test_another_bus_is_refused_until_the_old_one_is_back(bus: Bus, handle: Handle) -> None:
    assert handle.sample() == EDOWN
    other = make_bus()
    other.name = bus.name
    other.slaves[1].product += 1
    shared = serve(other)
    assert returned(handle) == EBUS
    assert "came back" in handle.error
    assert handle.sample() == EBUS  # also while it is not looked for
    assert "came back" in handle.error
    assert handle.wait(1, 5.0) == EBUS  # at once
    shared.header.layout = 7 << 16
    assert returned(handle) == ELAYOUT
    shared.close()
    shared = serve(bus)
    assert returned(handle) == 0
    shared.close()


def test_a_daemon_that_is_still_starting_is_not_there_yet(bus: Bus, handle: Handle) -> None:
    assert handle.sample() == EDOWN
    shared = SharedMemory(bus.name, SHM)
    assert returned(handle) == EDOWN
    assert "is still starting" in handle.error
    shared.fill(bus, lay_out(bus, set()), 1, 1)
    shared.header.cycle_end_ns = NOW
    assert returned(handle) == EDOWN
    shared.publish()
    assert returned(handle) == 0
    shared.close()


def test_waiting_waits_for_the_daemon(bus: Bus, handle: Handle) -> None:
    assert handle.wait(1, 30.0) == EDOWN  # at once: it has just been noticed
    begin = time.monotonic()
    assert handle.wait(1, 0.1) == EDOWN
    assert time.monotonic() - begin >= 0.1
    shared = serve(bus)
    # It is there, but no cycle ends.
    assert handle.wait(1, 0.1) == ETIMEOUT
    assert handle.wait(0, 0.0) == 0
    shared.close()


def test_the_daemon_is_not_looked_for_all_the_time(bus: Bus, handle: Handle) -> None:
    assert handle.sample() == EDOWN
    begin = time.monotonic()
    shared = None
    # The daemon is served at once after a look in vain; it is not seen before the next look.
    while handle.sample() != 0:
        shared = shared or serve(bus)
    assert time.monotonic() - begin >= 0.02
    assert shared is not None
    shared.close()


def test_what_a_model_wrote_is_not_silently_lost(bus: Bus, handle: Handle) -> None:
    """Without claims nothing is committed; a write needs a claim, before and after."""
    output = handle.bind(1, 0x7000, 1, 1)
    assert handle.write(output, 1.0) == ECLAIM
    assert handle.claim(1, 0.0) == EDOWN
    assert handle.claim(1, 0.0) == EDOWN
    assert handle.sdo_start(0, 0x1018, 1, None, 0) == EDOWN

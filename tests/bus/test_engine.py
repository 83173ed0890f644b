"""The cyclic engine on a simulated line: domains, frames that go astray, rings, clocks.

Each test runs in a process of its own, which enters a network namespace.
"""

import ctypes
import resource
import socket
import struct
import time
from pathlib import Path

import pytest
from engine_bench import MASTER, RUN, SECOND, SIZE, Bench, bench, in_namespace, switch

from ecatd.base.errors import EcatError, UnreachableError
from ecatd.master.engine.engine import Clock, EventType, Index, open_socket
from ecatd.server.watch.foreign_masters import ForeignWatch
from ecatd.shm import contract as shm
from ecatsim.links import FaultKind, FrameFault

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged, pytest.mark.long]

PATIENCE = 20.0
PAGE = resource.getpagesize()


def until(condition, what="what is waited for"):
    """Waits for something that the engine brings about by itself."""
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, f"{what} does not come"
        time.sleep(0.002)


def write_all(client, b, number):
    """Outputs that differ from slave to slave and from call to call."""
    for item in b.bus.slaves:
        signal = client.signal(item.position, 0x7000, 1)
        signal.raw = (number * 7 + item.position) & 0xFF
    client.commit()


def inputs(client, b):
    return [client.signal(item.position, 0x6000, 1).raw for item in b.bus.slaves]


def returned(client, b, number):
    client.sample()
    expected = [(number * 7 + item.position) & 0xFF for item in b.bus.slaves]
    return inputs(client, b) == expected


def owner(b):
    client = b.client()
    for item in b.bus.slaves:
        client.claim(item.position, lease=30)
    return client


def status(b, domain):
    kind = shm.struct("ecat_shm_domain_status")
    at = b.shared.address + b.shared.header.domain_status_offset
    return kind.from_address(at + domain * shm.size("ecat_shm_domain_status"))


def present(address, size):
    """Whether all pages of this process's memory are there (Linux: admin-guide/mm/pagemap)."""
    first, last = address // PAGE, (address + size - 1) // PAGE
    with Path("/proc/self/pagemap").open("rb") as file:
        file.seek(8 * first)
        entries = struct.unpack(f"{last - first + 1}Q", file.read(8 * (last - first + 1)))
    return all(entry >> 63 for entry in entries)


@in_namespace
def test_memory_is_there_before_the_first_cycle_though_it_is_not_locked():
    with bench(60) as b:
        b.start()  # with lock_memory=False
        libc = ctypes.CDLL(None)
        libc.malloc_usable_size.argtypes = [ctypes.c_void_p]
        libc.malloc_usable_size.restype = ctypes.c_size_t
        state = b.engine._engine
        size = libc.malloc_usable_size(state)
        assert size > 200_000, "the frames and the events are in it"
        assert present(state, size)
        assert present(b.shared.address, b.shared.header.size)


@in_namespace
def test_each_domain_has_its_own_rate_page_and_counter():
    dividers = (1, 3, 10)
    with bench(6, domains=(0, 0, 1, 2, 2, 2), dividers=dividers) as b:
        b.start()
        with owner(b) as client:
            write_all(client, b, 1)
            until(lambda: returned(client, b, 1), "the pattern")
            client.sample()
            expected = [(client.domain(d).wkc, client.domain(d).wkc_state) for d in range(3)]
            assert expected == [(6, 2), (3, 2), (9, 2)]
            cycles = {d: set() for d in range(3)}
            stamps = {d: set() for d in range(3)}
            for _ in range(100):
                client.wait()
                client.sample()
                for d in range(3):
                    cycles[d].add(client.domain(d).cycle)
                    stamps[d].add(client.domain(d).time_ns)
        assert len(cycles[0]) > len(cycles[1]) > len(cycles[2])
        assert all(len(stamps[d]) == len(cycles[d]) for d in range(3))
        b.engine.stop()
        # On the grid: what took part and what was left out add up to the cycles that went by.
        last = b.shared.header.cycle
        for d, divider in enumerate(dividers):
            assert status(b, d).exchanges + status(b, d).overruns == last // divider
            if status(b, d).overruns == 0 and b.shared.health.missed == 0:
                assert all(cycle % divider == 0 for cycle in cycles[d])


@in_namespace
def test_domains_of_one_cycle_share_frames():
    """Sixteen domains of one slave each fit into the one frame that a single domain needs."""
    with bench(16, domains=range(16), dividers=(1,) * 16) as b:
        b.start()
        until(lambda: b.shared.header.cycle >= 20)
        b.engine.stop()
        health = b.shared.health
        assert health.frames == health.cycles
        assert health.slaves_found == 16


@in_namespace
def test_an_image_larger_than_a_frame():
    with bench(60) as b:  # 3840 bytes
        b.start()
        with owner(b) as client:
            for number in range(3):
                write_all(client, b, number)
                until(lambda number=number: returned(client, b, number), "the pattern")
        b.engine.stop()
        assert b.shared.health.frames == 3 * b.shared.health.cycles


def faults(b, kind, count, **more):
    """Injects a fault into the frames of the next cycles."""
    first = b.esc.counters().cycles + 5
    return b.esc.inject(FrameFault(kind, first=first, count=count, every=2, **more))


@in_namespace
def test_r01_r02_lost_frames_are_counted_and_the_inputs_stay():
    with bench(3) as b:
        b.start()
        with owner(b) as client:
            write_all(client, b, 1)
            until(lambda: returned(client, b, 1), "the pattern")
            before = b.shared.health.lost
            faults(b, FaultKind.DROP, 4)
            until(lambda: b.shared.health.lost - before >= 4, "the loss")
            assert returned(client, b, 1)
            until(lambda: client.sample() or client.domain().wkc_state == 2)
        b.engine.stop()
        assert b.shared.health.wkc_bad >= 4
        assert status(b, 0).lost == b.shared.health.lost


@in_namespace
def test_r03_late_frames_are_never_taken_for_new_ones():
    """A counter goes round through the slaves: it must not go back, whatever frames do."""
    with bench(2, cycle_us=1000) as b:
        b.start()
        with owner(b) as client:
            out, back = client.signal(0, 0x7000, 1), client.signal(0, 0x6000, 1)
            faults(b, FaultKind.DELAY, 60, value=2_500_000)
            last, laps = 0, 0
            for number in range(600):
                out.raw = number & 0xFF
                client.commit()
                client.wait()
                client.sample()
                now = int(back.raw)
                assert ((now - last) & 0xFF) < 0x80, f"{last} was followed by {now}"
                laps += now != last
                last = now
        b.engine.stop()
        health = b.shared.health
        assert laps > 100
        assert health.late >= 1
        assert status(b, 0).late == health.late <= health.lost


@in_namespace
def test_r04_a_wrong_working_counter_spoils_one_domain_in_one_cycle():
    with bench(2) as b:
        b.start()
        with owner(b) as client:
            write_all(client, b, 3)
            until(lambda: returned(client, b, 3), "the pattern")
            faults(b, FaultKind.WKC, 3, value=1)
            until(lambda: b.shared.health.wkc_bad >= 3, "the wrong counter")
            assert returned(client, b, 3)
        kinds = [(event.type, event.value) for event in b.events()]
        assert (EventType.WKC, shm.WkcState.INCOMPLETE) in kinds
        assert kinds[-1] != (EventType.WKC, shm.WkcState.INCOMPLETE)


def raw_socket():
    wire = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(0x88A4))
    wire.bind((MASTER, 0x88A4))
    return wire


@in_namespace
def test_r03_frames_of_an_earlier_run_are_told_from_ours():
    """All 128 indices, in the form of our frames, but with the name of another run."""
    with bench(2) as b:
        b.start()
        with owner(b) as client, raw_socket() as wire:
            write_all(client, b, 5)
            until(lambda: returned(client, b, 5), "the pattern")
            template = next(f for f in iter(lambda: wire.recv(2048), None) if f[17] >= 0x80)
            assert template[7:11] == RUN.to_bytes(4, "little")
            old = bytearray(template)
            old[7:11] = (RUN ^ 0xFFFF).to_bytes(4, "little")
            # Outputs of zero would come back as inputs of zero, if they were believed.
            old[16 + 14 + 10 :] = bytes(len(old) - 16 - 14 - 10)
            bad = b.shared.health.wkc_bad
            watch, foreign = ForeignWatch([MASTER], RUN), [0]
            for index in range(0x80, 0x100):
                old[17] = index
                wire.send(old)

            def all_seen():
                foreign.append(watch.look(0).count)
                return sum(foreign) == 0x80

            until(all_seen, "the foreign frames")
            watch.close()
            until(lambda: returned(client, b, 5), "the pattern")
            assert b.shared.health.wkc_bad - bad <= b.shared.health.lost
        assert b.shared.health.late == 0 or b.shared.health.lost > 0


@in_namespace
def test_number_and_state_of_the_slaves_are_known_each_cycle():
    with bench(4) as b:
        b.start()
        health = b.shared.health
        until(lambda: (health.slaves_found, health.al_status) == (4, 8), "OP of all")
        b.esc.set_al_status(2, 0x14, 0x001B)
        until(lambda: health.al_status == 0x1C, "the error of one")
        b.esc.power(3, False)
        until(lambda: health.slaves_found == 3, "the loss of one")
        loss = b.esc.inject(FrameFault(FaultKind.DROP, count=0, process_data_only=False))
        until(lambda: health.slaves_found == 0, "the loss of all")
        b.esc.clear(loss)
        until(lambda: health.slaves_found == 3, "the return of three")
        seen = [(e.slave, e.value) for e in b.events() if e.type == EventType.SLAVES]
        assert seen[0] == (4, 8)
        for fact in ((4, 0x1C), (3, 0x1C), (0, 0)):
            assert fact in seen
        assert seen[-1] == (3, 0x1C)


@pytest.mark.parametrize("place", range(5))
@in_namespace
def test_a_break_anywhere_in_a_ring_loses_nothing(place):
    with bench(4, ring=True) as b:
        b.start()
        health = b.shared.health
        at = (place, 0) if place < 4 else (3, 1)
        with owner(b) as client:
            write_all(client, b, 0)
            until(lambda: returned(client, b, 0), "the pattern")
            until(lambda: health.ring == shm.Ring.CLOSED)
            wrong = []
            for number in range(1, 4):
                lost, bad = health.lost - health.late, health.wkc_bad
                b.esc.break_link(*at, True)
                until(lambda: health.ring == shm.Ring.OPEN, "the break")
                assert health.ring_break == place
                assert health.slaves_found == 4
                write_all(client, b, number)
                until(lambda number=number: returned(client, b, number), "the pattern")
                # At most the frames that were under way are lost.
                assert health.lost - health.late - lost <= 2
                wrong.append(health.wkc_bad - bad)
                b.esc.break_link(*at, False)
                until(lambda: health.ring == shm.Ring.CLOSED, "the repair")
            assert min(wrong) <= 2  # a busy machine makes other frames late, too
        told = [(e.value, e.slave) for e in b.events() if e.type == EventType.RING]
        assert (shm.Ring.OPEN, place) in told
        assert told[-1][0] == shm.Ring.CLOSED


@in_namespace
def test_two_breaks_lose_the_slaves_between_them_and_only_these():
    with bench(5, ring=True) as b:
        b.start()
        health = b.shared.health
        until(lambda: health.ring == shm.Ring.CLOSED)
        b.esc.break_link(2, 0, True)
        b.esc.break_link(4, 0, True)
        until(lambda: health.slaves_found == 3, "the loss")
        until(lambda: health.ring_break == 2)
        b.esc.break_link(4, 0, False)
        until(lambda: health.slaves_found == 5, "the return")


@in_namespace
def test_the_second_interface_may_fail_and_return():
    with bench(3, ring=True) as b:
        b.start()
        health = b.shared.health
        with owner(b) as client:
            until(lambda: health.ring == shm.Ring.CLOSED)
            switch(SECOND, False)
            until(lambda: health.ring == shm.Ring.OPEN, "the break")
            assert health.ring_break == 3
            write_all(client, b, 1)
            until(lambda: returned(client, b, 1), "the pattern")
            switch(SECOND, True)
            until(lambda: health.ring == shm.Ring.CLOSED, "the repair")
            switch(MASTER, False)
            until(lambda: health.ring == shm.Ring.OPEN and health.ring_break == 0, "the break")
            write_all(client, b, 2)
            until(lambda: returned(client, b, 2), "the pattern")
        sends = [(e.slot, bool(e.value)) for e in b.events() if e.type == EventType.SEND]
        assert sends[:3] == [(1, True), (1, False), (0, True)]


@in_namespace
def test_an_interface_that_is_switched_off_ends_nothing():
    with bench(2) as b:
        b.start()
        health = b.shared.health
        with b.client() as client:
            switch(MASTER, False)
            until(lambda: health.unsent > 10, "the failure")
            until(lambda: health.slaves_found == 0)
            cycles = health.cycles
            until(lambda: health.cycles > cycles + 10, "the next cycles")
            client.sample()
            assert client.domain().wkc_state == shm.WkcState.ZERO
            switch(MASTER, True)
            until(lambda: client.sample() or client.domain().wkc_state == 2, "the return")
        sends = [bool(e.value) for e in b.events() if e.type == EventType.SEND]
        assert sends == [True, False]


@in_namespace
def test_a_socket_is_replaced_while_the_engine_runs():
    with bench(2) as b:
        b.start()
        with owner(b) as client:
            for number in range(5):
                b.engine.set_socket(0, open_socket(MASTER, Index.ENGINE, Index.LAST))
                write_all(client, b, number)
                until(lambda number=number: returned(client, b, number), "the pattern")


CLOCK = Clock(0x1000, 0, 250_000, 50_000)


@in_namespace
def test_the_cycle_follows_the_reference_clock():
    with bench(3, cycle_us=1000) as b:
        b.esc.set_clock(0, drift_ppm=80, offset_ns=987_654_321)
        b.start(clock=CLOCK)
        health = b.shared.health
        until(lambda: health.dc_state == shm.DcState.LOCKED, "the lock")
        assert health.dc_reference == 0
        # The deadlines follow a clock that runs 80 ppm faster; so far away is nothing by chance.
        until(lambda: 40_000 < health.dc_drift_ppb < 120_000, "the drift")
        start, cycles = health.dc_time_ns, b.shared.header.cycle
        until(lambda: b.shared.header.cycle > cycles + 1000)
        periods = (health.dc_time_ns - start) / 1e6
        # A thousand cycles on the host's own clock would be 80 µs more.
        assert abs(periods - (b.shared.header.cycle - cycles)) < 3
        # The clock jumps: the lock is lost, and comes again.
        b.esc.step_clock(0, 400_000)
        until(lambda: health.dc_state == shm.DcState.LOCKING, "the loss of the lock")
        until(lambda: health.dc_state == shm.DcState.LOCKED, "the lock")
        states = [e.value for e in b.events() if e.type == EventType.CLOCK]
        assert states[:3] == [shm.DcState.LOCKED, shm.DcState.LOCKING, shm.DcState.LOCKED]


NARROW = """
from ecatsim import Chip, Rig
from ecatsim.devices.generic import Loopback

class Narrow(Loopback):
    chip = Chip(fmmus=4, sync_managers=4, dc_bits=32)

def rig():
    return Rig("narrow", [Narrow(), Loopback()])
"""


@pytest.fixture
def narrow(tmp_path):
    """A rig whose reference clock has 32 bits."""
    file = tmp_path / "narrow.py"
    file.write_text(NARROW)
    return str(file)


@in_namespace
def silent_clock(rig):
    with bench(2, cycle_us=1000, rig=rig) as b:
        b.start(clock=CLOCK)
        health = b.shared.health
        until(lambda: health.dc_state == shm.DcState.LOCKED, "the lock")
        switch(MASTER, False)
        until(lambda: health.dc_state == shm.DcState.LOCKING, "the loss of the lock")
        last, begin = health.dc_time_ns, time.monotonic_ns()
        time.sleep(2.3)  # more than half a round of such a clock
        assert health.dc_time_ns == last
        switch(MASTER, True)
        until(lambda: health.dc_time_ns != last, "the clock")
        passed = health.dc_time_ns - last
        assert abs(passed - (time.monotonic_ns() - begin)) < 1_000_000_000, passed
        until(lambda: health.dc_state == shm.DcState.LOCKED, "the lock")
        states = [e.value for e in b.events() if e.type == EventType.CLOCK]
        assert states[:2] == [shm.DcState.LOCKED, shm.DcState.LOCKING]
        assert states[-1] == shm.DcState.LOCKED


def test_a_reference_clock_that_is_silent_for_a_while(narrow):
    silent_clock(narrow)


@in_namespace
def test_what_is_published_needs_nobody_who_reads_events():
    with bench(3) as b:
        b.start()
        health = b.shared.health
        for _ in range(1100):  # more than the engine keeps
            b.esc.break_link(2, 0, True)
            until(lambda: health.slaves_found == 2, "the loss")
            b.esc.break_link(2, 0, False)
            until(lambda: health.slaves_found == 3, "the return")
        seen = [e.slave for e in b.events() if e.type == EventType.SLAVES]
        assert len(seen) < 2048
        assert seen[-1] == 3


@in_namespace
def test_slaves_follow_the_reference_clock():
    with bench(4, cycle_us=1000) as b:
        for position, drift in enumerate((10, 50, -50, 30)):
            b.esc.set_clock(position, drift_ppm=drift, offset_ns=position * 1000)
        b.start(clock=CLOCK)
        until(lambda: b.shared.health.dc_state == shm.DcState.LOCKED, "the lock")

        def spread():
            times = [clock.system_ns for clock in b.esc.clocks()]
            return max(times) - min(times)

        # Nobody has told them the propagation delays: 400 ns from slave to slave.
        until(lambda: spread() < 1500, "the agreement")


@in_namespace
def test_behind_a_break_slaves_stay_near_the_reference_clock():
    """They no longer hear it; the engine tells them what it believes the time to be."""
    with bench(4, ring=True, cycle_us=1000) as b:
        for position in range(4):
            b.esc.set_clock(position, drift_ppm=(0, 0, 500, 500)[position])
        b.start(clock=CLOCK)
        health = b.shared.health
        until(lambda: health.dc_state == shm.DcState.LOCKED, "the lock")
        b.esc.break_link(2, 0, True)
        until(lambda: health.ring == shm.Ring.OPEN, "the break")
        cycles = health.cycles
        until(lambda: health.cycles > cycles + 6000)  # 3 ms apart without help

        def ahead(of: int, to: int) -> int:
            times = [clock.system_ns for clock in b.esc.clocks()]
            return abs(times[of] - times[to])

        until(lambda: ahead(2, 0) < 1_000_000 and ahead(3, 2) < 1500, "the agreement")


@in_namespace
def test_a_free_running_engine_does_not_wait_for_deadlines():
    with bench(2, cycle_us=100_000) as b:
        b.start(free_running=True)
        until(lambda: b.shared.health.cycles > 1000)
        b.engine.stop()
        assert b.shared.health.missed == 0
        assert b.shared.health.wkc_bad == 0


@in_namespace
def test_what_does_not_fit_is_refused():
    made = Bench(1)
    try:
        made.image.domains[0].datagrams[0].length = 1453
        with pytest.raises(EcatError, match="Invalid argument"):
            made.start()
    finally:
        made.close()
    with pytest.raises(UnreachableError, match="'nowhere'"):
        open_socket("nowhere", Index.ENGINE, Index.LAST)


def test_a_line_slave_has_as_many_bytes_as_the_bench_believes():
    from ecatsim.rigs import library as rigs

    device = rigs.make("line:1").devices[0]
    assert sum(pdo.bit_length for pdo in device.tx_pdos) == 8 * SIZE

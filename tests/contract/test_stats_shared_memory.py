"""Statistics of real shared memory: all of it is read, and damage is an error."""

import ctypes
import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_shared_memory import make_bus, name_of

from conftest import SHM, naming
from ecatd.base.errors import EcatError, NotPermittedError, StateError, UnreachableError, UsageError
from ecatd.cli import info
from ecatd.cli.stats_screen import histogram_lines, stats_lines
from ecatd.master.engine.engine import Grant
from ecatd.master.engine.process_image import lay_out
from ecatd.master.engine.shared_memory import SharedMemory
from ecatd.shm import contract as shm
from ecatd.shm.statistics import from_map, read, to_map
from ecatd.shm.statistics.clocks import read_clocks


@contextmanager
def made_memory() -> Iterator[SharedMemory]:
    bus = make_bus()
    made = SharedMemory(bus.name, SHM)
    try:
        made.fill(bus, lay_out(bus, set()), 5_000_000, 500_000_000)
        made.header.state = shm.BusState.RUNNING
        made.publish()
        yield made
    finally:
        made.close()


@pytest.fixture
def shared() -> Iterator[SharedMemory]:
    with made_memory() as made:
        yield made


def row(shared: SharedMemory, table: str, name: str) -> ctypes.Structure:
    offset = getattr(shared.header, f"{table}_offset")
    made: ctypes.Structure = shm.struct(name).from_address(shared.address + offset)
    return made


def test_everything_is_read(shared: SharedMemory) -> None:
    health = shared.health
    for number, item in enumerate(shm.COUNTERS):
        setattr(health, item.name, number + 10)
    for number, name in enumerate(shm.TIMES):
        histogram = getattr(health, name)
        histogram.buckets[shm.bucket(1000 * number + 1000)] = 5
        histogram.min_ns = histogram.max_ns = 1000 * number + 1000
        histogram.sum_ns = 5 * histogram.max_ns
    health.start_ns, health.slaves_found, health.al_status = 7, 2, 8
    health.ring, health.ring_break = shm.Ring.OPEN, 1
    health.link_first, health.link_second = shm.Link.UP, shm.Link.GONE
    health.dc_state, health.dc_reference = shm.DcState.LOCKING, 1
    health.dc_time_ns, health.dc_offset_ns, health.dc_drift_ppb = 1 << 63, -5, -70
    health.delay_cycles[3] = 4
    status = row(shared, "domain_status", "ecat_shm_domain_status")
    for number, item in enumerate(shm.DOMAIN_COUNTERS):
        setattr(status, item.name, number + 1)
    page = shm.struct("ecat_shm_page").from_address(
        shared.address + row(shared, "domains", "ecat_shm_domain").page_offset  # type: ignore[attr-defined]
    )
    page.cycle, page.wkc, page.wkc_state = 33, 2, shm.WkcState.INCOMPLETE
    shared.set_grants([Grant(shm.Setting.SCHEDULING, True, 80, errno.EPERM)])
    shared.header.cycle, shared.header.cycle_end_ns = 34, 99

    found = read(name_of(shared))
    assert (found.bus, found.state) == (name_of(shared), shm.BusState.RUNNING)
    assert (found.cycle_time_ns, found.cycle_number, found.cycle_end_ns) == (500_000, 34, 99)
    assert (found.start_ns, found.instance) == (7, shared.header.instance)
    assert (found.slaves_expected, found.slaves_found, found.al_status) == (2, 2, 8)
    assert (found.ring, found.ring_break) == (shm.Ring.OPEN, 1)
    assert found.links == (shm.Link.UP, shm.Link.GONE)
    assert found.clock.state == shm.DcState.LOCKING
    assert (found.clock.reference, found.clock.time_ns) == (1, 1 << 63)
    assert (found.clock.offset_ns, found.clock.drift_ppb) == (-5, -70)
    assert found.counters == {item.name: n + 10 for n, item in enumerate(shm.COUNTERS)}
    assert found.delay_cycles == (0, 0, 0, 4)
    for number, (name, histogram) in enumerate(found.times.items()):
        assert (name, histogram.count) == ([*shm.TIMES][number], 5)
        assert histogram.mean_ns == histogram.quantile(0.5) == 1000 * number + 1000
    (domain,) = found.domains
    assert (domain.wkc, domain.wkc_expected, domain.cycle_number) == (2, 3, 33)
    assert domain.wkc_state == shm.WkcState.INCOMPLETE
    assert domain.counters == {item.name: n + 1 for n, item in enumerate(shm.DOMAIN_COUNTERS)}
    assert (domain.divider, domain.output_bytes, domain.input_bytes) == (1, 2, 30)
    first, *others = found.grants
    assert (first.wanted, first.granted, first.value, first.error) == (True, False, 80, 1)
    assert not any(grant.wanted for grant in others)
    assert found.silence > 1
    assert from_map(to_map(found, buckets=True)).counters == found.counters


def test_fresh_shared_memory_is_all_zero(shared: SharedMemory) -> None:
    found = read(name_of(shared))
    assert found.counters["cycles"] == 0
    assert all(histogram.count == 0 for _name, histogram in found.times.items())
    assert found.clock.reference == -1 or found.clock.state == shm.DcState.OFF


def test_who_is_not_there_is_told(shared: SharedMemory) -> None:
    with pytest.raises(
        UnreachableError, match=naming("not running", "'nobody'", "systemctl start ecatd@nobody'")
    ):
        read("nobody")
    for name in ("../x", "", "a" * 32, "a/b"):
        with pytest.raises(UsageError, match=naming(f"'{name}'", "bus name")):
            read(name)
    name = name_of(shared)
    left = SHM / f"{name}x"
    try:
        left.write_bytes(shared.path.read_bytes())  # nobody holds its lock
        with pytest.raises(UnreachableError, match=naming("not running", f"'{name}x'")):
            read(f"{name}x")
        left.write_bytes(b"")
        with pytest.raises(UnreachableError, match=naming("not running", f"'{name}x'")):
            read(f"{name}x")
        left.unlink()
        left.symlink_to(shared.path)
        with pytest.raises(EcatError, match=naming("link", left)):
            read(f"{name}x")
        left.unlink()
        left.mkdir()
        with pytest.raises(EcatError, match=naming("no file", left)):
            read(f"{name}x")
    finally:
        left.rmdir() if left.is_dir() else left.unlink(missing_ok=True)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_who_may_not_read_is_told(shared: SharedMemory) -> None:
    shared.path.chmod(0)
    with pytest.raises(NotPermittedError, match=naming("group 'ecat'")):
        read(name_of(shared))


def test_a_daemon_that_starts_is_waited_for_by_others(shared: SharedMemory) -> None:
    shared.header.layout = 0
    with pytest.raises(UnreachableError, match="is still starting"):
        read(name_of(shared))
    shared.header.layout = (7 << 16) | 1
    with pytest.raises(StateError, match=naming("layout", "7.1", "1.0", "update")):
        read(name_of(shared))
    shared.header.layout = shm.LAYOUT + 3  # a later minor version only adds
    assert read(name_of(shared)).slaves_expected == 2


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("health_offset", 0xFFFFFFF8),
        ("settings_offset", 4),
        ("domains_offset", 1 << 31),
        ("domain_status_offset", 0xFFFFFFF8),
        ("domain_count", 17),
        ("domain_count", 0xFFFFFFFF),
        ("cycle_time_ns", 0),
        ("size", 1 << 40),
        ("magic", 1),
    ],
)
def test_a_damaged_header_is_refused(shared: SharedMemory, field: str, value: int) -> None:
    setattr(shared.header, field, value)
    with pytest.raises(StateError, match=r"is damaged|speaks layout"):
        read(name_of(shared))


def test_slaves_beyond_all_measure_are_refused(shared: SharedMemory) -> None:
    shared.header.slave_count = 0xFFFFFFFF
    with pytest.raises(StateError, match=naming("damaged", "slave_count", 4294967295)):
        read_clocks(name_of(shared))


def test_a_damaged_table_is_refused(shared: SharedMemory) -> None:
    domain = row(shared, "domains", "ecat_shm_domain")
    for field, value in (("page_offset", 0xFFFFFFF8), ("page_offset", 3)):
        kept = getattr(domain, field)
        setattr(domain, field, value)
        with pytest.raises(StateError, match=naming("damaged", "ecat_shm_page")):
            read(name_of(shared))
        setattr(domain, field, kept)


def test_states_that_a_later_version_has_are_read(shared: SharedMemory) -> None:
    shared.header.state = 77
    for field in ("ring", "link_first", "link_second", "dc_state"):
        setattr(shared.health, field, 9)
    found = read(name_of(shared))
    assert (found.state.name, found.ring.name, found.clock.state.name) == (
        *("UNKNOWN_77", "UNKNOWN_9", "UNKNOWN_9"),
    )
    assert from_map(to_map(found, buckets=True)).state == 77


def test_a_file_that_is_cut_short_is_refused(shared: SharedMemory) -> None:
    os.truncate(shared.path, shared.header.health_offset + 8)
    with pytest.raises(StateError, match="is damaged"):
        read(name_of(shared))
    os.truncate(shared.path, 100)
    with pytest.raises(UnreachableError, match="is still starting"):
        read(name_of(shared))


@settings(max_examples=60)
@given(st.data())
def test_random_bytes_are_errors_or_values(data: st.DataObject) -> None:
    with made_memory() as shared:
        name = name_of(shared)
        before = read(name)
        size = shared.header.size
        tables = [
            *(getattr(shared.header, f"{table}_offset") for table in ("domains", "settings")),
            *(shared.header.health_offset, shared.header.domain_status_offset, 0),
        ]
        for _ in range(data.draw(st.integers(1, 5))):
            garbage = data.draw(st.binary(min_size=1, max_size=200))
            start = data.draw(st.sampled_from(tables)) + data.draw(st.integers(0, 400))
            if 0 <= start < 12:  # what says what this is at all
                start += 12
            count = min(len(garbage), size - start)
            fd = os.open(shared.path, os.O_RDWR)
            os.pwrite(fd, garbage[:count], start)
            os.close(fd)
        with suppress(EcatError):
            found = read(name)
            shown = [*stats_lines(found, None), *info.real_time_lines(found)]
            assert all(line.isprintable() for line in shown)
            histogram_lines("exchange", found, None)
            with suppress(EcatError):
                from_map(to_map(found, buckets=True))
                stats_lines(found, found - before)

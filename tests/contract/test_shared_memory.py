"""The shared memory: what the daemon writes is what the C client reads, and damage is noticed."""

import ctypes
import uuid
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from conftest import SHM, naming
from ecatd.base.errors import NoAnswerError, StateError, UnreachableError
from ecatd.client import Client
from ecatd.description.bus import Bus, Slave
from ecatd.etg.pdo import Entry, Pdo
from ecatd.master.engine.process_image import lay_out
from ecatd.master.engine.shared_memory import SharedMemory
from ecatd.shm import contract as shm
from handle import ERANGE, Handle

pytestmark = pytest.mark.unprivileged


def make_bus() -> Bus:
    entries = [
        Entry(0x6000, 1, "bit", 0x0001, 1),
        Entry(0x6000, 2, "odd signed", 0x0003, 11),
        Entry(0, 0, "", 0, 4),
        Entry(0x6000, 3, "wide", 0x001B, 64),
        Entry(0x6000, 4, "negative", 0x0015, 64),
        Entry(0x6000, 5, "float", 0x0008, 32, "V", 0.5, 1.0),
        Entry(0x6000, 6, "ä" * 60, 0x0011, 64),
    ]
    return Bus(
        f"s{uuid.uuid4().hex[:8]}",
        500,
        [
            Slave(0, "Nö", 1, 2, 3, serial=4, alias=5, inputs=[Pdo(0x1A00, "p", 0, entries)]),
            Slave(
                1,
                "out",
                1,
                9,
                1,
                outputs=[Pdo(0x1600, "p", 0, [Entry(0x7000, 1, "u16", 0x0006, 16)])],
            ),
        ],
    )


@pytest.fixture
def shared() -> Iterator[SharedMemory]:
    bus = make_bus()
    made = SharedMemory(bus.name, SHM)
    made.fill(bus, lay_out(bus, set()), 5_000_000, 500_000_000)
    made.header.cycle_end_ns = 1 << 62  # "just now" for ever: no engine runs here
    made.publish()
    yield made
    made.close()


def name_of(shared: SharedMemory) -> str:
    return shared.path.name


def put_image(shared: SharedMemory, data: bytes) -> None:
    """What the engine does, for a domain that nobody reads meanwhile."""
    domain = shm.struct("ecat_shm_domain").from_address(
        shared.address + shared.header.domains_offset
    )
    page = shared.address + domain.page_offset + shm.size("ecat_shm_page")
    ctypes.memmove(page, data, len(data))


def test_the_directory_arrives(shared: SharedMemory) -> None:
    with Client(name_of(shared)) as client:
        assert client.fingerprint == make_bus().fingerprint
        assert client.cycle_time == 0.0005
        first, second = client.slaves()
        assert (first.name, first.vendor, first.product, first.revision) == ("Nö", 1, 2, 3)
        assert (first.has_outputs, second.has_outputs) == (False, True)
        signals = client.signals()
        assert [s.name for s in signals][:3] == ["bit", "odd signed", "wide"]
        assert signals[5].name == "ä" * 31  # 63 bytes of room, cut between characters
        assert (signals[4].unit, signals[4].scale, signals[4].offset) == ("V", 0.5, 1.0)
        assert signals[6].output


def test_values_of_all_shapes_are_read(shared: SharedMemory) -> None:
    import struct

    odd = -700
    word = 1 | ((odd & 0x7FF) << 1)
    image = struct.pack(
        "<HHQqfd", 0, word, (1 << 64) - 1, -(1 << 63), 1.5, -2.25
    )  # two bytes of outputs come first
    put_image(shared, image)
    with Handle(name_of(shared)) as client:
        client.sample()
        values = [client.value(n) for n in range(6)]
        assert values[:2] == [1.0, odd]
        assert values[2:] == [float(1 << 64), float(-(1 << 63)), 1.5, -2.25]
        assert client.integer(2) == -1  # all 64 bits
        assert client.integer(3) == -(1 << 63)
        assert client.physical(4) == 1.75


def test_a_real_entry_is_rounded_to_an_integer_as_it_is_written(shared: SharedMemory) -> None:
    import struct

    with Handle(name_of(shared)) as client:
        for number, whole in ((2.5, 2), (3.5, 4), (-0.5, 0), (-1.5, -2), (-2.6, -3), (7.0, 7)):
            put_image(shared, struct.pack("<HHQqfd", 0, 0, 0, 0, number, number))
            client.sample()
            assert [client.integer(n) for n in (4, 5)] == [whole, whole]
        for number in (float("nan"), float("inf"), 2.0**63):
            put_image(shared, struct.pack("<HHQqfd", 0, 0, 0, 0, number, number))
            client.sample()
            assert client.read_int(5, ctypes.byref(ctypes.c_int64())) == ERANGE
            assert "is no 64-bit integer" in client.error


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("slaves_offset", 0xFFFFFFF8),
        ("signals_offset", 4),
        ("domains_offset", 1 << 31),
        ("slave_count", 1 << 20),
        ("signal_count", 1 << 30),
        ("slot_count", 33),
        ("domain_count", 17),
        ("output_bytes", 0xFFFFFFFF),
        ("health_offset", 0xFFFFFFF8),
        ("replies_offset", 0xFFFFFFF8),
        ("cycle_time_ns", 0),
        ("size", 1 << 40),
    ],
)
def test_r28_a_damaged_header_is_refused(shared: SharedMemory, field: str, value: int) -> None:
    setattr(shared.header, field, value)
    with pytest.raises(StateError, match="is damaged"):
        Client(name_of(shared))


@pytest.mark.parametrize(
    ("table", "field", "value"),
    [
        ("slave", "domain", 9),
        ("slave", "input_bytes", 1 << 31),
        ("slave", "name", b"x" * 64),
        ("signal", "bit_offset", 0xFFFFFFFF),
        ("signal", "bit_length", 65),
        ("signal", "slave", 99),
        ("signal", "domain", 1),
        ("signal", "scale", 0.0),
        ("signal", "offset", float("nan")),
        ("domain", "page_offset", 0xFFFFFFF8),
        ("domain", "image_bytes", 0xFFFFFFFF),
        ("domain", "output_base", 0xFFFFFFFF),
        ("domain", "name", b"x" * 32),
    ],
)
def test_r28_a_damaged_table_is_refused(
    shared: SharedMemory, table: str, field: str, value: float | bytes
) -> None:
    offset = getattr(shared.header, f"{table}s_offset")
    row = shm.struct(f"ecat_shm_{table}").from_address(shared.address + offset)
    setattr(row, field, value)
    with pytest.raises(StateError, match="is damaged"):
        Client(name_of(shared))


def test_r28_another_layout_is_named(shared: SharedMemory) -> None:
    shared.header.layout = (7 << 16) | 1
    with pytest.raises(StateError, match=naming("layout", "7.1", "1.0")):
        Client(name_of(shared))
    shared.header.layout = shm.LAYOUT + 3  # a newer minor version only appends
    Client(name_of(shared)).close()
    shared.header.layout = 0
    with pytest.raises(UnreachableError, match="still starting"):
        Client(name_of(shared))


def test_r28_a_second_daemon_and_a_leftover(shared: SharedMemory) -> None:
    bus = make_bus()
    bus.name = name_of(shared)
    with pytest.raises(StateError, match=naming(f"'{bus.name}'", "another ecatd")):
        SharedMemory(bus.name, SHM)
    assert Client(bus.name).fingerprint == bus.fingerprint
    left = SHM / f"{bus.name}x"
    left.write_bytes(b"garbage of a daemon that was killed")
    bus.name += "x"
    with pytest.raises(UnreachableError, match=naming(f"'{bus.name}'", "systemctl start ecatd")):
        Client(bus.name)
    fresh = SharedMemory(bus.name, SHM)
    with pytest.raises(UnreachableError, match="still starting"):
        Client(bus.name)
    fresh.fill(bus, lay_out(bus, set()), 1, 1)
    fresh.header.cycle_end_ns = 1 << 62
    fresh.publish()
    Client(bus.name).close()
    fresh.close()
    assert not list(SHM.glob(f"*{bus.name}*"))


def test_calls_without_a_connection_are_errors(shared: SharedMemory) -> None:
    client = Client(name_of(shared))
    client.close()
    client.close()
    with pytest.raises(StateError, match="is closed"):
        client.sample()
    # In C the handle of a failed ecat_open() can still be used, wrongly.
    lib = shm.LIBRARY
    lib.ecat_error.restype = ctypes.c_char_p
    handle = ctypes.c_void_p()
    assert lib.ecat_open(ctypes.byref(handle), b"nobody") == -2
    assert lib.ecat_slave_count(handle) == 0
    for call in (
        lambda: lib.ecat_sample(handle),
        lambda: lib.ecat_wait(handle, 1, ctypes.c_double(0.1)),
        lambda: lib.ecat_bind(handle, 0, 0x6060, 0, 2),
        lambda: lib.ecat_claim(handle, 0, ctypes.c_double(0)),
        lambda: lib.ecat_read(handle, 0, ctypes.byref(ctypes.c_double())),
        lambda: lib.ecat_write(handle, 0, ctypes.c_double(0)),
        lambda: lib.ecat_sdo_start(handle, 0, 0, 0, None, 0),
    ):
        assert call() < 0
        assert lib.ecat_error(handle)
    lib.ecat_close(handle)


@pytest.mark.parametrize(
    ("divider", "phase", "exchanged", "turns", "due"),
    [
        (20, 0, 40, 1, 60),
        (20, 0, 43, 1, 60),  # that one was late, the next one is not
        (20, 0, 59, 1, 60),
        (20, 0, 43, 2, 80),
        (20, 7, 27, 1, 47),
        (20, 7, 31, 1, 47),
        (20, 7, 0, 1, 7),  # never exchanged
        (20, 0, 0, 1, 20),
        (20, 7, 31, 0, 31),
        (20, 7, 0, 0, 0),
        (1, 0, 5, 3, 8),
    ],
)
def test_turns_of_a_domain_are_counted_on_its_grid(
    shared: SharedMemory, divider: int, phase: int, exchanged: int, turns: int, due: int
) -> None:
    domain = shm.struct("ecat_shm_domain").from_address(
        shared.address + shared.header.domains_offset
    )
    domain.divider, domain.phase = divider, phase
    page = shm.struct("ecat_shm_page").from_address(shared.address + domain.page_offset)
    page.cycle = exchanged
    with Client(name_of(shared)) as client:
        client.sample()
        if due > exchanged:
            page.cycle = due - 1
            with pytest.raises(NoAnswerError):
                client.wait(turns, timeout=0, domain=0)
        page.cycle = due
        client.wait(turns, timeout=0, domain=0)


def test_the_cycle_that_stands_still_is_told(shared: SharedMemory) -> None:
    shared.header.cycle_end_ns = 1
    with (
        Client(name_of(shared)) as client,
        pytest.raises(UnreachableError, match="stands still"),
    ):
        client.sample()


@given(st.integers(0, 2**64 - 1))
def test_histogram_buckets_hold_what_they_say(ns: int) -> None:
    lib = shm.LIBRARY
    lib.ecat_histogram_bucket.argtypes = [ctypes.c_uint64]
    lib.ecat_histogram_bound.restype = ctypes.c_uint64
    bucket = lib.ecat_histogram_bucket(ns)
    assert lib.ecat_histogram_bound(bucket) <= ns
    if bucket < 927:
        upper = lib.ecat_histogram_bound(bucket + 1)
        assert ns < upper
        assert upper - lib.ecat_histogram_bound(bucket) <= max(1, ns / 31)


@given(st.lists(st.integers(0, 10**9), min_size=1, max_size=200), st.floats(0, 1))
def test_quantiles_are_right_within_a_bucket(samples: list[int], q: float) -> None:
    histogram = shm.struct("ecat_shm_histogram")()
    for ns in samples:
        histogram.buckets[shm.LIBRARY.ecat_histogram_bucket(ctypes.c_uint64(ns))] += 1
    histogram.max_ns = max(samples)
    exact = sorted(samples)[min(int(q * len(samples)), len(samples) - 1)]
    assert exact <= shm.quantile(histogram, q) <= exact * 33 / 32 + 1

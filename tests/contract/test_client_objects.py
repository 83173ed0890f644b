"""The Python client on shared memory without an engine: values, lookups, threads, restarts."""

import ctypes
import gc
import os
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from signal import ITIMER_REAL, SIGALRM, SIGINT, setitimer
from signal import signal as on_signal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_return import kill, serve
from test_shared_memory import put_image

from conftest import naming
from ecatd.base.errors import NoAnswerError, StateError, UnreachableError, UsageError
from ecatd.client import Client, Direction, Validity, connection
from ecatd.description.bus import Bus, Domain, Slave
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatd.master.engine.shared_memory import SharedMemory
from ecatd.shm.contract import Errno
from handle import Handle

SHAPES = [
    ("bit", DataType.BOOLEAN, 1),
    ("two bits", DataType.BIT2, 2),
    ("", 0, 5),  # what follows begins with a byte
    ("i8", DataType.INTEGER8, 8),
    ("u8", DataType.UNSIGNED8, 8),
    ("i16", DataType.INTEGER16, 16),
    ("u24", DataType.UNSIGNED24, 24),
    ("i24", DataType.INTEGER24, 24),
    ("i40", DataType.INTEGER40, 40),
    ("i32", DataType.INTEGER32, 32),
    ("u64", DataType.UNSIGNED64, 64),
    ("i64", DataType.INTEGER64, 64),
    ("f32", DataType.REAL32, 32),
    ("f64", DataType.REAL64, 64),
    ("odd", DataType.INTEGER16, 11),  # what follows does not begin with a byte
    ("odd i16", DataType.INTEGER16, 16),
    ("odd u32", DataType.UNSIGNED32, 32),
    ("odd i64", DataType.INTEGER64, 64),
    ("odd f32", DataType.REAL32, 32),
    ("odd f64", DataType.REAL64, 64),
    ("last", DataType.BOOLEAN, 1),
]


def make_bus() -> Bus:
    def entries(index: int, scale: float) -> list[Entry]:
        return [
            Entry(index if name else 0, n if name else 0, name, kind, bits, "V", scale, -1.0)
            for n, (name, kind, bits) in enumerate(SHAPES, 1)
        ]

    inputs = [Pdo(0x1A00, "in", 0, entries(0x6000, 0.5))]
    outputs = [Pdo(0x1600, "out", 0, entries(0x7000, 2.0))]
    return Bus(
        f"p{os.urandom(4).hex()}", 500, [Slave(0, "all", 1, 2, 3, outputs=outputs, inputs=inputs)]
    )


@pytest.fixture(scope="module")
def bus() -> Bus:
    return make_bus()


@pytest.fixture(scope="module")
def memory(bus: Bus) -> Iterator[SharedMemory]:
    made = serve(bus)
    yield made
    made.close()


@pytest.fixture(scope="module")
def shared(memory: SharedMemory, bus: Bus) -> Iterator[Client]:
    with Client(bus.name) as client:
        yield client


@pytest.fixture(scope="module")
def handle(memory: SharedMemory, bus: Bus) -> Iterator[Handle]:
    with Handle(bus.name) as made:
        yield made


def image_bytes(client: Client) -> int:
    return max(s.bit_offset + s.bit_length for s in client.signals()) // 8 + 1


@given(data=st.data())
def test_objects_read_what_the_c_client_reads(
    memory: SharedMemory, shared: Client, handle: Handle, data: st.DataObject
) -> None:
    size = image_bytes(shared)
    put_image(memory, data.draw(st.binary(min_size=size, max_size=size)))
    shared.sample()
    handle.sample()
    signals = shared.signals()
    assert len(signals) == 2 * (len(SHAPES) - 1)
    for signal in signals:
        raw = signal.raw
        assert isinstance(raw, float if signal.real else int), signal
        if signal.real:
            assert same(raw, handle.value(signal.number)), signal
        else:
            wrapped = ctypes.c_int64(raw).value
            assert wrapped == handle.integer(signal.number), signal
            assert raw >= 0 or signal.signed
        assert same(signal.value, handle.physical(signal.number)), signal
    several = shared.group(signals[::-1])
    assert all(map(same, several.raw, [signal.raw for signal in signals[::-1]]))
    assert all(map(same, several.values, [signal.value for signal in signals[::-1]]))


def same(first: float, second: float) -> bool:
    return struct.pack("d", first) == struct.pack("d", second) or first == second


def test_entries_are_found_by_name_and_by_address(shared: Client) -> None:
    signal = shared.signal("0/i16", direction=Direction.INPUT)
    assert (signal.name, signal.unit, signal.address) == ("i16", "V", "0x6000:06")
    assert (signal.output, signal.scale, signal.offset) == (False, 0.5, -1.0)
    assert shared.signal(0, 0x6000, 6) is signal
    assert shared.signal("all/0x6000:06") is signal
    assert shared.signal("all/6000:06") is signal
    assert shared.signal(signal.number) is signal
    assert repr(signal) == "<input 0/0x6000:06 'i16', 16 bit>"
    assert shared.signals(slave=1) == []
    with pytest.raises(StateError, match=naming("more than one", "'i16'")):
        shared.signal("0/i16")
    with pytest.raises(StateError, match=naming("no entry", "'nothing'")):
        shared.signal("0/nothing")
    with pytest.raises(AttributeError):
        signal.row = 5  # type: ignore[attr-defined]


def test_paths_lead_to_their_entries(shared: Client) -> None:
    paths = [signal.path for signal in shared.signals()]
    assert len(set(paths)) == len(paths)
    assert all(shared.signal(path).path == path for path in paths)
    assert paths[0] == "0/out/bit"  # the name alone is also that of an input


def test_a_group_of_one_and_of_none(shared: Client) -> None:
    shared.sample()
    assert shared.group([]).raw == ()
    one = shared.signal("0/in/i32")
    assert shared.group(["0/in/i32"]).raw == (one.raw,)
    assert shared.group([one, one]).raw == (one.raw, one.raw)


def test_validity_is_an_enumeration(bus: Bus, memory: SharedMemory) -> None:
    with Client(bus.name) as client:
        assert client.signal("0/in/i32").validity is Validity.NEVER
        assert client.domain().age == 1e9  # never fresh before the first exchange


@pytest.mark.parametrize("value", ["5", None, [1], 1 << 2000])
def test_what_is_no_number_is_told(shared: Client, value: object) -> None:
    signal = shared.signal("0/out/i16")
    with pytest.raises(UsageError, match="is not a number"):
        signal.raw = value
    with pytest.raises(UsageError, match="is not a number"):
        signal.value = value  # type: ignore[assignment]


def test_a_closed_client_says_so(bus: Bus, memory: SharedMemory) -> None:
    client = Client(bus.name)
    signal, bit = client.signal("0/in/i16"), client.signal("0/in/bit")
    several, bits = client.group([signal, signal]), client.group([bit])
    client.sample()
    client.close()
    assert client.closed
    for read in (
        lambda: signal.raw,
        lambda: signal.value,
        lambda: bit.raw,
        lambda: several.raw,
        lambda: bits.values,
        lambda: signal.validity,
        lambda: client.cycle,
        client.sample,
        client.commit,
        lambda: client.signal("0/in/bit"),
        lambda: client.domain_array(),
    ):
        with pytest.raises(StateError, match="is closed"):
            read()
    with pytest.raises(StateError, match="is closed"):
        signal.raw = 1


def test_a_client_waits_in_one_thread(bus: Bus, memory: SharedMemory) -> None:
    with Client(bus.name) as client, ThreadPoolExecutor(1) as other:
        waiting = other.submit(client.wait, 1, 30.0)
        while "_address" in vars(client):
            assert not waiting.done()
        for call in (client.sample, client.wait, client.close, lambda: client.claim(0)):
            with pytest.raises(UsageError, match=naming("one for each")):
                call()
        while not waiting.done():
            memory.header.cycle += 1
            time.sleep(0.01)
        waiting.result()
        client.sample()


def test_ctrl_c_ends_a_long_wait(bus: Bus, memory: SharedMemory) -> None:
    program = (
        "import sys; from ecatd import Client; bus = Client(sys.argv[1])\n"
        "try:\n"
        "  print(flush=True)\n"
        "  bus.wait(1, timeout=1000)\n"
        "except KeyboardInterrupt: print('ended')"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program, bus.name], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "\n"
        process.send_signal(SIGINT)
        assert process.stdout.read() == "ended\n"


@contextmanager
def interrupted(seconds: float) -> Iterator[None]:
    """Something else has the thread, once, between two calls of the C client."""
    before = on_signal(SIGALRM, lambda *_: time.sleep(seconds))
    setitimer(ITIMER_REAL, 0.05)
    try:
        yield
    finally:
        setitimer(ITIMER_REAL, 0)
        on_signal(SIGALRM, before)


def test_a_wait_that_is_interrupted_beyond_its_end(bus: Bus, memory: SharedMemory) -> None:
    with Client(bus.name) as client:
        for wait in (client.wait, partial(client.wait, domain=0)):
            with interrupted(0.4), pytest.raises(NoAnswerError, match=r"within 0\.3 s"):
                wait(1 << 30, timeout=0.3)


def test_every_code_has_an_exception() -> None:
    told_otherwise = {Errno.OK, Errno.EABORT, Errno.EBUSY, Errno.ESYS}
    assert set(connection.ERRORS) == set(Errno) - told_otherwise


def test_importing_the_package_loads_nothing() -> None:
    program = (
        "import sys, ecatd\n"
        "assert not [m for m in sys.modules if m.startswith(('ecatd.', 'ctypes', 'asyncio'))]\n"
        "from ecatd import Client, Signal, LeaseError\n"
        "assert Client.__module__ == 'ecatd.client.client'\n"
        "assert not [m for m in ('asyncio', 'numpy', 'zenoh', 'msgpack') if m in sys.modules]\n"
        "try: ecatd.nothing\n"
        "except AttributeError as error: print(error)\n"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (result.stdout, result.stderr) == ("module 'ecatd' has no attribute 'nothing'\n", "")


# --- a daemon that comes back ---------------------------------------------------------------------


def restarted(bus: Bus, client: Client, change: Bus | None = None) -> SharedMemory:
    """A new daemon, which the client has found."""
    memory = serve(change or bus)
    deadline = time.monotonic() + 120
    while True:
        try:
            client.sample()
        except UnreachableError:
            assert time.monotonic() < deadline
        else:
            return memory


def test_objects_go_on_with_the_next_daemon() -> None:
    bus = make_bus()
    memory = serve(bus)
    with Client(bus.name) as client:
        signal = client.signal("0/in/i16")
        several = client.group([signal, client.signal("0/in/bit")])
        array = client.domain_array()
        image = bytearray(image_bytes(client))
        client.sample()
        kill(memory)
        with pytest.raises(UnreachableError, match="has ended"):
            client.sample()
        assert signal.raw == 0
        bus.slaves[0].inputs[0].entries[5] = Entry(0x6000, 6, "i16", 3, 16, "mA", 4.0)
        memory = restarted(bus, client)
        struct.pack_into("<h", image, signal.bit_offset // 8, -7)
        put_image(memory, bytes(image))
        client.sample()
        assert (signal.raw, signal.value, signal.unit) == (-7, -28.0, "mA")
        assert several.raw == (-7, 0)
        assert array["0/in/i16"] == -7
        memory.close()


def test_an_image_of_another_size_takes_the_place_of_the_old_one() -> None:
    """Domains do not belong to the identity of a bus; old arrays keep what they had."""
    one = Slave(0, "a", 1, 2, 3, inputs=[Pdo(0x1A00, "p", 0, [Entry(0x6000, 1, "x", 6, 16)])])
    two = Slave(
        1,
        "b",
        1,
        2,
        3,
        inputs=[Pdo(0x1A00, "p", 0, [Entry(0x6000, 1, "y", 0x1B, 64)])],
    )
    bus = Bus(f"p{os.urandom(4).hex()}", 500, [one, two])
    bus.domains = [Domain("fast"), Domain("slow")]
    memory = serve(bus)
    with Client(bus.name) as client:
        x, y = client.signal("0/x"), client.signal("1/y")
        put_image(memory, b"\1\2" + bytes(7) + b"\3")
        client.sample()
        old = client.domain_array(0).copy(), client.domain_array(0)
        assert (x.raw, y.raw) == (0x0201, 3 << 56)
        for wanted in (1, 0, 1):
            kill(memory)
            with pytest.raises(UnreachableError):
                client.sample()
            two.domain = wanted
            memory = restarted(bus, client)
            put_image(memory, b"\7\0" + bytes(7) + b"\7")
            client.sample()
            assert (x.raw, x.domain, y.domain) == (7, 0, wanted)
            assert y.raw == (7 << 56 if wanted == 0 else 0)
            assert len(client.domain_array(wanted)["1/y"].tobytes()) == 8
        assert old[0]["0/x"] == old[1]["0/x"] == 0x0201
    gc.collect()
    assert old[1]["1/y"] == 3 << 56
    memory.close()

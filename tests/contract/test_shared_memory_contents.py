"""`ecatctl shm` and `claims` on shared memory that is sound, damaged, left behind, or random."""

import json
import os
import random
import re
import resource
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from test_shared_memory import make_bus, name_of, put_image

from conftest import SHM, names, naming
from ecatd.base.errors import EcatError, NotPermittedError, StateError, UnreachableError, UsageError
from ecatd.base.file_locks import take
from ecatd.cli.output import WIDTH
from ecatd.cli.shared_memory_screen import age, claims_lines, contents_lines
from ecatd.master.engine.process_image import lay_out
from ecatd.master.engine.shared_memory import SharedMemory
from ecatd.shm import contract as shm
from ecatd.shm import raw
from ecatd.shm.contents import contents, read_outputs
from ecatd.shm.statistics import read
from ecatd.shm.statistics.clocks import read_clocks

pytestmark = pytest.mark.unprivileged


@pytest.fixture
def shared() -> Iterator[SharedMemory]:
    bus = make_bus()
    made = SharedMemory(bus.name, SHM)
    made.fill(bus, lay_out(bus, set()), 5_000_000, 500_000_000)
    made.header.state = shm.BusState.RUNNING
    made.header.cycle_end_ns = 1 << 62  # "just now" for ever: no engine runs here
    made.publish()
    yield made
    made.close()


def table(shared: SharedMemory, name: str, struct_name: str, number: int = 0) -> Any:
    offset = getattr(shared.header, f"{name}_offset") + number * shm.size(struct_name)
    return shm.struct(struct_name).from_address(shared.address + offset)


def page(shared: SharedMemory) -> Any:
    domain = table(shared, "domains", "ecat_shm_domain")
    return shm.struct("ecat_shm_page").from_address(shared.address + domain.page_offset)


def exchange(shared: SharedMemory, image: bytes) -> None:
    put_image(shared, image)
    row = page(shared)
    row.cycle, row.wkc, row.wkc_state = 7, 3, shm.WkcState.COMPLETE
    for position in range(2):
        table(shared, "slave_status", "ecat_shm_slave_status", position).al_state = 8


def test_values_of_all_shapes_are_shown(shared: SharedMemory) -> None:
    odd = -700
    word = 1 | ((odd & 0x7FF) << 1)
    exchange(shared, struct.pack("<HHQqfd", 515, word, (1 << 64) - 1, -(1 << 63), 1.5, -2.25))
    found = contents(name_of(shared))
    assert [s["raw"] for s in found["signals"]] == [
        *(1, odd, (1 << 64) - 1, -(1 << 63), 1.5, -2.25, 515)
    ]
    assert {s["validity"] for s in found["signals"]} == {"valid"}
    scaled = found["signals"][4]
    assert (scaled["value"], scaled["unit"], scaled["scaled"]) == (1.75, "V", True)
    assert found["problems"] == []
    text = "\n".join(contents_lines(found))
    assert "1.75 V" in text
    assert "18446744073709551615" in text
    assert max(map(len, text.splitlines())) <= WIDTH


def test_validity_says_why(shared: SharedMemory) -> None:
    def seen() -> list[str]:
        return [signal["validity"] for signal in contents(name_of(shared))["signals"]]

    assert set(seen()) == {"never"}
    exchange(shared, bytes(32))
    table(shared, "slave_status", "ecat_shm_slave_status", 0).al_state = 4
    table(shared, "slave_status", "ecat_shm_slave_status", 1).al_state = 4
    assert seen() == ["valid"] * 6 + ["not_operational"]  # SAFEOP has inputs, but no outputs
    shared.slaves[0].group, page(shared).absent = 3, 1 << 3
    its = [signal.slave == 0 for signal in shared.signals[:7]]
    assert [word == "incomplete" for word in seen()] == its  # its group is absent
    page(shared).absent = 1 << 4
    assert seen() == ["valid"] * 6 + ["not_operational"]
    table(shared, "slave_status", "ecat_shm_slave_status", 0).al_state = 0x14
    assert set(seen()) == {"not_operational"}
    page(shared).wkc_state = shm.WkcState.INCOMPLETE
    assert set(seen()) == {"incomplete"}
    shared.header.cycle_end_ns = 1
    assert set(seen()) == {"stale"}


def test_clients_are_shown_without_what_steers_a_terminal(shared: SharedMemory) -> None:
    out = shared.out
    bell = shm.struct("ecat_out_doorbell")(generation=3)
    os.pwrite(shared.out_fd, bytes(bell), out.doorbells_offset + 2 * len(bytes(bell)))
    evil = b"\x1b[31mroot\x07\n\xff\xe2\x80\xae" + b"x" * 19  # no end, and a right-to-left override
    client = shm.struct("ecat_out_slot")(pid=4242, generation=3, since_ns=1)
    data = bytearray(bytes(client))
    data[-32:] = evil
    os.pwrite(shared.out_fd, bytes(data), out.slots_offset + 2 * out.slot_stride)
    status = table(shared, "slot_status", "ecat_shm_slot_status", 2)
    status.state, status.reason = shm.SlotState.LAPSED, shm.Reason.LAPSED
    status.lease_ns, status.lapses, status.refused = 20_000_000, 1, 4
    output = table(shared, "outputs", "ecat_shm_output", 6)
    output.owner, output.state, output.since_cycle, output.since_ns = 2, 2, 9, 1

    found = read_outputs(name_of(shared), names=True)
    (slot,) = found["owners"]
    assert (slot["slot"], slot["pid"], slot["state"], slot["held"]) == (2, 4242, "lapsed", False)
    assert (slot["lease_ms"], slot["outputs"], slot["lapses"]) == (20, 1, 1)
    assert slot["name"].startswith("�[31mroot��")
    assert slot["since"] < time.time() - 1
    (owned,) = found["outputs"]
    assert (owned["address"], owned["owner"], owned["state"]) == ("0x7000:01", 0, "active")
    lines = claims_lines({**found})
    assert all(line.isprintable() for line in lines)
    assert lines[4:7] == [
        "      has lost its outputs: lease lost",
        "      the process is gone",
        "      4 values out of their range were refused",
    ]
    assert max(map(len, lines)) <= WIDTH


@pytest.mark.parametrize(
    ("row", "field", "value", "problem"),
    [
        (("slaves", "ecat_shm_slave", 1), "domain", 9, "slaves[1] | domain 9"),
        (("slaves", "ecat_shm_slave", 0), "name", b"x" * 64, "slaves[0] | name"),
        (("slaves", "ecat_shm_slave", 0), "input_bytes", 1 << 31, "slaves[0] | inputs"),
        (("slaves", "ecat_shm_slave", 0), "signals_count", 99, "slaves[0] | entries"),
        (("signals", "ecat_shm_signal", 3), "bit_length", 65, "signals[3] | 65 bits"),
        (("signals", "ecat_shm_signal", 3), "slave", 99, "signals[3] | slave 99"),
        (("signals", "ecat_shm_signal", 3), "domain", 1, "signals[3] | domain 1"),
        (("signals", "ecat_shm_signal", 3), "bit_offset", 999, "signals[3] | bit 1063"),
        (("signals", "ecat_shm_signal", 2), "unit", b"y" * 16, "signals[2] | unit"),
        (("domains", "ecat_shm_domain", 0), "page_offset", 3, "ecat_shm_page | byte 3"),
        (("domains", "ecat_shm_domain", 0), "image_bytes", 1 << 31, "no room | 2147483648 bytes"),
        (("domains", "ecat_shm_domain", 0), "output_base", 1 << 31, "domains[0] | outputs"),
        (("domains", "ecat_shm_domain", 0), "divider", 0, "domains[0] | divider 0"),
        (("outputs", "ecat_shm_output", 6), "owner", 32, "outputs[6] | slot 32"),
    ],
)
def test_what_is_damaged_is_named_and_the_rest_shown(
    shared: SharedMemory, row: tuple[str, str, int], field: str, value: Any, problem: str
) -> None:
    exchange(shared, bytes(32))
    setattr(table(shared, *row), field, value)
    found = contents(name_of(shared))
    wanted = naming(*problem.split(" | "))
    assert any(re.search(wanted, text) for text in found["problems"]), found["problems"]
    assert len(found["signals"]) == 7
    text = "\n".join(contents_lines(found))
    assert "DAMAGED: " in text
    assert "Restart the daemon" in text


def test_an_image_larger_than_the_memory_is_no_traceback(shared: SharedMemory) -> None:
    table(shared, "domains", "ecat_shm_domain").image_bytes = 0xFFFFFFF0
    most = 3 << 30  # bytes of address space
    shown = subprocess.run(
        [sys.executable, "-m", "ecatd.cli", "shm", "--bus", name_of(shared)],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (most, most)),
        text=True,
        capture_output=True,
        check=False,
    )
    names(" ".join(shown.stdout.split()), "no room", "4294967280 bytes", "image")
    assert shown.stderr == ""


def test_r26_a_page_that_was_left_in_the_middle_is_told(shared: SharedMemory) -> None:
    page(shared).seq = 5
    (problem,) = contents(name_of(shared))["problems"]
    names(problem, "domains[0]", "page", "writer")


@pytest.mark.parametrize(
    ("field", "value", "problem"),
    [
        ("slaves_offset", 0xFFFFFFF8, "ecat_shm_slave | 2 entries"),
        ("signals_offset", 4, "ecat_shm_signal | 7 entries | byte 4"),
        ("slave_count", 1025, "slave_count | 1025 | 1024"),
        ("domain_count", 17, "domain_count | 17 | 16"),
        ("signal_count", 1 << 30, "ecat_shm_signal | 1073741824"),
        ("health_offset", 0xFFFFFFF8, "ecat_shm_health"),
        ("settings_offset", 1, "ecat_shm_setting"),
        ("cycle_time_ns", 0, "header | cycle time | 0"),
    ],
)
def test_a_table_that_is_not_there_is_told(
    shared: SharedMemory, field: str, value: int, problem: str
) -> None:
    setattr(shared.header, field, value)
    found = contents(name_of(shared))
    wanted = naming(*problem.split(" | "))
    assert any(re.search(wanted, text) for text in found["problems"]), found["problems"]
    assert contents_lines(found)


@contextmanager
def copy_of(shared: SharedMemory, *, alive: bool) -> Iterator[tuple[str, Path, int]]:
    """Both files under another name; `alive`: with the lock of a daemon held."""
    name = f"{name_of(shared)}c"
    path = SHM / name
    out = path.with_name(f"{path.name}.out")
    with ExitStack() as stack:
        for file, source in ((path, shared.path), (out, shared.out_path)):
            file.write_bytes(source.read_bytes())
            stack.callback(file.unlink, missing_ok=True)
        fd = os.open(path, os.O_RDWR)
        stack.callback(os.close, fd)
        if alive:
            assert take(fd, shm.LOCK_DAEMON)
        yield name, path, fd


def test_a_leftover_is_shown_and_what_to_do_with_it(shared: SharedMemory) -> None:
    with copy_of(shared, alive=False) as (name, path, _fd):
        found = contents(name)
        assert not found["alive"]
        assert len(found["signals"]) == 7
        text = "\n".join(contents_lines(found))
        assert "NO DAEMON" in text
        assert f"rm -f {path} {path}.out" in text
        with pytest.raises(UnreachableError, match=naming("not running", f"'{name}'")):
            read_outputs(name)
        path.with_name(f"{path.name}.out").unlink()
        assert contents(name)["slots"] == []


@pytest.mark.parametrize(
    ("alive", "change", "tokens"),
    [
        (False, b"", "leftover | 0 bytes"),
        (False, b"garbage of a daemon", "leftover | 19 bytes"),
        (True, b"", "is still starting"),
        (False, bytes(4096), "leftover | never finished"),
        (True, b"GARBAGE!\0\0\1\0" + bytes(4096), "magic number | byte 0 | 'GARBAGE!'"),
        (True, b"\x1b[31mROT\0\0\1\0" + bytes(4096), "magic number | byte 0 | '�[31mROT'"),
        (True, b"ECATSHM1\0\0\2\0" + bytes(4096), "layout | 2.0 | 1.0 | update"),
        (False, b"ECATSHM1\1\0\0\0" + bytes(4096), "layout | 0.1 | 1.0 | update the daemon"),
    ],
)
def test_what_is_no_shared_memory_is_told_in_one_sentence(
    shared: SharedMemory, alive: bool, change: bytes, tokens: str
) -> None:
    with copy_of(shared, alive=alive) as (name, path, _fd):
        path.write_bytes(change)
        with pytest.raises((StateError, UnreachableError)) as caught:
            contents(name)
        names(caught.value, *tokens.split(" | "))
        assert str(caught.value).isprintable()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_who_may_not_see_the_clients_sees_the_rest(shared: SharedMemory) -> None:
    status = table(shared, "slot_status", "ecat_shm_slot_status", 4)
    status.state = shm.SlotState.ACTIVE
    shared.out_path.chmod(0)
    found = contents(name_of(shared))
    (slot,) = found["slots"]
    assert (slot["slot"], slot["pid"], slot["name"], slot["held"]) == (4, None, None, None)
    assert found["problems"] == []
    assert " 4    ?  ?  " in "\n".join(contents_lines(found))
    with pytest.raises(NotPermittedError, match=naming("group 'ecat'")):
        raw.read_raw(name_of(shared), "slots")


def test_a_file_that_is_cut_short_says_so(shared: SharedMemory) -> None:
    with copy_of(shared, alive=True) as (name, path, _fd):
        size = path.stat().st_size
        os.truncate(path, size - 8)
        with pytest.raises(StateError, match=naming(size, size - 8)):
            contents(name)


def test_the_file_of_the_clients_may_be_damaged_too(shared: SharedMemory) -> None:
    with copy_of(shared, alive=True) as (name, path, _fd):
        out = path.with_name(f"{path.name}.out")
        whole = out.read_bytes()
        for data, problem in (
            (b"", "header"),
            (bytes(8) + whole[8:], "magic number"),
            (whole[:16] + bytes(8) + whole[24:], "another run"),
            (whole[:12] + b"\xff" * 4 + whole[16:], "4294967295 slots"),
        ):
            out.write_bytes(data)
            found = contents(name)
            assert [text for text in found["problems"] if problem in text], found["problems"]
        out.write_bytes(whole[:4096])  # without slots: nobody can be named
        assert contents(name)["slots"] == []
        with pytest.raises(StateError, match=naming("slots", "cut short")):
            raw.read_raw(name, "slots")
        out.unlink()
        (problem,) = contents(name)["problems"]
        names(problem, f"{path}.out")


@pytest.mark.parametrize("name", raw.NAMES)
def test_every_table_can_be_seen_as_it_is(shared: SharedMemory, name: str) -> None:
    slots, requests = shm.SLOTS, shm.SLOTS * shm.REQUESTS
    counts = {
        "slaves": 2,
        "slave_status": 2,
        "signals": 7,
        "outputs": 7,
        "settings": shm.SETTINGS,
        "slot_status": slots,
        "doorbells": slots,
        "slots": slots,
        "replies": requests,
        "requests": requests,
        "images": shm.SLOTS * shm.IMAGES,
        "can": 0,
        "can_senders": 0,
    }
    rows = raw.read_raw(name_of(shared), name)
    assert len(rows) == counts.get(name, 1)
    for row in rows:
        made = raw.plain(row)
        assert list(made) == [field.name for field in shm.fields_of(type(row).__name__)]
    if name == "signals":
        assert (made["name"], made["index"], made["bit_length"]) == ("u16", 0x7000, 16)


def test_a_table_that_does_not_exist(shared: SharedMemory) -> None:
    with pytest.raises(UsageError, match=naming("'nothing'", "header", "slaves")):
        raw.read_raw(name_of(shared), "nothing")


def mutate(random_: random.Random, fd: int, size: int, hot: list[int]) -> None:
    """Some random bytes, where they matter more often than elsewhere."""
    for _ in range(random_.choice((1, 1, 2, 5, 20))):
        near = random_.choice(hot) + random_.randrange(400)
        at = random_.choice((near, near, random_.randrange(size)))
        value = random_.choice(
            (
                random_.randbytes(random_.choice((1, 2, 4, 8, 64))),
                b"\xff" * random_.choice((1, 4, 8)),
                struct.pack("<I", 1 << random_.randrange(32)),
                struct.pack("<d", random_.choice((float("nan"), float("inf"), 1e308))),
            )
        )
        os.pwrite(fd, value, min(at, size - len(value)))


def read_all_else(bus: str) -> None:
    for reader in (read, read_clocks):
        with suppress(EcatError):
            reader(bus)
    for name in raw.NAMES:
        with suppress(EcatError):
            json.dumps([raw.plain(row) for row in raw.read_raw(bus, name)])


@pytest.mark.parametrize("mutations", [1000, pytest.param(5_000, marks=pytest.mark.long)])
@pytest.mark.parametrize("alive", [True, False])
def test_random_mutations_are_no_tracebacks(
    shared: SharedMemory, alive: bool, mutations: int
) -> None:
    random_ = random.Random(4711)
    exchange(shared, random_.randbytes(32))
    refused = told = sound = 0
    with copy_of(shared, alive=alive) as (name, path, fd):
        out = os.open(path.with_name(f"{path.name}.out"), os.O_RDWR)
        whole, whole_out = os.pread(fd, 1 << 24, 0), os.pread(out, 1 << 24, 0)[: 3 * 4096]
        hot = [0, 12, *(getattr(shared.header, f"{key}_offset") for key in shm.TABLES)]
        hot.append(table(shared, "domains", "ecat_shm_domain").page_offset)
        for turn in range(mutations // 2):
            mutate(random_, fd, len(whole), hot)
            mutate(random_, out, len(whole_out), [0, 4096, 8192])
            if turn % 50 == 0:
                os.truncate(fd, random_.randrange(len(whole)))
            try:
                found = contents(name)
            except EcatError as error:
                refused += 1
                lines = [str(error)]
            else:
                told, sound = told + bool(found["problems"]), sound + (not found["problems"])
                lines = contents_lines(found)
                assert json.dumps(found)
                with suppress(EcatError):
                    lines += claims_lines({**read_outputs(name, names=True)})
            assert all(line.isprintable() for line in lines)
            if turn % 10 == 0:
                read_all_else(name)
            os.pwrite(fd, whole, 0)
            os.pwrite(out, whole_out, 0)
        os.close(out)
    # Each kind of outcome was met often, or this would say nothing.
    assert min(told, refused) > mutations // 100
    assert sound > mutations // 100


def test_ages_are_short() -> None:
    assert [age(us) for us in (None, 0.4, 999, 1234, 250_000, 3.4e6, 3.6e9)] == [
        *("-", "0 µs", "999 µs", "1.2 ms", "250 ms", "3.4 s", "1:00:00")
    ]

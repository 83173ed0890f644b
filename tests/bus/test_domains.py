"""Several domains on one bus: who is exchanged when, and that every byte arrives."""

import mmap
import os
import re
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from raw_slot import RawSlot

from conftest import PATIENCE, SHM, Daemon, names, one_line_error
from ecatd.client import Client
from ecatd.shm import contract as shm

pytestmark = [pytest.mark.bus, pytest.mark.long]

CYCLE_TIME_US = 1000
"""The dividers of these tests are those of 1000 cycles a second."""

RIG = Path(__file__).parents[1] / "rigs" / "domains.py"
DIVIDERS = (1, 4, 10)
SLAVES = (range(4), range(4, 34), range(34, 40))
WITHOUT_LRW = (1, 10)
TRIES = 5000

CONFIG = """
cycle_time_us = 2000
[gateway]
listen = []
[[domain]]
name = "fast"
[[domain]]
name = "mid"
divider = 4
slaves = ["4-33"]
[[domain]]
name = "slow"
divider = 10
slaves = [34, "35-39"]
"""


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    """Domains of 4, 30 and 6 slaves; the second is larger than a frame."""
    folder = tmp_path_factory.mktemp("domains")
    daemon = Daemon(folder, str(RIG), config=CONFIG).wait_ready()
    yield daemon
    assert daemon.stop() == 0
    daemon.close()


@contextmanager
def shared(daemon: Daemon) -> Iterator[Callable[..., Any]]:
    """Reads structures of the shared memory as they are at the moment of the call."""
    fd = os.open(SHM / daemon.bus, os.O_RDONLY)
    with mmap.mmap(fd, 0, prot=mmap.PROT_READ) as data:
        os.close(fd)

        def table(name: str, offset: str = "", row: int = 0) -> Any:
            kind = shm.struct(name)
            header = shm.struct("ecat_shm_header").from_buffer_copy(data, 0)
            at = getattr(header, offset) + row * shm.size(name) if offset else 0
            return kind.from_buffer_copy(data, at)

        yield table


def pattern(slave: int, byte: int, turn: int) -> int:
    return (slave * 7 + byte * 3 + turn) % 255 + 1


def write_all(client: Client, slaves: Iterator[int] | range, turn: int) -> None:
    for slave in slaves:
        for byte in range(1, 33):
            client.signal(slave, 0x7000, byte).raw = pattern(slave, byte, turn)
    client.commit()


def read_all(client: Client, slave: int) -> list[float]:
    return [client.signal(slave, 0x6000, byte).raw for byte in range(1, 33)]


def arrive(client: Client, slaves: Iterator[int] | range, turn: int) -> None:
    """Waits until every slave has returned all of its bytes."""
    missing = list(slaves)
    for _ in range(TRIES):
        client.wait()
        client.sample()
        missing = [
            slave
            for slave in missing
            if read_all(client, slave) != [pattern(slave, byte, turn) for byte in range(1, 33)]
        ]
        if not missing:
            return
    pytest.fail(f"bytes of slaves {missing} do not come back")


def test_the_configuration_is_what_clients_see(mixed: Daemon) -> None:
    with mixed.client() as client, shared(mixed) as table:
        slaves = client.slaves()
        for number, positions in enumerate(SLAVES):
            assert {slaves[position].domain for position in positions} == {number}
            row = table("ecat_shm_domain", "domains_offset", number)
            assert row.name.decode() == ("fast", "mid", "slow")[number]
            assert row.divider == DIVIDERS[number]
            assert row.image_bytes == 2 * row.output_bytes == 64 * len(positions)
            # A slave counts 2 for its outputs and 1 for its inputs, 1 and 1 without LRW.
            split = sum(position in WITHOUT_LRW for position in positions)
            assert row.wkc_expected == 3 * len(positions) - split
    document = mixed.slave_rows("slaves")
    assert [(s["domain"], s["domain_name"]) for s in (document[3], document[4], document[39])] == [
        (0, "fast"),
        (1, "mid"),
        (2, "slow"),
    ]
    assert "  1 mid " in mixed.ctl("slaves").stdout.splitlines()[5]
    assert mixed.ctl("pdos", "34").stdout.startswith("34  Loopback32  (domain 2 (slow))\n")
    assert mixed.ctl_json("pdos", "0")["domains"][1] == {
        "name": "mid",
        "divider": 4,
        "phase": 0,
    }


def test_each_domain_is_exchanged_every_so_many_cycles(mixed: Daemon) -> None:
    with mixed.client() as client, shared(mixed) as table:
        seen: list[dict[int, tuple[int, int]]] = [{}, {}, {}]
        complete = [0, 0, 0]
        for _ in range(200):
            client.wait()
            client.sample()
            for number in range(3):
                domain = client.domain(number)
                seen[number][domain.cycle] = (domain.time_ns, domain.wkc)
                complete[number] += domain.wkc_state == shm.WkcState.COMPLETE
                if domain.wkc_state == shm.WkcState.COMPLETE:
                    assert domain.wkc == domain.wkc_expected
        for number, divider in enumerate(DIVIDERS):
            cycles = list(seen[number])
            times = [time for time, _ in seen[number].values()]
            assert cycles == sorted(cycles)
            assert times == sorted(set(times))
            assert len(cycles) > 5
            # One exchange in each row of `divider` cycles: at its start, unless that was missed.
            assert len({cycle // divider for cycle in cycles}) == len(cycles)
            assert complete[number] > 100  # frames may be late on a busy machine, not most
        assert len(seen[0]) > len(seen[1]) > len(seen[2])
        take_turns(client, table, [(divider, 0) for divider in DIVIDERS])


TURNS = ((1, 0), (4, 1), (4, 3), (6, 2), (20, 0))
"""Divider and phase of each domain."""

STRANGERS = ((1, 2), (1, 3), (2, 3), (1, 4), (2, 4))
"""Domains that are never exchanged in the same cycle."""


@pytest.fixture(scope="module")
def phased(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    """Domains of one slave each that take turns."""
    tables = "".join(
        f"[[domain]]\ndivider = {divider}\nphase = {phase}\nslaves = [{n}]\n"
        for n, (divider, phase) in enumerate(TURNS)
    )
    config = f"cycle_time_us = 2000\n[gateway]\nlisten = []\n{tables}"
    daemon = Daemon(tmp_path_factory.mktemp("phases"), "line:5", config=config).wait_ready()
    yield daemon
    assert daemon.stop() == 0
    daemon.close()


def exchanges(client: Client, cycles: int, domains: int = len(TURNS)) -> list[set[int]]:
    """The cycles in which each domain was exchanged, as far as they were seen in these cycles."""
    seen: list[set[int]] = [set() for _ in range(domains)]
    for _ in range(cycles):
        client.wait()
        client.sample()
        for number, found in enumerate(seen):
            found.add(client.domain(number).cycle)
    return seen


def take_turns(client: Client, table: Callable[..., Any], turns: Sequence[tuple[int, int]]) -> None:
    """Asserts that domains are exchanged at their turns, while no cycle is missed."""
    end = time.monotonic() + PATIENCE
    while True:
        missed = table("ecat_shm_health", "health_offset").missed
        begin = table("ecat_shm_header").cycle + 2  # until here, an earlier turn is made up for
        seen = exchanges(client, 60, len(turns))
        if table("ecat_shm_health", "health_offset").missed == missed:
            break
        assert time.monotonic() < end, "cycles are missed again and again"
    for found, (divider, phase) in zip(seen, turns, strict=True):
        assert {cycle % divider for cycle in found if cycle > begin} == {phase}


def test_domains_with_phases_take_turns(phased: Daemon) -> None:
    with phased.client() as client, shared(phased) as table:
        rows = [table("ecat_shm_domain", "domains_offset", n) for n in range(len(TURNS))]
        assert [(row.divider, row.phase) for row in rows] == list(TURNS)
        seen = exchanges(client, 200)
        assert all(len(found) >= 3 for found in seen)
        for one, other in STRANGERS:
            assert not seen[one] & seen[other]
        take_turns(client, table, TURNS)
    assert [d["phase"] for d in phased.ctl_json("stats")["domains"]] == [p for _, p in TURNS]
    assert "     4+3  3/3 " in phased.ctl("stats").stdout


def test_r20_phases_outlast_missed_cycles(phased: Daemon) -> None:
    divider = TURNS[-1][0]
    with phased.client() as client, shared(phased) as table:
        server = phased.child_pid("ecatd.server")
        made_up = 0
        for _ in range(TRIES):  # the turn of the slowest domain has to be missed
            client.wait()
            now = table("ecat_shm_header").cycle
            if now % divider != divider - 3:
                continue
            turn = now + 3
            os.kill(server, signal.SIGSTOP)
            time.sleep(0.02)
            os.kill(server, signal.SIGCONT)
            seen = exchanges(client, 10)
            for one, other in STRANGERS:
                assert not seen[one] & seen[other]
            late = {cycle for cycle in seen[-1] if turn < cycle < turn + divider}
            # It has made up for its turn, and once.
            assert len(late) <= 1
            made_up += len(late)
            if made_up >= 3:
                break
        else:
            pytest.fail("no turn was made up for")
        take_turns(client, table, TURNS)


def test_exchanges_and_those_left_out_are_counted(mixed: Daemon) -> None:
    with mixed.client() as client, shared(mixed) as table:
        for number, divider in enumerate(DIVIDERS):

            def turns(number: int = number) -> tuple[int, int, int]:
                before = table("ecat_shm_header").cycle
                status = table("ecat_shm_domain_status", "domain_status_offset", number)
                after = table("ecat_shm_header").cycle + 1
                return before, status.exchanges + status.overruns, after

            earliest, first, early = turns()
            client.wait(100)
            late, last, latest = turns()
            # One where each multiple is reached.
            assert late // divider - early // divider <= last - first
            assert last - first <= latest // divider - earliest // divider


def test_r11_every_byte_of_every_slave_arrives(mixed: Daemon) -> None:
    everybody = range(40)
    with mixed.client() as client:
        for slave in everybody:
            client.claim(slave, lease=30)
        for turn in (0, 100):
            write_all(client, everybody, turn)
            arrive(client, everybody, turn)
        # Domains do not disturb each other: the others keep what they have.
        write_all(client, SLAVES[1], 7)
        arrive(client, SLAVES[1], 7)
        for number in (0, 2):
            arrive(client, SLAVES[number], 100)


def test_sampling_one_domain_leaves_the_others(mixed: Daemon) -> None:
    with mixed.client() as client:
        client.sample()
        before = [client.domain(number).cycle for number in range(3)]
        client.wait(20)
        client.sample(1)
        now = [client.domain(number).cycle for number in range(3)]
        assert now[0] == before[0]
        assert now[2] == before[2]
        assert now[1] > before[1]


def test_outputs_answer_the_newest_sample(mixed: Daemon) -> None:
    """Not that of the slowest domain, which may be ten cycles old."""
    with mixed.client() as client, shared(mixed) as table:
        client.claim(0, lease=30)
        before = list(table("ecat_shm_health", "health_offset").delay_cycles)
        for turn in range(100):
            client.wait()
            client.sample()
            write_all(client, range(1), turn)
        client.wait()
        after = list(table("ecat_shm_health", "health_offset").delay_cycles)
        delays = [now - then for now, then in zip(after, before, strict=True)]
        assert sum(delays) > 50
        assert delays[3] < sum(delays) / 2  # a busy machine may delay some, not most


def test_outputs_answer_the_newest_of_samples_of_one_domain(mixed: Daemon) -> None:
    with mixed.client() as client:
        client.claim(0, lease=30)
        slot = RawSlot(mixed.bus)
        for _ in range(TRIES):
            client.wait()
            client.sample(0)
            client.sample(2)
            newest, slow = client.domain(0).cycle, client.domain(2).cycle
            client.commit()
            if newest > slow:
                break
        assert slot.committed().sample_cycle == newest > slow


def test_outputs_of_one_domain_are_safe_when_their_client_ends(mixed: Daemon) -> None:
    with mixed.client() as reader:
        with mixed.client() as owner:
            owner.claim(36, lease=30)
            write_all(owner, range(36, 37), 1)
            arrive(owner, range(36, 37), 1)
        for _ in range(TRIES):
            reader.wait()
            reader.sample()
            if read_all(reader, 36) == [0.0] * 32:
                break
        else:
            pytest.fail("the outputs stay")


def test_r12_an_image_larger_than_a_frame(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("line:30", config="cycle_time_us = 2000\n[gateway]\nlisten = []\n")
    frames = daemon.ctl_json("info")["wire_frames"]
    assert frames == 2  # 1920 bytes
    with daemon.client() as client, shared(daemon) as table:
        for slave in range(30):
            client.claim(slave, lease=30)
        write_all(client, range(30), 3)
        arrive(client, range(30), 3)
        assert client.domain().wkc_expected == 90
        # The engine packs as the arithmetic does.
        before = table("ecat_shm_health", "health_offset").cycles
        sent = table("ecat_shm_health", "health_offset").frames
        after = table("ecat_shm_health", "health_offset").cycles
        assert frames * before <= sent <= frames * (after + 1)


def test_sixteen_domains(start_daemon: Callable[..., Daemon]) -> None:
    tables = "".join(
        f"[[domain]]\nname = 'd{n}'\ndivider = {n + 1}\nslaves = [{n}]\n" for n in range(16)
    )
    config = f"cycle_time_us = 2000\n[gateway]\nlisten = []\n{tables}"
    daemon = start_daemon("line:16", config=config)
    with daemon.client() as client:
        assert [slave.domain for slave in client.slaves()] == list(range(16))
        for slave in range(16):
            client.claim(slave, lease=30)
        write_all(client, range(16), 9)
        arrive(client, range(16), 9)
        client.wait(32)
        client.sample()
        cycles = [client.domain(number).cycle for number in range(16)]
        assert len({cycle // 16 for cycle in cycles}) <= 3
        assert all(client.domain(number).wkc_expected == 3 for number in range(16))
    assert daemon.stop() == 0


@pytest.mark.parametrize(
    ("rig", "config", "status", "what"),
    [
        (
            "line:2",
            "[[domain]]\n[[domain]]\nname = 'slow'\nslaves = [1, 2]\n",
            7,
            "ecat.toml:4: domain[1].slaves: | slave 2 | 2 slaves",
        ),
        (
            "troll",
            "[[domain]]\n[[domain]]\nname = 'coupler'\nslaves = [1]\n",
            2,
            "ecat.toml:4: domain[1].slaves: | domain 1 (coupler) | nothing",
        ),
        (
            "troll",
            "[[domain]]\n[[domain]]\nname = 'slow'\ndivider = 100\nslaves = [3]\n",
            2,
            "ecat.toml:4: domain[1].divider: | domain 1 (slow) | every 100 ms"
            " | watchdog | slave 3 (EL2008) | 100 ms | divider",
        ),
        ("line:64", "cycle_time_us = 200\n", 7, "IO larger than the wire allows | 200 µs"),
        ("line:16", "cycle_time_us = 100\n", 7, "cycle time too short | cycle_time_us"),
    ],
)
def test_what_cannot_work_is_refused(
    start_daemon: Callable[..., Daemon], rig: str, config: str, status: int, what: str
) -> None:
    daemon = start_daemon(rig, ready=False, config=config)
    found, log = daemon.wait_end()
    assert found == status, log
    names(one_line_error(log, "ecatd"), "error: ", *what.split(" | "))
    assert "Traceback" not in log


UNWATCHED = """
from ecatsim import Rig
from ecatsim.devices.generic import Loopback
from ecatsim.slave.sii import SmType, SyncManager

class Unwatched(Loopback):
    sync_managers = (
        SyncManager(SmType.OUTPUTS, 0x1000, 32, 0x24),
        SyncManager(SmType.INPUTS, 0x1100, 32, 0x20),
    )

def rig():
    return Rig("unwatched", [Unwatched(), Loopback()])
"""


def test_a_slow_domain_does_not_hold_up_a_stop(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    rig = tmp_path / "unwatched.py"
    rig.write_text(UNWATCHED)
    slow = "[[domain]]\nslaves = [1]\n[[domain]]\ndivider = 60000\nslaves = [0]\n"
    daemon = start_daemon(str(rig), ready=False, config=f"[gateway]\nlisten = []\n{slow}")
    while not list(SHM.glob(f"{daemon.bus}.out")):  # the exchange begins
        assert daemon.process.poll() is None, daemon.log
        time.sleep(0.01)
    daemon.stop()
    assert "it is killed" not in daemon.log
    assert not list(SHM.glob(f"{daemon.bus}*"))


def test_outputs_just_in_time_for_the_watchdog(start_daemon: Callable[..., Daemon]) -> None:
    tables = "[[domain]]\n[[domain]]\ndivider = 60\nslaves = [3]\n"
    daemon = start_daemon("troll", config=f"[gateway]\nlisten = []\n{tables}")
    (told,) = (line for line in daemon.log.splitlines() if "watchdog" in line)
    names(told, "warning", "domain 1", "60 ms", "slave 3 (EL2008)", "100 ms", "one")


def test_little_room_is_told(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("line:16", config="cycle_time_us = 120\n", ready=False)
    while not re.search("cycle of 120 µs.*1024 bytes", daemon.log):
        assert daemon.process.poll() is None, daemon.log

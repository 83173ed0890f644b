"""A client that turns a drive is killed: the drive stops at once, and not when the lease ends.

Leases here are so long that no test would end with one: all that ends before is the engine's answer
to the death. benchmarks/deaths/ has the number of cycles.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from benchmarks.deaths.clients import KINDS, SPEED, command, victim
from raw_slot import RawSlot
from test_safe_stop import Drive, stop_rule

from conftest import SHM, Daemon, names, naming, wait_for
from ecatd.base.errors import OwnedError, StateError
from ecatd.client import Outputs, Reason
from ecatd.shm import contract as shm

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

LEASE = 60
QUICK = ("C, own PID namespace", "Python")
"""Kinds of clients that are quickly built; all others are for `make test-all`."""
FORKED = """
import os, signal
from ecatd.client import Client
with Client(__import__("sys").argv[1]) as bus:
    bus.claim(3, lease=60)
    bus.signal(3, 0x7000, 1).raw = 1
    bus.commit()
    if os.fork() == 0:
        signal.pause()
    while True:
        bus.wait()
        bus.sample()
"""
THREAD = """
import threading, time
from ecatd.client import Client
bus = Client(__import__("sys").argv[1])
def own():
    bus.claim(3, lease=60)
    bus.signal(3, 0x7000, 1).raw = 1
    bus.commit()
thread = threading.Thread(target=own)
thread.start()
thread.join()
print("over", flush=True)
while True:
    bus.wait()
    bus.sample()
"""


@pytest.fixture(scope="module")
def daemon(start_shared: Callable[..., Daemon]) -> Daemon:
    more = f"[outputs]\nlease_max_ms = {LEASE * 1000}\n"
    return start_shared("troll", config=stop_rule("quick_stop", more))


@contextmanager
def run(command: Sequence[str], **options: Any) -> Iterator[subprocess.Popen[bytes]]:
    """A client, which does not outlive the block, and neither do its children."""
    with subprocess.Popen(command, process_group=0, **options) as client:
        try:
            yield client
        finally:
            with suppress(ProcessLookupError):
                os.killpg(client.pid, signal.SIGKILL)


def row(daemon: Daemon, table: str, number: int) -> Any:
    """What the engine publishes about a slot (`slot_status`) or an output (`outputs`)."""
    data = (SHM / daemon.bus).read_bytes()
    header = shm.struct("ecat_shm_header").from_buffer_copy(data)
    kind = shm.struct(shm.TABLES[table].struct)
    at = getattr(header, f"{table}_offset") + number * shm.size(kind.__name__)
    return kind.from_buffer_copy(data, at)


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(kind, marks=() if kind in QUICK else pytest.mark.long, id=kind)
        for kind in KINDS
    ],
)
def test_r15_a_drive_whose_client_is_killed_stops_at_once(
    kind: str, daemon: Daemon, tmp_path: Path
) -> None:
    if kind == "FMU":
        pytest.importorskip("fmpy", reason="FMPy is not installed (extra 'test')")
    generate = partial(daemon.ctl, "generate")
    with Drive(daemon) as eye, run(command(kind, daemon.bus, LEASE, tmp_path, generate)) as client:

        def turns() -> bool:
            assert client.poll() is None, "the client has ended"
            return eye.speed > 0.9 * SPEED

        eye.until(turns)
        control = eye.client.signal(0, 0x6040)
        slot = eye.client.output(control).owner
        assert slot is not None
        elsewhere = "own PID namespace" in kind
        if elsewhere:  # its number there means nothing here
            with pytest.raises(OwnedError, match=naming("in another PID namespace")):
                eye.client.claim(0, lease=1)
            assert eye.client.output(control).pid == 0
            names(daemon.ctl("shm").stdout, "in another PID namespace")
        begun = row(daemon, "slot_status", slot).beat_ns
        os.kill(victim(kind, client), signal.SIGKILL)
        wait_for(lambda: eye.output()[0] is not shm.Outputs.ACTIVE, daemon)
        assert eye.output()[1] is shm.Reason.DIED
        status = row(daemon, "slot_status", slot)
        output = row(daemon, "outputs", control.number)
        # Not because of the lease: it would still run for most of a minute.
        assert begun <= status.beat_ns <= output.since_ns < begun + status.lease_ns
        assert status.lease_ns == LEASE * 10**9
        if elsewhere:
            said = "' (pid 1 in another PID namespace) has ended without a release"
            wait_for(lambda: said in daemon.log, daemon)
        assert status.state == shm.SlotState.LAPSED
        words, speed = eye.until_off()
        assert words <= {2, 15}
        assert speed < SPEED / 50
    wait_for(lambda: "has ended without a release" in daemon.log, daemon)


def test_r15_a_forked_child_does_not_keep_the_outputs(daemon: Daemon) -> None:
    """It keeps the lock of the slot, which is why the lock does not tell."""
    with (
        daemon.client() as eye,
        run([sys.executable, "-c", FORKED, daemon.bus]) as client,
    ):
        lamp = eye.signal(3, 0x7000, 1)
        wait_for(lambda: eye.output(lamp).state is Outputs.ACTIVE, daemon)
        wait_for(
            lambda: Path(f"/proc/{client.pid}/task/{client.pid}/children").read_text() != "", daemon
        )
        client.kill()
        wait_for(lambda: eye.output(lamp).owner is None, daemon)
        assert eye.output(lamp).reason is Reason.DIED
        slots = daemon.ctl_json("claims")["owners"]
        assert [row["held"] for row in slots if row["pid"] == client.pid] == [True]


def test_the_end_of_a_thread_is_not_the_end_of_its_process(daemon: Daemon) -> None:
    with (
        daemon.client() as eye,
        run([sys.executable, "-c", THREAD, daemon.bus], stdout=subprocess.PIPE) as client,
    ):
        assert client.stdout
        assert client.stdout.readline() == b"over\n"
        lamp = eye.signal(3, 0x7000, 1)
        for _ in range(20):
            eye.wait()
            assert eye.output(lamp).state is Outputs.ACTIVE
        client.kill()
        wait_for(lambda: eye.output(lamp).owner is None, daemon)
        assert eye.output(lamp).reason is Reason.DIED


def test_who_is_called_dead_may_come_back(daemon: Daemon) -> None:
    """The mark is in memory that other clients can write; the log names them."""
    with daemon.client() as client:
        lamp = client.signal(3, 0x7000, 1)
        client.claim(3, lease=LEASE)
        lamp.raw = 1
        client.commit()
        wait_for(lambda: client.output(lamp).state is Outputs.ACTIVE, daemon)
        raw = RawSlot(daemon.bus)
        raw.bell.life |= shm.DIED
        wait_for(lambda: client.output(lamp).owner is None, daemon)
        assert client.output(lamp).reason is Reason.DIED
        lamp.raw = 1
        with pytest.raises(StateError) as refused:
            client.commit()
        names(str(refused.value), "marked", "dead", "claim")
        client.claim(3, lease=LEASE)
        lamp.raw = 1
        client.commit()
        wait_for(lambda: client.output(lamp).state is Outputs.ACTIVE, daemon)

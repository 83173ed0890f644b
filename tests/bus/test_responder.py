"""Frames of the cycle answered in the kernel, as the benchmarks have them, and all others not.

Each test runs in a process of its own, which enters a network namespace.
"""

import functools
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
from benchmarks import native
from benchmarks.segment import responder, tap
from benchmarks.segment.frames import APRD, APWR, ask, datagrams, frame
from benchmarks.segment.peers import Pair
from engine_bench import MASTER, bench, in_namespace

from ecatd.base import network_namespace as namespace
from ecatd.base.errors import StateError
from ecatd.master.engine.engine import Clock
from ecatd.shm import contract as shm
from ecatsim.net import netlink

pytestmark = pytest.mark.bus

PAIR = Pair(MASTER, "sim")
PATIENCE = 120.0
LEASE = 30.0
WATCHDOG = 0x0420


def obstacle():
    """What keeps this process from it; printed, for one that may enter a namespace."""
    namespace.enter_new()
    netlink.create_veth(PAIR.near, PAIR.far)
    with tempfile.TemporaryDirectory() as folder:
        program = native.build(Path(folder), "responder")
        print(responder.obstacle(program, PAIR) or "")


@functools.cache
def said(*wrapper):
    """What `obstacle` prints in a process that is started by `wrapper`."""
    folders = [str(Path(__file__).parent), str(Path(__file__).parents[2])]
    code = f"import sys; sys.path[:0] = {folders!r}; import test_responder as t; t.obstacle()"
    result = subprocess.run(
        [*wrapper, sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    return result.stdout.strip()


@pytest.fixture(autouse=True)
def _possible():
    if reason := said():
        pytest.skip(f"no frames can be answered in the kernel here: {reason}")


def until(condition, what):
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, f"{what} does not come"
        time.sleep(0.002)


def status(b, domain):
    kind = shm.struct("ecat_shm_domain_status")
    at = b.shared.address + b.shared.header.domain_status_offset
    return kind.from_address(at + domain * shm.size("ecat_shm_domain_status"))


def some_cycles(b):
    """Waits for cycles of every kind."""
    domains = range(len(b.image.domains))
    before = [status(b, n).exchanges for n in domains]
    until(lambda: all(status(b, n).exchanges > before[n] + 10 for n in domains), "an exchange")


def started(b, folder):
    """The program, and what a cycle has."""
    b.start()
    program = native.build(Path(folder), "responder")
    return program, tap.answered(lambda: some_cycles(b), PAIR)


@in_namespace
def test_cycles_are_answered_in_the_kernel_and_registers_by_the_simulator():
    with bench(3, domains=[0, 0, 1], dividers=(1, 3)) as b, tempfile.TemporaryDirectory() as folder:
        program, answered = started(b, folder)
        assert len(answered) == 2, "with the second domain, and without"
        client = b.client()
        signals = [(client.signal(i, 0x7000, 1), client.signal(i, 0x6000, 1)) for i in (0, 2)]
        for position in (0, 2):
            client.claim(position, lease=LEASE)

        def returns(number):
            for output, _ in signals:
                output.raw = number
            client.commit()
            client.sample()
            return [inputs.raw for _, inputs in signals] == [number, number]

        until(lambda: returns(7), "what was written")
        answered = tap.answered(lambda: some_cycles(b), PAIR)
        ask(b.wire.exchange, frame(APWR, 0, WATCHDOG, struct.pack("<H", 1000)))
        lost, wrong = b.shared.health.lost, b.shared.health.wkc_bad
        with responder.Responder(program, answered, PAIR) as kernel:
            served, begun = b.esc.counters().frames, kernel.counts
            before = status(b, 1).exchanges
            until(
                lambda: status(b, 1).exchanges > before + 50 and not returns(8),
                "50 exchanges of the slower domain",
            )
            counts = kernel.counts
            # No more: a cycle that a busy machine misses takes the first domain's frames with it.
            assert counts["answered"] - begun["answered"] >= 50
            assert counts["passed"] == begun["passed"]
            assert b.esc.counters().frames == served, "nobody was woken"
            client.sample()
            assert [inputs.raw for _, inputs in signals] == [7, 7], "they stand still"
            assert ask(b.wire.exchange, frame(APRD, 0, WATCHDOG, bytes(2))) == (bytes(2), 1)
            assert kernel.counts["passed"] == begun["passed"] + 1
            assert b.shared.health.slaves_found == 3
            assert b.shared.health.al_status == 8
        until(lambda: returns(9), "what was written, by way of the simulator")
        assert b.shared.health.wkc_bad - wrong == b.shared.health.lost - lost, "no other counters"
        client.close()


@in_namespace
def test_other_frames_of_the_cycle_pass():
    """As when a master of the same name comes with another layout."""
    with bench(2) as b, tempfile.TemporaryDirectory() as folder:
        program, answered = started(b, folder)
        ((sent, answer),) = answered
        shorter = sent[:16] + sent[16:18] + b"\1\0" + sent[20:]  # another address
        with responder.Responder(program, [(shorter, answer)], PAIR) as kernel:
            until(lambda: kernel.counts["passed"] >= 20, "a frame that passes")
            assert kernel.counts["answered"] == 0


@in_namespace
def test_slaves_that_are_not_in_op_are_told():
    with bench(2) as b, tempfile.TemporaryDirectory() as folder:
        program, answered = started(b, folder)
        ((sent, answer),) = answered
        assert datagrams(answer)[0].data == b"\x08\0"
        answer = answer[:26] + b"\x04" + answer[27:]
        with pytest.raises(StateError, match=r"0x04.*\bOP\b"):
            responder.Responder(program, [(sent, answer)], PAIR)


@in_namespace
def test_clocks_are_told():
    with bench(2) as b, tempfile.TemporaryDirectory() as folder:
        b.start(Clock(b.bus.slaves[0].address, 0, 0, 100_000))
        program = native.build(Path(folder), "responder")
        answered = tap.answered(lambda: some_cycles(b), PAIR)
        with pytest.raises(StateError, match="distributed clocks"):
            responder.Responder(program, answered, PAIR)


def test_without_rights_it_is_said():
    assert "Operation not permitted" in said("unshare", "--user", "--map-root-user")

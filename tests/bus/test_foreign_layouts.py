"""Slaves whose EEPROMs are unusual come to OP, and every value arrives."""

import random
from collections.abc import Iterator
from pathlib import Path

import pytest

from conftest import Daemon, run_module, wait_for
from ecatsim.control import Simulator

pytestmark = pytest.mark.bus

RIG = Path(__file__).parents[1] / "rigs" / "foreign_layouts.py"
CONFIG = """
[gateway]
listen = []

[dc]
enabled = true

[[dc.slave]]
slave = 0
sync1_us = 100
"""
SIZES = [(14, 4), (14, 7), (4, 4), (2, 2)]
OVERSAMPLER, FOLLOWER = 0, 1
TURNS = 20


@pytest.fixture(scope="module")
def foreign(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    daemon = Daemon(tmp_path_factory.mktemp("foreign"), str(RIG), config=CONFIG).wait_ready()
    yield daemon
    assert daemon.stop() == 0
    daemon.close()


def test_the_simulator_counts_the_bytes_that_the_master_sees(foreign: Daemon) -> None:
    rows = foreign.slave_rows("slaves")
    assert [(row["state"], row["problems"]) for row in rows] == [("OP", [])] * 4
    assert [(row["output_bytes"], row["input_bytes"]) for row in rows] == SIZES
    lines = run_module("ecatsim", "check", str(RIG)).stdout.splitlines()[2:]
    assert [tuple(map(int, line.split()[2:4])) for line in lines] == SIZES


def test_values_go_through_all_sync_managers_and_back(foreign: Daemon) -> None:
    dice = random.Random(1)
    with foreign.client() as client:
        entries = [s for s in client.signals() if s.output and s.slave >= FOLLOWER]
        assert {s.slave for s in entries} == {1, 2, 3}
        for slave in (1, 2, 3):
            client.claim(slave, lease=30)
        there = [client.signal(s.slave, s.index, s.subindex) for s in entries]
        back = [client.signal(s.slave, s.index - 0x1000, s.subindex) for s in entries]
        for _ in range(TURNS):
            values = [dice.randrange(1 << s.bit_length) for s in entries]
            for entry, value in zip(there, values, strict=True):
                entry.raw = value
            client.commit()

            def same() -> bool:
                client.wait()
                client.sample()
                return [entry.raw for entry in back] == values  # noqa: B023

            wait_for(same, foreign)


def test_both_sync_managers_of_an_oversampling_terminal_get_their_outputs(foreign: Daemon) -> None:
    with foreign.client() as client, Simulator(str(foreign.child_pid("ecatsim"))) as simulator:
        client.claim(OVERSAMPLER, lease=30)
        for index, value in ((0x7000, 0x5A), (0x7010, 0xA5)):
            client.signal(OVERSAMPLER, index, 0x22).raw = value
        client.commit()

        def arrived() -> bool:
            client.wait()
            client.sample()
            memory = [simulator.registers(OVERSAMPLER, at, 7) for at in (0x1000, 0x1200)]
            return [int.from_bytes(m, "little") >> 17 & 0xFF for m in memory] == [0x5A, 0xA5]

        wait_for(arrived, foreign)


def test_a_virtual_sync_manager_is_an_fmmu_to_registers(foreign: Daemon) -> None:
    """Here to the time of the next SYNC1 pulse, which goes on."""
    with Simulator(str(foreign.child_pid("ecatsim"))) as simulator:
        managers = simulator.registers(OVERSAMPLER, 0x0800, 24)
        fmmu = simulator.registers(OVERSAMPLER, 0x0620, 16)
    assert (managers[0:4], managers[6]) == (b"\x00\x10\x07\x00", 1)
    assert (managers[8:12], managers[14]) == (b"\x00\x12\x07\x00", 1)
    assert (managers[16:20], managers[22]) == (bytes(4), 0), "left alone"
    assert (fmmu[4:6], fmmu[8:10], fmmu[11], fmmu[12]) == (b"\x04\x00", b"\x98\x09", 1, 1)
    with foreign.client() as client:
        time = client.signal(OVERSAMPLER, 0x1D09, 0x98)
        seen = set()

        def goes_on() -> bool:
            client.wait()
            client.sample()
            seen.add(time.raw)
            return len(seen) > 5

        wait_for(goes_on, foreign)

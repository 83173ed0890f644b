"""Full CAN buses: nothing is lost, nothing doubled, the order stays, in both directions.

Nodes of the simulator send and check numbered frames in C; a program sends and checks others. A
machine that stands still for longer than the terminal can keep frames would make it lose some, as a
real one does, so the simulated terminals keep many.
"""

import json
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import PATIENCE, Daemon, run_module
from ecatd.base.errors import BusyError
from ecatd.client.can import CanFrame, frame
from ecatd.shm.contract import CanKind, CanState

pytestmark = pytest.mark.bus

RIG = """
name = "can-load"
[[slave]]
device = "EK1100"
[[slave]]
device = "EL6751CAN"
parameters = {{ handshake_cycles = 3, kept = 20000 }}
[[can]]
bit_rate = {rate}
terminals = [1]
[[can.node]]
name = "load"
traffic = [{{ {theirs} }}]
checks = [{{ {ours} }}]
"""
CONFIG = """
[gateway]
listen = []
[[slave]]
position = 1
[slave.can]
bit_rate = {rate}
frames_per_second = {frames}
receive_queue = 32
"""
COUNT = 6000
"""Frames each way."""


class Case:
    """Traffic of a node, and of a program.

    Args:
        rate: Bit rate in kbit/s.
        length: Bytes of data of each frame.
        extended: Identifiers of 29 bits.
        theirs: Frames a second that the node sends; 0: as many as the bus allows.
        ours: Frames a second that the program sends; 0: as many as the bus allows.
        cycle_us: Cycle time.
    """

    def __init__(
        self, rate: int, length: int, extended: bool, theirs: int, ours: int, cycle_us: int
    ) -> None:
        self.rate, self.length, self.extended = rate, length, extended
        self.theirs, self.ours, self.cycle_us = theirs, ours, cycle_us
        base = 0x1000_0000 if extended else 0x100
        # Frames without data are numbered by their identifiers.
        self.span = 1 if length else 0x80
        self.first = (base, base + 0x400)

    def _traffic(self, first: int, rate: int) -> str:
        wide = str(self.extended).lower()
        return (
            f"id = {first}, span = {self.span}, extended = {wide}, length = {self.length}, "
            f"rate = {rate}, count = {COUNT}, delay = 8.0"  # the bus is in OP by then
        )

    @property
    def rig(self) -> str:
        return RIG.format(
            rate=self.rate,
            theirs=self._traffic(self.first[1], self.theirs),
            ours=self._traffic(self.first[0], self.ours),
        )

    def frame(self, number: int) -> CanFrame:
        """The n-th frame of the program."""
        data = number.to_bytes(8, "little")[: self.length]
        return frame(self.first[0] + number % self.span, data, self.extended)

    def number(self, found: CanFrame) -> int:
        """Which frame it is, modulo how many can be told apart."""
        if self.length:
            return int.from_bytes(found.data, "little")
        return (found.identifier - self.first[0]) % 0x400


CASES = {
    "1000 kbit/s, 2000 extended frames a second each way": Case(1000, 8, True, 2000, 2000, 1000),
    "500 kbit/s, full of frames of 8 bytes": Case(500, 8, False, 0, 1000, 1000),
    "500 kbit/s, full of frames without data": Case(500, 0, False, 0, 2000, 500),
}


@pytest.mark.parametrize("name", CASES)
def test_nothing_is_lost_on_a_full_bus(
    start_daemon: Callable[..., Daemon], tmp_path: Path, name: str
) -> None:
    case = CASES[name]
    file = tmp_path / "load.toml"
    file.write_text(case.rig)
    config = f"cycle_time_us = {case.cycle_us}\n" + CONFIG.format(rate=case.rate, frames=1000)
    daemon = start_daemon(str(file), config=config)
    theirs: list[int] = []
    mine: list[int] = []
    numbers: list[int] = []
    with daemon.client() as reader, daemon.client() as writer:
        into, out = reader.can(1), writer.can(1)
        out.claim()
        begin, sent = time.monotonic(), 0
        end = begin + PATIENCE
        while len(theirs) < COUNT or len(mine) < COUNT:
            assert time.monotonic() < end, (len(theirs), len(mine), sent, into.info)
            due = min(COUNT, int((time.monotonic() - begin) * case.ours) if case.ours else COUNT)
            if sent < due:
                try:
                    last = out.send_all([case.frame(n) for n in range(sent, min(due, sent + 64))])
                except BusyError:
                    pass
                else:
                    sent = last
            reader.wait()
            for found in into.read():
                if found.kind == CanKind.RECEIVED:
                    theirs.append(case.number(found))
                elif found.kind == CanKind.SENT:
                    mine.append(case.number(found))
                    numbers.append(found.number)
        info = into.info
    told = range(COUNT) if case.length else [n % case.span for n in range(COUNT)]
    assert theirs == list(told)
    assert mine == list(told)
    assert numbers == list(range(1, COUNT + 1))
    assert info.state == CanState.ACTIVE
    assert (info.missed, info.overflows, info.unsent, info.dropped, info.refused) == (0,) * 5
    result = run_module(
        "ecatsim",
        "ctl",
        "--name",
        str(daemon.child_pid("ecatsim")),
        "can",
        "--json",
        env=daemon.env,
    )
    nodes = json.loads(result.stdout)["buses"][0]["nodes"]
    checks = [check for node in nodes for check in node["checks"]]
    assert checks == [{"received": COUNT, "lost": 0, "doubled": 0, "wrong": 0}]

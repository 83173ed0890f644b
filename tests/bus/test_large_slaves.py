"""Slaves with more process data than a datagram carries: no half of a cycle is ever seen."""

from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon
from ecatd.client import Client
from ecatsim.control import Simulator

pytestmark = pytest.mark.bus

CYCLE_TIME_US = 4000
RIG = Path(__file__).parents[1] / "rigs" / "large.py"
LARGE = (1, 3, 4)
OUTPUTS = {1: 400, 3: 3, 4: 190}
INPUTS = {1: 200, 3: 250, 4: 20}


class Words:
    """The outputs of the large slaves, written together, and their inputs."""

    def __init__(self, client: Client) -> None:
        self.client = client
        signals = {n: [s for s in client.signals(n) if s.output] for n in LARGE}
        assert {n: len(found) for n, found in signals.items()} == OUTPUTS
        self.outputs = [signal for found in signals.values() for signal in found]
        self.inputs = {n: client.group(s for s in client.signals(n) if not s.output) for n in LARGE}
        assert {n: len(group.raw) for n, group in self.inputs.items()} == INPUTS

    def exchange(self, value: int) -> dict[int, tuple[int, ...]]:
        """Writes a value to every word, and returns what the slaves have given."""
        for signal in self.outputs:
            signal.raw = value
        self.client.commit()
        self.client.wait()
        self.client.sample()
        return {n: group.raw for n, group in self.inputs.items()}


def test_r12_words_of_two_cycles_are_never_mixed(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon(str(RIG))
    with (
        daemon.client() as client,
        Simulator(str(daemon.child_pid("ecatsim"))) as simulator,
        client.claim(1, lease=30),
        client.claim(3, lease=30),
        client.claim(4, lease=30),
    ):
        words = Words(client)
        taken = dict.fromkeys(LARGE, 0)
        incomplete = 0
        for value in range(1, 301):
            if value == 50:
                simulator.faults.drop(every=1, count=0, probability=0.1, seed=7)
                simulator.faults.drop(every=1, count=0, probability=0.05, seed=8, way_back=True)
            if value == 250:
                simulator.faults.clear()
            for n, row in words.exchange(value).items():
                *counters, mixed, last = row
                assert len(set(counters)) == 1, (value, n, sorted(set(counters)))
                assert mixed == 0, (value, n)
                assert taken[n] <= last <= value, daemon.log
                taken[n] = last
            incomplete += client.domain(0).wkc != client.domain(0).wkc_expected
        assert all(last > 280 for last in taken.values()), taken
        assert incomplete > 20
    assert daemon.stop() == 0

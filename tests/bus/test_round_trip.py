"""The way of a frame through the slaves and back, as the first slave sees it."""

from pathlib import Path

import pytest
from masters import INTERFACE, run

pytestmark = pytest.mark.bus

FORWARDING = 800  # ns that each simulated slave adds, there and back
WITHOUT_CLOCK = """
from ecatsim import Chip, Rig
from ecatsim.devices.generic import Loopback

class First(Loopback):
    chip = Chip(dc=False)

def rig():
    return Rig("first", [First(), Loopback()])
"""


def master_measures():
    from ecatd.base.timeouts import Timeout
    from ecatd.master.master import Master
    from ecatd.server.start.clock_registers import measure_round_trip

    master = Master([INTERFACE])
    try:
        master.scan(Timeout(60))
        return [measure_round_trip(master) for _ in range(3)]
    finally:
        master.close()


@pytest.mark.parametrize("slaves", [1, 2, 40])
def test_it_grows_with_the_slaves(slaves: int) -> None:
    for found in run(f"line:{slaves}", master_measures):
        assert found == pytest.approx(1000 + (slaves - 1) * FORWARDING, abs=50)


def test_a_first_slave_without_receive_times(tmp_path: Path) -> None:
    rig = tmp_path / "first.py"
    rig.write_text(WITHOUT_CLOCK)
    found = run(rig, master_measures)
    assert found == [None] * 3

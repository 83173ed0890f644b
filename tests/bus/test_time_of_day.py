"""The time of day jumps while a bus runs: all waits go by a clock that only goes on."""

import time
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon
from ecatd.shm.statistics import read
from time_of_day import TimeOfDay

pytestmark = [pytest.mark.bus, pytest.mark.long]

HOUR = 3600
JUMPS = (HOUR, -2 * HOUR, 24 * HOUR, -24 * HOUR)
CHILDREN = ("ecatsim", "ecatd.server", "ecatd.gateway")
LAMPS = 3
GRID_CYCLES = 2


def told_at(daemon: Daemon) -> float:
    """When the daemon has told of the last change of levels of the log, in its own time of day."""
    events = daemon.ctl_json("events")["events"]
    return float([row["time_ns"] for row in events if row["event"] == "log_levels"][-1] * 1e-9)


def test_r21_the_time_of_day_jumps(
    start_daemon: Callable[..., Daemon], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Deadlines stay on their grid, an owner keeps its outputs, and whoever asks is answered."""
    time_of_day = TimeOfDay(tmp_path)
    for name, value in time_of_day.env.items():
        monkeypatch.setenv(name, value)
    daemon = start_daemon("troll")
    processes = [daemon.child_pid(name) for name in CHILDREN]
    with daemon.client() as client:
        client.claim(LAMPS, lease=60)
        lamp = client.signal(LAMPS, 0x7000, 1)
        before = read(daemon.bus)
        for number, seconds in enumerate(JUMPS):
            time_of_day.jump(seconds)
            client.sample()
            lamp.raw = number % 2 == 0
            client.commit()
            daemon.ctl("log-level", "dc", ("debug", "info")[number % 2])
            ahead = told_at(daemon) - time.time()
            assert abs(ahead - time_of_day.ahead) < HOUR / 2, "it has jumped"
            assert daemon.ctl("sdo-read", "0", "0x1018", "1").stdout.startswith("0x0000009A")
            client.wait(100, timeout=60)
        now = read(daemon.bus)
    since = now - before
    # The end of a cycle may be away from its deadline, on a busy machine.
    late = (since.times["wakeup"].max_ns + since.times["cycle"].max_ns) / now.cycle_time_ns
    elapsed = (now.cycle_end_ns - before.cycle_end_ns) / now.cycle_time_ns
    assert abs(elapsed - (now.cycle_number - before.cycle_number)) < GRID_CYCLES + late
    assert since.counters["lapses"] == 0
    assert [daemon.child_pid(name) for name in CHILDREN] == processes
    assert len(daemon.slave_rows("state")) == 8
    assert daemon.stop() == 0

"""Clients that do what they must not: `hostile/hostile.c` tells what, and what must hold.

`ECAT_PAGES=1000000` (`make death`) has so many random pages; without it fewer.
"""

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from test_client_death import build

from conftest import SHM, Daemon, stop_process, wait_for
from ecatd.base.errors import EcatError
from ecatd.client import Outputs
from handle import ESTALE, Handle

pytestmark = [pytest.mark.bus, pytest.mark.long]

CYCLE_TIME_US = 1000
"""These tests wait for many cycles."""

HERE = Path(__file__).parent
PAGES = int(os.environ.get("ECAT_PAGES", "60000"))
CONFIG = """
[gateway]
listen = []
[outputs]
lease_max_ms = 5000
[[outputs.safe]]
slave = 0
entry = "0x7000:01"
value = 50
[[signal]]
slave = 0
entry = "0x7000:01"
minimum = 20
maximum = 100
[[domain]]
name = "hostile"
[[domain]]
name = "other"
slaves = ["3-5"]
"""
GROWTH = 24 << 20
"""Bytes that the bus server may need more than before; what is never freed would be far more."""

LOG = 300_000
"""Bytes that the log may have, however long it lasts: 32 slots, told ever less often."""


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("hostile"), HERE / "hostile" / "hostile.c")


def resident(daemon: Daemon) -> int:
    """Bytes of memory of the bus server."""
    pages = Path(f"/proc/{daemon.child_pid('ecatd.server')}/statm").read_text().split()[1]
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


def attack(
    start_daemon: Callable[..., Daemon], hostile: Path, kind: str, count: int
) -> tuple[Daemon, dict[str, int]]:
    daemon = start_daemon("line:6", config=CONFIG)

    def run(number: int) -> dict[str, int]:
        seed = os.environ.get("ECAT_SEED", "1")
        result = subprocess.run(
            [hostile, daemon.bus, kind, str(number), seed],
            capture_output=True,
            text=True,
            check=False,
        )
        assert result.returncode == 0, result.stderr + daemon.log[-5000:]
        reached: dict[str, int] = json.loads(result.stdout)
        print(kind, reached)
        return reached

    run(count // 5)  # what the server keeps for good, it has now
    before = resident(daemon)
    reached = run(count)
    grown = resident(daemon) - before
    print(f"the bus server has grown by {grown / 1e6:.1f} MB, its log has {len(daemon.log)} bytes")
    assert grown < GROWTH
    # The control side has its wits about it, and has not filled a disk.
    states = daemon.ctl_json("slaves")
    assert len(states["slaves"]) == 6
    assert "Traceback" not in daemon.log
    assert "defect" not in daemon.log
    assert len(daemon.log) < LOG
    return daemon, reached


def test_r29_random_pages(start_daemon: Callable[..., Daemon], hostile: Path) -> None:
    daemon, reached = attack(start_daemon, hostile, "pages", PAGES)
    assert reached["lost_claims"] > 0
    who = rf"'intruder' \(pid {reached['intruder']}\)"
    assert re.search(rf"{SHM}/{daemon.bus}\.out was written over .*{who}", daemon.log)
    told = [line for line in daemon.log.splitlines() if "no client library writes" in line]
    assert any(re.search(r"open for writing in .*'intruder' \(pid", line) for line in told), told
    assert daemon.stop() == 0


def test_r29_lies(start_daemon: Callable[..., Daemon], hostile: Path) -> None:
    daemon, reached = attack(start_daemon, hostile, "lies", PAGES // 4)
    assert reached["refused"] > 0
    assert reached["malformed"] > 0
    assert reached["lost_claims"] == 0
    # One that ends before the bus server looks is not found, so it may be that of the first run.
    out_of_range = (
        r"slot \d+, of 'intruder' \((pid \d+)\), got 0x7000:01 .* out of its declared range"
    )
    said = rf"{out_of_range}.* is open for writing in .*'intruder' \(\1\)"
    wait_for(lambda: re.search(said, daemon.log) is not None, daemon)
    assert daemon.stop() == 0


INTRUDER = """
import sys
from raw_slot import RawSlot
slot = RawSlot(sys.argv[1], int(sys.argv[2]))
slot.commit_nonsense()
sys.stdin.read()
"""


def test_who_writes_into_the_slot_of_another_is_named(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("line:4")
    with daemon.client() as owner, owner.claim(0, lease=30):
        owner.signal(0, 0x7000, 1).raw = 1
        owner.commit()
        owner.wait(5)
        with subprocess.Popen(
            [sys.executable, "-c", INTRUDER, daemon.bus, str(os.getpid())],
            env=daemon.env | {"PYTHONPATH": os.pathsep.join([str(HERE), *sys.path])},
            stdin=subprocess.PIPE,
        ) as intruder:
            wait_for(lambda: "no client library writes" in daemon.log, daemon)
            (told,) = [line for line in daemon.log.splitlines() if "library writes" in line]
            assert re.search(rf"^ecatd: warning: slot 0, of '.*' \(pid {os.getpid()}\),", told)
            for pid in (os.getpid(), intruder.pid):
                assert re.search(
                    rf"is open for writing in .*\(pid {pid}\).*: check what they", told
                )
        owner.sample()
        assert owner.output("0/0x7000:01").owned


def test_random_requests(start_daemon: Callable[..., Daemon], hostile: Path) -> None:
    daemon, reached = attack(start_daemon, hostile, "requests", PAGES)
    assert reached["lost_claims"] == 0
    assert daemon.stop() == 0


def test_who_goes_on_while_the_daemon_stops_is_not_accused(
    start_daemon: Callable[..., Daemon],
) -> None:
    """A program hears of the end only when it is there, and commits until then."""
    daemon = start_daemon("troll")
    with daemon.client() as owner:
        owner.claim(3, lease=30)
        owner.signal(3, 0x7000, 1).raw = 1
        daemon.process.terminate()
        with pytest.raises(EcatError, match="the daemon has ended"):
            while True:
                owner.commit()
    assert daemon.stop() == 0
    assert f"(pid {os.getpid()}) owned them" in daemon.log
    assert "no client library writes" not in daemon.log


def test_who_committed_before_its_release_was_seen_is_not_accused(
    start_daemon: Callable[..., Daemon],
) -> None:
    """Where the daemon stood still, it sees both at once."""
    daemon = start_daemon("troll", config="[gateway]\nlisten = []\n[outputs]\nlease_max_ms = 60000")
    server = daemon.child_pid("ecatd.server")
    with Handle(daemon.bus) as owner, daemon.client() as eye:
        lamp = owner.bind(3, 0x7000, 1, 1)
        assert owner.claim(0, 60.0) == 0
        assert owner.claim(3, 60.0) == 0
        stop_process(server)
        try:
            assert owner.release(0) == ESTALE
            assert owner.write(lamp, 1.0) == 0
            assert owner.commit() == 0
        finally:
            os.kill(server, signal.SIGCONT)
        # What it has committed goes out, nevertheless.
        wait_for(lambda: eye.output("3/0x7000:01").state is Outputs.ACTIVE, daemon)
    assert daemon.stop() == 0
    assert "no client library writes" not in daemon.log

"""A page of the live view with 20 signals at 1 kHz, for as long as `make soak` runs: nothing grows.

The page keeps ten minutes, so its memory grows until then; what counts is what comes after that.
"""

import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from benchmarks.live_view.benchmark import SIGNALS
from benchmarks.live_view.pages import Pages, descendants

from conftest import Daemon

pytest.importorskip("playwright.sync_api", reason="needs the package playwright")

pytestmark = [pytest.mark.bus, pytest.mark.long]

FULL_S = 660
"""Seconds until the memory of the page is full, and a minute more."""
SAMPLE_S = 20
GROWTH_KIB = {"bus server": 6144, "gateway": 6144, "ecatctl web": 6144, "browser": 40_960}


@pytest.fixture
def web(start_daemon: Callable[..., Daemon]) -> Iterator[tuple[Daemon, int, str]]:
    """A daemon, the process ID of its live view, and the address of the page."""
    daemon = start_daemon("troll", "--cycle-time-us", "1000")
    command = [sys.executable, "-m", "ecatd.cli", "web", "--no-browser", "--port", "0"]
    server = subprocess.Popen(command, env=daemon.env, text=True, stdout=subprocess.PIPE)
    try:
        assert server.stdout is not None
        lines = iter(server.stdout.readline, "")
        address = next(found[0] for line in lines if (found := re.search(r"http://\S+", line)))
        yield daemon, server.pid, address
    finally:
        server.terminate()
        server.communicate(timeout=20)


def resident_kib(pid: int) -> int:
    """Memory that a process shares with no other, in KiB: 0 if it has ended."""
    try:
        text = Path(f"/proc/{pid}/smaps_rollup").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return 0
    return sum(int(size) for size in re.findall(r"Private_\w+:\s+(\d+) kB", text))


@pytest.mark.skipif(
    float(os.environ.get("ECAT_SOAK_S", "0")) < 2 * FULL_S, reason="it takes half an hour or more"
)
def test_the_live_view_does_not_grow(web: tuple[Daemon, int, str]) -> None:
    daemon, server, address = web
    end = time.monotonic() + float(os.environ["ECAT_SOAK_S"])
    begin = time.monotonic()
    pages = Pages(address, 1, SIGNALS)
    pages(shown=True)
    sizes: dict[str, list[int]] = {name: [] for name in GROWTH_KIB}
    while time.monotonic() < end:
        pages.wait(SAMPLE_S)
        now = {
            "bus server": resident_kib(daemon.child_pid("ecatd.server")),
            "gateway": resident_kib(daemon.child_pid("ecatd.gateway")),
            "ecatctl web": resident_kib(server),
            "browser": sum(resident_kib(pid) for pid in descendants(os.getpid(), "chrom")),
        }
        print(f"{time.monotonic() - begin:.0f} s: {now}", flush=True)
        if time.monotonic() - begin > FULL_S:
            for name, size in now.items():
                sizes[name].append(size)
    (report,) = pages(shown=False)["reports"]
    assert report["rows"] > 590_000, "ten minutes at 1 kHz are kept"
    for name, found in sizes.items():
        third = len(found) // 3
        early, late = min(found[:third]), min(found[-third:])
        assert late - early <= GROWTH_KIB[name], (name, early, late)

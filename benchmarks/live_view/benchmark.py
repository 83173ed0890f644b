"""Pages of the live view beside the exchange, and what each part of them needs of a core.

Four pages with a scope of 20 signals at 1 kHz are open in turns with none. While none is open, a
busy loop has the core of the browser: pages are compared with a load, not with silence.
"""

from __future__ import annotations

import contextlib
import re
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ecatd.base.errors import StateError

from ..bench import Bench
from ..engine.beside import compare
from ..machine import used
from ..masters.daemon import Daemon
from ..masters.worker import Worker
from ..segment.peers import ecatsim, end, on
from .pages import Pages

SETTINGS: dict[str, dict[str, Any]] = {
    "quick": {"rounds": 1, "seconds": 2.0, "pages": 1, "signals": 2},
    "full": {"rounds": 20, "seconds": 10.0},
}
SIGNALS = [f"{slave}/0x60{channel}0:11" for slave in (4, 5) for channel in range(8)] + [
    "0/0x6064",
    "0/0x606C",
    "0/0x6041",
    "0/0x6077",
]
"""Of the rig `troll`: 16 analog inputs, and four inputs of the drive."""


def measure(
    bench: Bench,
    *,
    rounds: int = 6,
    seconds: float = 5.0,
    pages: int = 4,
    signals: int = len(SIGNALS),
) -> dict[str, Any]:
    """Compares the exchange with pages and with an idle load, in turns.

    Args:
        bench: Folder and processors for the measurement.
        rounds: How often pages are opened and left.
        seconds: How long pages are open, and how long they are not.
        pages: Number of pages.
        signals: Number of signals in the scope of each page.

    Raises:
        StateError: The page was not built, or there is no Chromium.
    """
    chosen = SIGNALS[:signals]
    with (
        bench.awake(),
        ecatsim("troll", bench.processors),
        Daemon(bench) as daemon,
        _server(bench, daemon) as (server, address),
        _browser(bench, daemon, address, pages, chosen) as browser,
        contextlib.closing(_View(bench, daemon, server, browser)) as view,
    ):
        bench.say(f"the exchange beside {pages} pages of the live view")
        found = compare(daemon.bus, view.shown, rounds, seconds)
    return {
        **found,
        **view.summary(),
        "pages": pages,
        "signals": len(chosen),
        "processors": bench.processors.to_json(),
    }


class _View:
    """The pages, and the busy loop that runs while none is open."""

    def __init__(self, bench: Bench, daemon: Daemon, server: int, browser: Worker) -> None:
        self._bench, self._browser = bench, browser
        self._pids = {"gateway": daemon.gateway, "server": server}
        self._shares: dict[str, list[float]] = {"gateway": [], "server": [], "browser": []}
        self._drawing: list[float] = []
        self._frames: list[float] = []
        self._version = ""
        self._idle = self._start()

    def _start(self) -> subprocess.Popen[bytes]:
        """A loop of normal priority, as the browser has it."""
        command = [sys.executable, "-c", "while True: pass"]
        return subprocess.Popen(command, preexec_fn=on(self._bench.processors.rest))

    def close(self) -> None:
        self._idle.kill()
        self._idle.wait()

    @contextlib.contextmanager
    def shown(self, _: float) -> Iterator[dict[str, Any]]:
        """Opens the pages for a while."""
        self.close()
        before = {"browser": self._browser.ask(shown=True)["used"]} | self._used()
        begin = time.monotonic()
        yield {}
        lasted = time.monotonic() - begin
        after = self._used()
        left = self._browser.ask(shown=False)
        for name, seconds in ({"browser": left["used"]} | after).items():
            self._shares[name].append((seconds - before[name]) / lasted)
        self._drawing += left["drawing"]
        self._frames += left["frames"]
        self._version = left["version"]
        self._idle = self._start()

    def _used(self) -> dict[str, float]:
        return {name: used(pid) for name, pid in self._pids.items()}

    def summary(self) -> dict[str, Any]:
        """Medians over the rounds: shares of a core, and what a scope needs for a picture."""
        return {
            "shares": [
                {"part": name, "share": round(statistics.median(found), 3)}
                for name, found in self._shares.items()
            ],
            "drawing_ms": round(statistics.median(self._drawing), 2),
            "frames": round(statistics.median(self._frames), 1),
            "renderer": f"Chromium {self._version} without a GPU",
        }


def _browser(bench: Bench, daemon: Daemon, *arguments: object) -> Worker:
    return Worker(Pages, bench.processors, *arguments, environment=daemon.environment)


@contextlib.contextmanager
def _server(bench: Bench, daemon: Daemon) -> Iterator[tuple[int, str]]:
    """`ecatctl web`: its process ID, and the address that it prints."""
    command = [str(Path(sys.executable).with_name("ecatctl")), "web", "--no-browser"]
    server = subprocess.Popen(
        [*command, "--port", "0", "--bus", daemon.bus],
        env=daemon.environment,
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=on(bench.processors.rest),
    )
    try:
        assert server.stdout is not None
        found = (re.search(r"http://\S+", line) for line in server.stdout)
        address = next((match[0] for match in found if match), "")
        if not address:
            raise StateError("`ecatctl web` does not start")
        yield server.pid, address
    finally:
        end(server, 20)

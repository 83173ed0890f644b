"""The scope of `ecatctl web`: what a picture costs the browser, with 20 signals at 1 kHz.

The server is the real one; its signals are made up, so that no daemon takes the processors. A
browser has no time to itself on a busy machine: so beside the time of each picture, which may
contain pauses, there is the processor time of the thread that draws.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ecatd.base.errors import StateError
from ecatsim.net import netlink

from ..bench import Bench
from ..machine import ROOT
from ..segment.peers import end

SETTINGS = {
    "quick": {"minutes": 0.5, "seconds": 1.0, "spans": (10_000,)},
    "full": {"seconds": 30.0},
}
_SIGNALS = 20
_PATIENCE = 120.0
_WATCH = """() => {
  const ask = self.requestAnimationFrame.bind(self);
  self.times = [];
  self.requestAnimationFrame = (draw) => ask((now) => {
    const begin = performance.now();
    draw(now);
    self.times.push(performance.now() - begin);
  });
}"""
_RENDERER = """() => {
  const context = document.createElement('canvas').getContext('webgl');
  const names = context?.getExtension('WEBGL_debug_renderer_info');
  return names ? context.getParameter(names.UNMASKED_RENDERER_WEBGL) : 'software, without WebGL';
}"""


def missing() -> str:
    """Returns what is needed and not there, or nothing."""
    if shutil.which("chromium") is None:
        return "Chromium: apt-get install chromium"
    if find_spec("playwright") is None or find_spec("websockets") is None:
        return "the packages playwright and websockets"
    return ""


def measure(
    bench: Bench,
    *,
    minutes: float = 10.0,
    seconds: float = 10.0,
    spans: tuple[int, ...] = (1_000, 10_000, 60_000, 600_000),
) -> dict[str, Any]:
    """Runs the whole benchmark and returns its results.

    Args:
        bench: Reports progress.
        minutes: What the page keeps before it is measured.
        seconds: How long each window is measured.
        spans: Windows in ms.
    """
    netlink.set_up("lo")
    with _server(minutes) as address, _page(address) as page:
        bench.say(f"scope: {minutes:g} minutes of {_SIGNALS} signals")
        filled = _fill(page, minutes)
        (worker,) = page.workers
        worker.evaluate(_WATCH)
        cases = []
        for span in spans:
            bench.say(f"scope: a window of {span / 1000:g} s")
            page.get_by_role("combobox", name="Window").first.select_option(str(span))
            page.wait_for_timeout(1500)
            cases.append({"span": span / 1000, **_case(page, worker, seconds)})
        status = _status(page)
        return {
            "signals": _SIGNALS,
            "minutes": minutes,
            "browser": page.context.browser.version,
            "renderer": page.evaluate(_RENDERER),
            "pixels": [round(status["width"]), page.viewport_size["height"]],
            "filled": filled,
            "rows": status["rows"],
            "bytes": status["bytes"],
            "memory": _memory(_drawing_thread()),
            "cases": cases,
        }


@contextmanager
def _server(minutes: float) -> Iterator[str]:
    """Yields the address of the page."""
    command = [sys.executable, "-m", "benchmarks.scope.source", str(minutes)]
    server = subprocess.Popen(
        command, cwd=ROOT, env=dict(os.environ), text=True, stdout=subprocess.PIPE
    )
    try:
        assert server.stdout is not None
        address = server.stdout.readline().strip()
        if not address:
            raise StateError("the server of the page does not start")
        yield address
    finally:
        end(server)


@contextmanager
def _page(address: str) -> Iterator[Any]:
    """The page with all signals in its scope."""
    from playwright.sync_api import sync_playwright

    layout = {
        "format": "ecatd scope layout",
        "version": 1,
        "span": 10_000,
        "signals": [{"name": f"{number}/0x6000:01"} for number in range(_SIGNALS)],
    }
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        page = browser.new_page(viewport={"width": 2200, "height": 900})
        page.set_default_timeout(_PATIENCE * 1000)
        page.goto(address.partition("#")[0])  # without its token there is no bus yet
        page.evaluate(
            "text => localStorage.setItem('ecatd scope benchmark', text)", json.dumps(layout)
        )
        page.goto("about:blank")
        page.goto(address)
        yield page
        browser.close()


def _status(page: Any) -> dict[str, Any]:
    text = page.locator(".scope-status[data-view]").get_attribute("data-view")
    found: dict[str, Any] = json.loads(text)
    return found


def _fill(page: Any, minutes: float) -> float:
    """Waits until the page has the past, and returns the seconds that took."""
    begin = time.monotonic()
    while _status(page)["rows"] < minutes * 60_000 * 0.98:
        if time.monotonic() > begin + _PATIENCE:
            raise StateError(f"the page takes more than {_PATIENCE:g} s for {minutes:g} minutes")
        page.wait_for_timeout(100)
    return time.monotonic() - begin


def _case(page: Any, worker: Any, seconds: float) -> dict[str, Any]:
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable", {"timeDomain": "threadTicks"})
    worker.evaluate("() => { self.times = []; }")
    thread = _drawing_thread()
    begin, drawing, page_script = time.monotonic(), _processor_ms(thread), _script_ms(session)
    page.wait_for_timeout(seconds * 1000)
    times = sorted(worker.evaluate("() => self.times"))
    drawing = _processor_ms(thread) - drawing
    page_script = _script_ms(session) - page_script
    lasted = time.monotonic() - begin
    session.detach()
    if not times:
        raise StateError("the page draws nothing")
    return {
        "frames": len(times) / lasted,
        "least": times[0],
        "median": statistics.median(times),
        "p90": times[len(times) * 9 // 10],
        "thread": drawing / len(times),
        "page": page_script / len(times),
        "share": (drawing + page_script) / lasted / 1000,
    }


def _script_ms(session: Any) -> float:
    """Processor time of JavaScript in the main thread of the page."""
    metrics = session.send("Performance.getMetrics")["metrics"]
    return 1000 * float(next(it["value"] for it in metrics if it["name"] == "ScriptDuration"))


def _drawing_thread() -> Path:
    """The worker of the page: the only one of this network namespace."""
    here = Path("/proc/self/ns/net").stat().st_ino
    for comm in Path("/proc").glob("[0-9]*/task/[0-9]*/comm"):
        try:
            is_worker = comm.read_text().startswith("DedicatedWorker")
            if is_worker and (comm.parents[2] / "ns/net").stat().st_ino == here:
                return comm.parent
        except OSError:
            continue  # it has ended
    raise StateError("the page has no worker")


def _processor_ms(thread: Path) -> float:
    return int((thread / "schedstat").read_text().split()[0]) / 1e6


def _memory(thread: Path) -> int:
    """Bytes of the process of the page."""
    text = (thread.parents[1] / "smaps_rollup").read_text()
    found = re.search(r"^Pss:\s+(\d+)", text, re.MULTILINE)
    assert found is not None
    return int(found[1]) * 1024

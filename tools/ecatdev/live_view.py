"""Takes pictures of the live view, `ecatctl web`, in the Chromium of the system.

    PYTHONPATH=tools .venv/bin/python -m ecatdev.live_view docs/pictures

They are of a simulated bus, at which a program moves an output, so they show what users get.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

_BUS, _RIG = "ecat0", "troll"
_OUTPUT = "3/0x70{}0:01"
_SIGNALS = 2
_INPUTS = "4/0x6000:11", "4/0x6010:11"
_STREAMS = ("stdout", "stderr")
_CALM = ("--cycle-time-us", "8000")
"""A cycle that the machine keeps while it also draws a page."""
_PICTURES = {
    "live-view": ((1280, 800), "light", "tab=slave&slave=3"),
    "live-view-dark": ((1280, 800), "dark", "tab=timing"),
    "live-view-outputs": ((1280, 800), "light", "tab=outputs"),
    "live-view-tablet": ((768, 1024), "light", "tab=slave&slave=0&part=health"),
}
"""By name of the picture: size in pixels, theme, and what is chosen."""
_DRIVER = """
import sys, time
from ecatd.client import Client
names = sys.argv[1:]
with Client() as client, client.claim(names, lease=2):
    signals = [client.signal(name) for name in names]
    cycle = 0
    while True:
        for at, signal in enumerate(signals):
            signal.raw = (cycle // (50 << at)) % 2
        client.commit()
        client.wait()
        client.sample()
        cycle += 1
"""


def main(folder: Path) -> None:
    """Takes all pictures into a folder."""
    from playwright.sync_api import sync_playwright

    programs = Path(sys.executable).parent
    chromium = shutil.which("chromium")
    if chromium is None:
        raise SystemExit("there is no chromium: install it (Debian: apt install chromium)")
    with tempfile.TemporaryDirectory() as runtime:
        env = {"ECATD_RUNTIME_DIR": runtime, "ECATD_BUS": _BUS, "PATH": f"{programs}:/usr/bin:/bin"}
        started = []

        def start(*command: str, stream: str = "stdout") -> Any:
            pipes = {name: subprocess.PIPE if name == stream else None for name in _STREAMS}
            process = subprocess.Popen(
                command, env=env, text=True, stdout=pipes["stdout"], stderr=pipes["stderr"]
            )
            started.append(process)
            return getattr(process, stream)

        try:
            _read_until(
                start("ecatd", "--simulate", _RIG, "--bus", _BUS, *_CALM, stream="stderr"), "in OP"
            )
            names = [_OUTPUT.format(number) for number in range(_SIGNALS)]
            start(sys.executable, "-c", _DRIVER, *names)
            said = start("ecatctl", "web", "--no-browser", "--port", "0")
            address = re.search(r"http\S+", _read_until(said, "http"))
            assert address is not None
            with sync_playwright() as playwright:
                browser = playwright.chromium.launch(
                    executable_path=chromium, args=["--no-sandbox"]
                )
                _take(browser.new_page(), address[0], folder)
                browser.close()
        finally:
            for process in reversed(started):
                process.terminate()
                process.wait()


def _take(page: Any, address: str, folder: Path) -> None:
    page.goto(address)
    for name in (*_INPUTS, *(_OUTPUT.format(number) for number in range(_SIGNALS))):
        page.evaluate(f"location.hash = 'tab=slave&slave={name[0]}'")
        page.locator(f'[data-signal="{name}"] .add').click()
    time.sleep(12)  # the scope shows the last ten seconds
    for name, ((width, height), theme, chosen) in _PICTURES.items():
        page.set_viewport_size({"width": width, "height": height})
        while page.evaluate("document.documentElement.dataset.theme") != theme:
            page.keyboard.press("t")
        page.evaluate(f"location.hash = '{chosen}'")
        page.evaluate("document.activeElement.blur()")
        time.sleep(3)
        page.screenshot(path=folder / f"{name}.png")


def _read_until(stream: Any, word: str) -> str:
    """The first line with the word; what comes after it is read, and dropped."""
    for line in stream:
        if word in line:
            threading.Thread(target=lambda: [None for _ in stream], daemon=True).start()
            return str(line)
    raise SystemExit(f"a program has ended before it said {word!r}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))

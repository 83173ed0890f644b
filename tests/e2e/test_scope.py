"""The scope of `ecatctl web`, in a browser on a live bus: what it draws is what is recorded."""

import csv
import io
import json
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from datetime import datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

import ecatd.web
from conftest import Daemon

sync_api = pytest.importorskip("playwright.sync_api", reason="needs the package playwright")

CHROMIUM = shutil.which("chromium")
PAGE = Path(ecatd.web.__file__).parent / "_page" / "scope.js"
pytestmark = [
    pytest.mark.bus,
    pytest.mark.skipif(CHROMIUM is None, reason="needs chromium"),
    pytest.mark.skipif(not PAGE.exists(), reason="needs the built page: make -C web"),
    pytest.mark.skipif(find_spec("websockets") is None, reason="needs the package websockets"),
]

SIGNAL = "3/0x7000:01"

READ_PIXELS = """([left, width]) => {
  const [curves] = document.querySelectorAll('.scope-screen canvas');
  const copy = document.createElement('canvas');
  copy.width = curves.width; copy.height = curves.height;
  const context = copy.getContext('2d');
  context.drawImage(curves, 0, 0);
  const {data} = context.getImageData(left, 0, width, curves.height);
  const paper = [data[0], data[1], data[2]];
  return Array.from({length: width}, (_, x) => {
    let top = -1, bottom = -1;
    for (let y = 0; y < curves.height; y++) {
      const at = 4 * (y * width + x);
      if (data[at] === paper[0] && data[at + 1] === paper[1] && data[at + 2] === paper[2]) continue;
      if (top < 0) top = y;
      bottom = y;
    }
    return [top, bottom];
  });
}"""


@pytest.fixture
def address(troll: Daemon) -> Iterator[str]:
    """The address of the page, with its token."""
    command = [sys.executable, "-m", "ecatd.cli", "web", "--no-browser", "--port", "0"]
    server = subprocess.Popen(command, env=troll.env, text=True, stdout=subprocess.PIPE)
    try:
        assert server.stdout is not None
        lines = iter(server.stdout.readline, "")
        yield next(found[0] for line in lines if (found := re.search(r"http://\S+", line)))
    finally:
        server.terminate()
        server.communicate(timeout=20)


@pytest.fixture
def page(address: str) -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 800}, accept_downloads=True)
        page.set_default_timeout(15_000)
        wrong: list[str] = []
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.goto(address)
        yield page
        browser.close()
        assert wrong == []


def status(page: Any) -> dict[str, Any]:
    return json.loads(page.locator(".scope-status").get_attribute("data-view"))


def until(condition: Callable[[], Any], seconds: float = 20) -> Any:
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end
        time.sleep(0.05)
    return found


def save(page: Any, kind: str, tmp_path: Path) -> Path:
    page.get_by_label("Format of the file").select_option(kind)
    with page.expect_download() as download:
        page.get_by_role("button", name="of the window").click()
    file = tmp_path / f"window.{kind}"
    download.value.save_as(file)
    return file


def add(page: Any, name: str) -> None:
    box = page.get_by_role("combobox", name="Add a signal")
    box.click()
    box.fill(name)
    box.press("Enter")


def peaks(daemon: Daemon, count: int) -> None:
    """Sets the signal to 1 for single cycles."""
    with daemon.client() as client, client.claim(SIGNAL, lease=1):
        output = client.signal(SIGNAL)
        for value in (0, *(1, 0) * count):
            output.raw = value
            client.commit()
            for _ in range(1 if value else 150):
                client.wait()
                client.sample()


def compare_pixels(page: Any, rows: list[tuple[int, float, float]]) -> int:
    """Compares each column of pixels with the cycles; returns how many columns it compared.

    Args:
        page: The page, whose picture stands still.
        rows: Number, Unix time in ms, and value of each recorded cycle.
    """
    page.wait_for_timeout(400)
    seen = status(page)
    (lane,) = seen["lanes"]
    start, span, width = seen["view"]["start"], seen["view"]["span"], round(seen["width"])
    step = span / width

    def place(value: float) -> float:
        return lane["top"] + (lane["high"] - value) / (lane["high"] - lane["low"]) * lane["height"]

    columns = page.evaluate(READ_PIXELS, [round(seen["left"]), width])
    compared = 0
    for x, (top, bottom) in enumerate(columns):
        begin, end = start + x * step, start + (x + 1) * step
        near = [abs(time_ms - edge) < 0.002 for _, time_ms, _ in rows for edge in (begin, end)]
        inside = [i for i, (_, time_ms, _) in enumerate(rows) if begin <= time_ms < end]
        if any(near) or not inside or inside[0] == 0:
            continue  # a time that was rounded may belong to the next column
        first = inside[0]
        if rows[first - 1][0] == rows[first][0] - 1:
            inside.insert(0, first - 1)  # its value is held at the begin of the column
        places = [place(rows[i][2]) for i in inside]
        assert abs(top - min(places)) <= 1.01, (x, top, bottom, places)
        assert abs(bottom - max(places)) <= 1.01, (x, top, bottom, places)
        compared += 1
    return compared


def test_what_is_drawn_is_what_is_recorded(troll: Daemon, page: Any, tmp_path: Path) -> None:
    from mcap.reader import make_reader

    recorded = tmp_path / "run.csv"
    record = subprocess.Popen(
        [sys.executable, "-m", "ecatd.cli", "record", SIGNAL, "-o", str(recorded), "--for", "600"],
        env=troll.env,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    try:
        added_ms = 1000 * time.time()
        add(page, SIGNAL)
        until(lambda: page.locator(".scope-status").get_attribute("data-view"))
        until(lambda: status(page)["rows"] > 300)
        assert status(page)["first"] < added_ms  # it begins with its last seconds
        peaks(troll, 4)
        page.get_by_role("button", name="Live").click()
        page.wait_for_timeout(300)
        exported = save(page, "csv", tmp_path).read_text()
    finally:
        record.terminate()
        print(record.communicate(timeout=30)[0])
    rows = [
        (int(row["cycle"]), when(row["utc"]), float(next(v for k, v in row.items() if SIGNAL in k)))
        for row in csv.DictReader(io.StringIO(exported))
    ]
    with recorded.open(newline="") as lines:
        theirs = {int(row[1]): float(row[2]) for row in list(csv.reader(lines))[1:]}
    both = [(value, theirs[cycle]) for cycle, _, value in rows if cycle in theirs]
    assert len(both) > 300
    assert all(ours == other for ours, other in both)
    assert {value for _, _, value in rows} == {0, 1}
    assert compare_pixels(page, rows) > 100
    # Every peak stays, also where a column stands for many cycles.
    page.get_by_role("application").focus()
    for _ in range(8):
        page.keyboard.press("-")
    page.wait_for_timeout(400)
    seen = status(page)
    columns = page.evaluate(READ_PIXELS, [round(seen["left"]), round(seen["width"])])
    tops = [top for top, _ in columns if top >= 0]
    assert max(tops) - min(tops) > seen["lanes"][0]["height"] / 2

    page.get_by_role("button", name="Cursors").click()
    until(lambda: len(status(page)["cycles"]) == 2)
    before = page.evaluate("document.querySelector('.scope-delta').textContent")
    assert "Δt" in before
    assert "cycles" in before

    with save(page, "mcap", tmp_path).open("rb") as stream:
        messages = [json.loads(m.data) for _, _, m in make_reader(stream).iter_messages()]
    ours = {cycle: value for cycle, _, value in rows}
    same = [m["values"][SIGNAL] == ours[m["cycle"]] for m in messages if m["cycle"] in ours]
    assert len(same) > 300
    assert all(same)
    assert save(page, "svg", tmp_path).read_text().startswith("<svg ")
    assert save(page, "png", tmp_path).read_bytes().startswith(b"\x89PNG")

    # A trigger shows the cycle that fulfils it, with what came before.
    page.get_by_role("button", name="Cursors").click()
    page.get_by_role("combobox", name="Window").first.select_option("1000")
    page.get_by_role("button", name="Trigger").click()
    trigger = page.get_by_role("group", name="Trigger")
    trigger.get_by_role("spinbutton", name="Level").fill("0.5")
    trigger.get_by_role("spinbutton", name="Level").press("Tab")
    trigger.get_by_role("combobox", name="Mode").select_option("single")
    until(lambda: status(page)["trigger"] == "waits")
    page.wait_for_timeout(700)
    peaks(troll, 1)
    until(lambda: status(page)["trigger"] == "holds")
    page.wait_for_timeout(300)
    seen = status(page)
    columns = page.evaluate(READ_PIXELS, [round(seen["left"]), round(seen["width"])])
    high = min(top for top, _ in columns if top >= 0)
    places = [x for x, (top, _) in enumerate(columns) if top == high]
    assert abs(places[0] / seen["width"] - 0.5) < 0.01
    rows_before = status(page)["rows"]
    until(lambda: status(page)["rows"] > rows_before)  # it goes on recording


def when(text: str) -> float:
    """Unix time in ms of a time in ISO 8601."""
    return datetime.fromisoformat(text).timestamp() * 1000

"""The scope of `ecatctl web`, in a browser on a live bus: what it draws is what is recorded."""

import base64
import csv
import io
import json
import math
import re
import shutil
import subprocess
import sys
import time
from array import array
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

import ecatd.web
from conftest import Daemon
from ecatd.web.batch import Cycles, Extremes

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
ANALOG = "4/0x6000:11"
STATUSWORD = "0/0x6041:00"
TITLE, ANALOG_TITLE = "3/Channel 1/Output", "4/AI Standard Channel 1/Value"
PATIENCE_S = 60.0
AXE = Path(__file__).parents[2] / "web" / "node_modules" / "axe-core" / "axe.min.js"

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


@pytest.fixture(scope="module")
def troll(start_shared: Callable[..., Daemon], tmp_path_factory: pytest.TempPathFactory) -> Daemon:
    """A bus that records incidents."""
    folder = tmp_path_factory.mktemp("incidents")
    recorder = f'[flight_recorder]\nfolder = "{folder}"\nbefore_s = 2\nafter_s = 0.1\n'
    return start_shared("troll", config=f"[gateway]\nlisten = []\n{recorder}")


@contextmanager
def serving(env: dict[str, str], *arguments: str) -> Iterator[str]:
    """Runs `ecatctl web`, and yields the address of the page, with its token."""
    command = [sys.executable, "-m", "ecatd.cli", "web", *arguments, "--no-browser", "--port", "0"]
    server = subprocess.Popen(command, env=env, text=True, stdout=subprocess.PIPE)
    try:
        assert server.stdout is not None
        lines = iter(server.stdout.readline, "")
        yield next(found[0] for line in lines if (found := re.search(r"http://\S+", line)))
    finally:
        server.terminate()
        server.communicate(timeout=20)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@contextmanager
def shown(browser: Any, address: str, **more: Any) -> Iterator[Any]:
    """A page, of which nothing may break."""
    size = {"width": 1280, "height": 800}
    page = browser.new_page(viewport=size, accept_downloads=True, **more)
    page.set_default_timeout(PATIENCE_S * 1000)
    wrong: list[str] = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.goto(address)
    yield page
    page.close()
    assert wrong == []


@pytest.fixture
def page(browser: Any, troll: Daemon) -> Iterator[Any]:
    with serving(troll.env) as address, shown(browser, address) as page:
        yield page


def status(page: Any) -> dict[str, Any]:
    return json.loads(page.locator(".scope-status").get_attribute("data-view"))


def settle(page: Any) -> None:
    """Waits until the picture and its reports have all that was done in the page."""

    def is_drawn() -> bool:
        ordered, view = page.locator(".scope-status").evaluate(
            "it => [Number(it.dataset.ordered), it.dataset.view]"
        )
        return view is not None and json.loads(view)["drawn"] >= ordered

    until(is_drawn)


def until(condition: Callable[[], Any], seconds: float = PATIENCE_S) -> Any:
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end
        time.sleep(0.05)
    return found


def save(page: Any, kind: str, tmp_path: Path) -> Path:
    show_files(page)
    page.get_by_label("Format").select_option(kind)
    with page.expect_download() as download:
        page.get_by_role("button", name="Save the window").click()
    file = tmp_path / f"window.{kind}"
    download.value.save_as(file)
    return file


def show_files(page: Any) -> None:
    button = page.get_by_role("button", name="Save", exact=True)
    if button.get_attribute("aria-pressed") != "true":
        button.click()


def add(page: Any, name: str) -> None:
    box = page.get_by_role("combobox", name="Add a signal")
    box.focus()
    box.fill(name)
    page.locator("#scope-found-0").wait_for()  # the page must know its signals
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
    settle(page)
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


def rows_of(text: str, title: str) -> list[tuple[int, float, float]]:
    """Number, Unix time in ms and value of the cycles of a CSV file."""
    table = list(csv.reader(io.StringIO(text)))
    at = table[0].index(title)
    return [(int(row[1]), when(row[-1]), float(row[at])) for row in table[1:] if row[at] != ""]


def values_of(file: Path) -> dict[int, dict[str, Any]]:
    """The values of each cycle of an MCAP file."""
    from mcap.reader import make_reader

    with file.open("rb") as stream:
        messages = [json.loads(m.data) for _, _, m in make_reader(stream).iter_messages()]
    return {message["cycle"]: message["values"] for message in messages}


def test_what_is_drawn_and_saved_is_what_is_recorded(
    troll: Daemon, browser: Any, page: Any, tmp_path: Path
) -> None:
    files = [tmp_path / "run.csv", tmp_path / "run.mcap"]
    command = [sys.executable, "-m", "ecatd.cli", "record", SIGNAL, ANALOG, "--for", "600", "-o"]
    piped = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    records = [subprocess.Popen([*command, file], env=troll.env, **piped) for file in files]
    try:
        add(page, SIGNAL)
        add(page, ANALOG)
        factor = page.get_by_role("spinbutton", name=re.compile("Factor of EL3008"))
        factor.fill("10")  # of the picture; files do not have it
        factor.press("Tab")
        until(lambda: page.locator(".scope-status").get_attribute("data-view"))
        until(lambda: status(page)["rows"] > 300)
        peaks(troll, 4)
        page.get_by_role("application").focus()
        page.keyboard.press("ArrowLeft")  # it stands still, so that all files have the same
        settle(page)
        exported = save(page, "csv", tmp_path).read_text()
        ours = values_of(save(page, "mcap", tmp_path))
    finally:
        for record in records:
            record.terminate()
        for record in records:
            print(record.communicate(timeout=30)[0])
    theirs_csv = files[0].read_text()
    assert exported.splitlines()[0] == theirs_csv.splitlines()[0]
    for title in (TITLE, f"{ANALOG_TITLE} [V]"):
        theirs = {cycle: value for cycle, _, value in rows_of(theirs_csv, title)}
        both = [(v, theirs[cycle]) for cycle, _, v in rows_of(exported, title) if cycle in theirs]
        assert len(both) > 300
        assert all(value == other for value, other in both)
    recorded = values_of(files[1])
    same = [
        value == recorded[cycle][title]
        for cycle in ours.keys() & recorded.keys()
        for title, value in ours[cycle].items()
        if value is not None  # the second signal came later
    ]
    assert len(same) > 300
    assert all(same)

    rows = rows_of(exported, TITLE)
    assert {value for _, _, value in rows} == {0, 1}
    page.get_by_role("button", name=re.compile("Remove EL3008")).click()
    assert compare_pixels(page, rows) > 100
    # The same in a window of which each column has few cycles, and every peak of one that has all.
    page.get_by_role("application").focus()
    for _ in range(4):
        page.keyboard.press("+")
    assert compare_pixels(page, rows) > 30
    for _ in range(12):
        page.keyboard.press("-")
    settle(page)
    seen = status(page)
    columns = page.evaluate(READ_PIXELS, [round(seen["left"]), round(seen["width"])])
    tops = [top for top, _ in columns if top >= 0]
    assert max(tops) - min(tops) > seen["lanes"][0]["height"] / 2
    picture = save(page, "svg", tmp_path)
    assert ElementTree.parse(picture).getroot().tag.endswith("svg")
    assert save(page, "png", tmp_path).read_bytes().startswith(b"\x89PNG")

    # A file in the same scope, without a daemon, has the same values.
    with serving(troll.env, str(files[1])) as address, shown(browser, address) as other:
        until(lambda: shows_whole_file(other))
        assert status(other)["rows"] == len(recorded)
        assert sorted(name for lane in status(other)["lanes"] for name in lane["names"]) == [
            TITLE,
            ANALOG_TITLE,
        ]
        remove = other.get_by_role("button", name=f"Remove {ANALOG_TITLE}")
        remove.focus()
        remove.press("Enter")
        until(lambda: [lane["names"] for lane in status(other)["lanes"]] == [[TITLE]])
        show_files(other)
        other.get_by_label("Format").select_option("mcap")
        with other.expect_download() as download:
            other.get_by_role("button", name="Save all").click()
        download.value.save_as(tmp_path / "all.mcap")
        check_extremes(other, recorded, tmp_path)
    again = values_of(tmp_path / "all.mcap")
    assert again.keys() == recorded.keys()
    assert all(again[cycle][TITLE] == recorded[cycle][TITLE] for cycle in again)


def check_extremes(page: Any, recorded: dict[int, Any], tmp_path: Path) -> None:
    """What a slow page gets is drawn, and said; cycles that are missing before it are, too."""
    last, end_ms = max(recorded), status(page)["last"]
    numbers = array("d", [last + 101 + i for i in range(5000)])
    times = array("d", [end_ms + 101 + i for i in range(5000)])
    values = array("d", [float(i % 1000 == 500) for i in range(5000)])
    extremes = Extremes([TITLE], generation=1000)
    extremes.add(Cycles(numbers, times, {TITLE: values}, {TITLE: "float64"}, {}, lost=False))
    extremes.lost = True
    missing = status(page)["missing"]
    (worker,) = page.workers
    worker.evaluate(
        """text => {
            const data = Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer;
            self.onmessage({data: {do: "batch", data}});
        }""",
        base64.b64encode(extremes.pack()).decode(),
    )
    until(lambda: status(page)["minmax"])
    warning = page.locator(".scope-warning")
    until(lambda: "No peak is lost" in warning.inner_text())
    until(lambda: status(page)["missing"] == missing + 100)
    until(lambda: f"Missing: {missing + 100} cycles" in warning.inner_text())
    start = end_ms + 100
    worker.evaluate(
        "start => self.onmessage({data: {do: 'window', start, span: 5200}})",
        start,
    )
    until(lambda: abs(status(page)["view"]["start"] - start) < 20)

    def peaks() -> set[int]:
        seen = status(page)
        columns = page.evaluate(READ_PIXELS, [round(seen["left"]), round(seen["width"])])
        (lane,) = seen["lanes"]
        tall = [x for x, (top, bottom) in enumerate(columns) if bottom - top > lane["height"] * 0.6]
        return {round((x + 0.5) / seen["width"] * 5200 / 1000 - 0.5) for x in tall}

    until(lambda: peaks() == {0, 1, 2, 3, 4})
    assert "least value of cycles" in save(page, "csv", tmp_path).read_text()


def shows_whole_file(page: Any) -> bool:
    text = page.locator(".scope-status").get_attribute("data-view")
    if text is None or "The whole file" not in page.locator(".scope-status").inner_text():
        return False
    seen = json.loads(text)
    start, span = seen["view"]["start"], seen["view"]["span"]
    step = span / seen["width"]
    return bool(seen["rows"] and abs(start - seen["first"]) < step and seen["last"] <= start + span)


def test_an_incident_opens_in_the_scope_with_the_signals_that_it_is_about(
    troll: Daemon, browser: Any, tmp_path: Path
) -> None:
    file = tmp_path / "incident.mcap"
    troll.ctl("incident", "record", "the noise of slave 4 (EL3008)")
    troll.ctl("incident", "export", "last", "-o", str(file))
    with serving(troll.env, str(file)) as address, shown(browser, address) as page:
        until(lambda: shows_whole_file(page))
        names = [name for lane in status(page)["lanes"] for name in lane["names"]]
        assert ANALOG in names
        assert {name.split("/")[0] for name in names} == {"4"}
        texts = [it.text for it in ElementTree.parse(save(page, "svg", tmp_path)).iter()]
        assert texts.count("T") == 1  # the trigger's moment
        exported = save(page, "csv", tmp_path).read_text()
        # One more signal changes nothing of what is looked at.
        page.get_by_role("application").focus()
        page.keyboard.press("+")
        settle(page)
        before = status(page)["view"]
        add(page, SIGNAL)
        until(lambda: any(SIGNAL in lane["names"] for lane in status(page)["lanes"]))
        until(lambda: "The whole file" in page.locator(".scope-status").inner_text())
        settle(page)
        assert status(page)["view"]["span"] == pytest.approx(before["span"])
    values = [value for _, _, value in rows_of(exported, f"{ANALOG_TITLE} [V]")]
    assert len(values) > 100
    assert max(values) > min(values)


def test_the_bus_behind_the_page_changes(
    start_daemon: Callable[..., Daemon], browser: Any, tmp_path: Path
) -> None:
    first = start_daemon("troll")
    with serving(first.env) as address, shown(browser, address) as page:
        add(page, ANALOG)
        until(lambda: page.locator(".scope-status").get_attribute("data-view"))
        first.stop()
        way, notice = page.locator(".way"), page.locator(".scope-warning")
        until(lambda: "All values are old" in way.inner_text())
        command = [sys.executable, "-m", "ecatd.service", "--simulate", "line:2"]
        command += ["--bus", first.bus, "--config", str(first.config_file)]
        command += ["--cycle-time-us", "8000"]
        with (tmp_path / "second.log").open("w") as log:
            second = subprocess.Popen(command, env=first.env, stderr=log)
        try:
            until(lambda: way.inner_text() == "live")
            until(lambda: f"This bus has no {ANALOG}" in notice.inner_text())
            until(lambda: "No samples come" not in notice.inner_text())
        finally:
            second.terminate()
            second.wait()


def test_triggers_show_the_cycle_that_fulfils_them(
    troll: Daemon, page: Any, tmp_path: Path
) -> None:
    troll.ctl("incident", "record")  # so that the page knows this kind of event
    add(page, "EL2008/Output")
    page.locator("#scope-found-0", has_text="0x7010:01").wait_for()  # for more of them
    page.keyboard.press("Escape")
    until(lambda: page.locator(".scope-status").get_attribute("data-view"))
    until(lambda: status(page)["rows"] > 300)
    page.get_by_role("combobox", name="Window").first.select_option("1000")
    page.get_by_role("button", name="Trigger").click()
    trigger = page.get_by_role("group", name="Trigger")
    level = trigger.get_by_role("spinbutton", name="Level")
    level.fill("0.5")
    level.press("Tab")
    trigger.get_by_role("slider").fill("0.25")
    trigger.get_by_role("combobox", name="Mode").select_option("single")
    until(lambda: status(page)["trigger"] == "waits")
    armed = status(page)["last"]
    until(lambda: status(page)["last"] > armed + 1000)  # so that the window has what was before
    peaks(troll, 1)
    until(lambda: status(page)["trigger"] == "holds")
    view = status(page)["view"]
    rows = rows_of(save(page, "csv", tmp_path).read_text(), TITLE)
    fired = next(time_ms for _, time_ms, value in rows if value == 1)
    column = view["span"] / status(page)["width"]
    assert abs(fired - view["start"] - 0.25 * view["span"]) <= column + 0.002
    assert {value for _, time_ms, value in rows if time_ms < fired} == {0}
    before = status(page)["rows"]
    until(lambda: status(page)["rows"] > before)  # it goes on recording

    # An event of the bus, of a kind that was there before.
    trigger.get_by_role("combobox", name="Trigger").select_option("event")
    trigger.get_by_role("combobox", name="Event").select_option("incident")
    until(lambda: status(page)["trigger"] == "waits")
    troll.ctl("incident", "record")
    until(lambda: status(page)["trigger"] == "holds")
    # Without any trigger "auto" shows what comes; "normal" keeps the picture.
    trigger.get_by_role("combobox", name="Trigger").select_option("level")
    level.fill("7")
    level.press("Tab")
    trigger.get_by_role("combobox", name="Mode").select_option("normal")
    until(lambda: status(page)["trigger"] == "waits")
    settle(page)
    still, rows = status(page)["view"], status(page)["rows"]
    until(lambda: status(page)["rows"] > rows + 2500)
    assert status(page)["view"]["start"] == still["start"]
    trigger.get_by_role("combobox", name="Mode").select_option("auto")
    until(lambda: status(page)["view"]["live"])


def touch(page: Any, *steps: list[tuple[float, float]]) -> None:
    """Puts fingers at places of the curves, moves them, and takes them away."""
    box = page.locator(".scope-screen").bounding_box()
    session = page.context.new_cdp_session(page)
    for number, step in enumerate(steps):
        points = [
            {"x": box["x"] + x * box["width"], "y": box["y"] + y * box["height"], "id": finger}
            for finger, (x, y) in enumerate(step)
        ]
        kind = "touchMove" if number else "touchStart"
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
        page.wait_for_timeout(60)
    session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    session.detach()
    settle(page)


def open_layout(page: Any, text: str) -> None:
    file = {"name": "layout.json", "mimeType": "application/json", "buffer": text.encode()}
    page.locator(".scope-open input").set_input_files(file)


def test_what_people_do_with_the_scope(troll: Daemon, browser: Any, tmp_path: Path) -> None:
    with (
        serving(troll.env) as address,
        shown(browser, address, has_touch=True, bypass_csp=True) as page,
    ):
        page.locator('[role="treeitem"][data-slave="4"]').click()
        page.get_by_role("tab", name="Now").click()
        page.locator(f'[data-signal="{ANALOG}"] .value-number', has_text="V").wait_for()
        added_ms = 1000 * time.time()
        page.locator(f'[data-signal="{ANALOG}"]').drag_to(page.locator(".scope-screen"))
        notice = page.locator(".scope-warning")
        add(page, STATUSWORD)
        until(lambda: page.locator(".scope-status").get_attribute("data-view"))
        until(lambda: status(page)["rows"] > 2000)
        until(lambda: status(page)["first"] < added_ms)  # although the panel has its values already

        # A bit has a lane, also of what was recorded before.
        page.get_by_label("Show a bit of Gold EtherCAT GCON Drive/Status word").select_option("6")
        lane = until(lambda: next((it for it in status(page)["lanes"] if it["digital"]), None))
        assert lane["title"].endswith("Switch on disabled")
        until(lambda: status(page)["readings"][2][0]["value"] == 1)

        # Fingers move and zoom; it goes on recording meanwhile.
        begin = status(page)["view"]
        assert begin["live"]
        touch(page, [(0.5, 0.5)], [(0.6, 0.5)], [(0.7, 0.5)])
        moved = status(page)["view"]
        assert not moved["live"]
        assert moved["start"] < begin["start"] + 5000
        touch(page, [(0.5, 0.5), (0.6, 0.5)], [(0.4, 0.5), (0.7, 0.5)], [(0.3, 0.5), (0.8, 0.5)])
        zoomed = status(page)["view"]
        assert zoomed["span"] < moved["span"] / 2
        page.get_by_role("combobox", name="Window").first.select_option("1000")
        page.get_by_role("application").focus()
        page.keyboard.press("PageUp")
        settle(page)

        # What is under the pointer is read out.
        box = page.locator(".scope-screen").bounding_box()
        page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 40)
        read_out = page.locator(".scope-read-out")
        read_out.wait_for()
        hover = until(lambda: status(page)["hover"])
        until(lambda: f"cycle {hover['cycle']}" in read_out.inner_text())
        page.mouse.move(2, 2)
        until(lambda: read_out.count() == 0)

        # Cursors move by cycles.
        page.keyboard.press("c")
        first = until(lambda: status(page)["cycles"])
        page.keyboard.press(".")
        page.keyboard.press(".")
        page.keyboard.press("m")
        exported = save(page, "csv", tmp_path).read_text()
        rows = rows_of(exported, f"{ANALOG_TITLE} [V]")
        # Also those in which a signal has no value: cursors go by cycles.
        numbers = [int(line.split(",")[1]) for line in exported.splitlines()[1:]]
        a = numbers[numbers.index(first[0]) + 2]
        b = numbers[numbers.index(first[1]) - 1]
        until(lambda: status(page)["cycles"] == [a, b])
        at_a = status(page)["readings"][0][1]["value"]
        assert at_a == pytest.approx(next((v for cycle, _, v in rows if cycle == a), None))
        delta = page.locator(".scope-delta")
        until(lambda: re.search(r"Δt .* ms .* cycles", delta.inner_text()))
        page.get_by_role("application").focus()
        page.keyboard.press("c")
        until(lambda: status(page)["cycles"] == [])

        # The spectrum is that of the samples.
        page.get_by_role("button", name="Spectrum").click()
        panel = page.get_by_role("group", name="Spectrum")
        panel.get_by_role("cell").first.wait_for()
        greatest = pytest.approx(greatest_amplitude(rows, numbers), rel=1e-3)
        first_row = panel.get_by_role("row").first
        until(lambda: float(first_row.inner_text().split()[-1]) == greatest)
        page.get_by_role("button", name="XY").click()
        page.get_by_role("button", name="Statistics").click()
        statistics = page.get_by_role("region", name="Statistics")
        until(lambda: str(len(rows)) in statistics.inner_text())
        most = pytest.approx(max(v for _, _, v in rows), rel=1e-3)
        until(lambda: most in map(float, re.findall(r"-?\d+\.\d+", statistics.inner_text())))

        # A layout is a file; a wrong one says what is wrong.
        with page.expect_download() as download:
            show_files(page)
            page.get_by_role("button", name="Save layout").click()
        download.value.save_as(tmp_path / "layout.json")
        layout = json.loads((tmp_path / "layout.json").read_text())
        names = [entry["name"] for entry in layout["signals"]]
        assert names == [ANALOG, STATUSWORD, f"{STATUSWORD}.6"]
        open_layout(page, '{"format": "a shopping list"}')
        until(lambda: "no layout" in notice.inner_text())
        until(lambda: page.locator(".scope-legend tbody tr").count() == 3)
        other = {**layout, "signals": [layout["signals"][0], {"name": "77/0x6000:01"}]}
        open_layout(page, json.dumps(other))
        until(lambda: "This bus has no 77/0x6000:01" in notice.inner_text())
        until(lambda: page.locator(".scope-legend tbody tr").count() == 1)
        open_layout(page, json.dumps(layout))
        until(lambda: page.locator(".scope-legend tbody tr").count() == 3)

        page.get_by_role("button", name="Trigger").click()
        if AXE.exists():
            page.add_script_tag(path=str(AXE))
            for theme in ("light", "dark"):
                page.evaluate("theme => { document.documentElement.dataset.theme = theme }", theme)
                page.wait_for_timeout(300)
                found = page.evaluate("axe.run('.scope')")["violations"]
                serious = [it["id"] for it in found if it["impact"] in ("serious", "critical")]
                assert serious == [], theme


def greatest_amplitude(rows: list[tuple[int, float, float]], cycles: list[int]) -> float:
    """The amplitude of the greatest line but the mean, with a Hann window.

    Args:
        rows: The cycles in which there is a value; it is held in others.
        cycles: All cycles of the window.
    """
    numpy = pytest.importorskip("numpy")
    last = cycles[-1]
    count = 2 ** math.floor(math.log2(last - cycles[0] + 1))
    known = dict.fromkeys(range(last - count + 1, last + 1))
    value = rows[0][2]
    by_cycle = {cycle: each for cycle, _, each in rows}
    for cycle in range(cycles[0], last + 1):
        value = by_cycle.get(cycle, value)
        if cycle in known:
            known[cycle] = value
    samples = numpy.array([*known.values()], dtype=float)
    window = numpy.hanning(count + 1)[:-1]
    lines = numpy.abs(numpy.fft.rfft((samples - samples.mean()) * window)) * 2 / window.sum()
    found: float = lines[1:-1].max()
    return found


def when(text: str) -> float:
    """Unix time in ms of a time in ISO 8601."""
    return datetime.fromisoformat(text).timestamp() * 1000

"""The page of `ecatctl web`, in a browser on a live bus with faults: what a user sees."""

import json
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

import ecatd.web
from conftest import Daemon, free_port, wait_for
from ecatsim.control.client import Simulator
from rigs.files import FIRMWARE, PARAMETERS

sync_api = pytest.importorskip("playwright.sync_api", reason="needs the package playwright")
expect = sync_api.expect

CHROMIUM = shutil.which("chromium")
PAGE = Path(ecatd.web.__file__).parent / "_page" / "index.html"
FILES_RIG = Path(__file__).parents[1] / "rigs" / "files.py"
AXE = Path(__file__).parents[2] / "web" / "node_modules" / "axe-core" / "axe.min.js"
pytestmark = [
    pytest.mark.bus,
    pytest.mark.skipif(CHROMIUM is None, reason="needs chromium"),
    pytest.mark.skipif(not PAGE.exists(), reason="needs the built page: make web"),
    pytest.mark.skipif(find_spec("websockets") is None, reason="needs the package websockets"),
]

SLAVES = 8
DRIVE, COUPLER, OUTPUTS, ANALOG, LAST = 0, 1, 3, 4, 7
OUTPUT = f"{OUTPUTS}/0x7000:01"
PATIENCE_MS = 20_000
CONFIG = """
[[slave]]
position = 0
[[slave.startup]]
object = "0x6083:00"
type = "uint32"
value = 777
"""


@pytest.fixture(scope="module")
def daemon(start_shared: Callable[..., Daemon]) -> Daemon:
    return start_shared("troll", config=CONFIG)


class Server:
    """An `ecatctl web`."""

    def __init__(self, daemon: Daemon, allow: str = "sdo,outputs") -> None:
        self._daemon = daemon
        self._allow = allow
        self._port = free_port()
        self.start()

    def start(self) -> None:
        command = [sys.executable, "-m", "ecatd.cli", "web", "--no-browser"]
        command += ["--port", str(self._port), "--allow", self._allow]
        self._process = subprocess.Popen(
            command, env=self._daemon.env, text=True, stdout=subprocess.PIPE
        )
        assert self._process.stdout is not None
        lines = iter(self._process.stdout.readline, "")
        self.address = next(found[0] for line in lines if (found := re.search(r"http\S+", line)))

    def signal(self, number: int) -> None:
        self._process.send_signal(number)

    def stop(self) -> None:
        self._process.terminate()
        self._process.communicate(timeout=20)


@pytest.fixture(scope="module")
def server(daemon: Daemon) -> Iterator[Server]:
    server = Server(daemon)
    yield server
    server.stop()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    expect.set_options(timeout=PATIENCE_MS)
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def opened(browser: Any, server: Server) -> Iterator[Any]:
    """The page; nothing of it may break, nor the rules of what it may load."""
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    wrong: list[str] = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("console", lambda said: said.type == "error" and wrong.append(said.text))
    page.goto(server.address)
    expect(page.get_by_role("treeitem")).to_have_count(SLAVES)
    yield page
    page.close()
    lost = re.compile("WebSocket|401|ERR_CONNECTION_REFUSED")  # as the last test has it
    assert [text for text in wrong if not lost.search(text)] == []


@pytest.fixture
def page(opened: Any) -> Any:
    opened.get_by_role("treeitem").nth(DRIVE).click()
    show(opened, "Now")
    return opened


@pytest.fixture
def simulator(daemon: Daemon) -> Iterator[Simulator]:
    with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        yield simulator


def slave(page: Any, position: int) -> Any:
    return page.locator(f'[role="treeitem"][data-slave="{position}"]')


def show(page: Any, tab: str) -> None:
    page.get_by_role("tab", name=tab).click()


def lamp(page: Any, name: str) -> Any:
    return page.locator(f"#lamp-{name}")


def test_lamps_slaves_and_keys(page: Any) -> None:
    titles = page.locator(".lamp-title").all_text_contents()
    assert len(titles) == 7
    expect(lamp(page, "slaves_in_op")).to_have_class(re.compile("good"))
    expect(lamp(page, "slaves_in_op")).to_contain_text("8 of 8")
    expect(slave(page, ANALOG)).to_have_accessible_name(re.compile(r"4 EL3008, OP"))
    slave(page, DRIVE).focus()
    for _ in range(OUTPUTS):
        page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    expect(page.get_by_role("heading", name="EL2008")).to_be_visible()
    assert f"slave={OUTPUTS}" in page.evaluate("location.hash")
    page.keyboard.press("4")
    expect(page.get_by_role("tabpanel", name="Timing")).to_be_visible()
    page.keyboard.press("?")
    expect(page.get_by_role("dialog", name="Keys")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.get_by_role("dialog", name="Keys")).to_have_count(0)
    page.get_by_label("Find a slave").fill("el1018")
    expect(page.locator(".found")).to_have_text("1 found")
    page.get_by_label("Find a slave").fill("")
    lamp(page, "outputs").click()
    expect(page.get_by_role("tabpanel", name="Outputs")).to_be_visible()
    show(page, "Slave")


FOCUSED = """() => {
    const it = document.activeElement;
    return it === document.body ? 'nothing' : it.matches(':focus-visible') ? 'seen' : 'not seen';
}"""


def press(page: Any, *keys: str) -> None:
    """Presses keys; the focus stays, and is seen."""
    for key in keys:
        page.keyboard.press(key)
        page.wait_for_function(f"() => ({FOCUSED})() === 'seen'", timeout=PATIENCE_MS)


def tab_to(page: Any, target: Any, key: str = "Tab") -> None:
    """Goes there by the key alone."""
    for _ in range(200):
        press(page, key)
        if target.evaluate("it => it === document.activeElement"):
            return
    raise AssertionError(f"{target} is not reached by {key}")


def seen(page: Any) -> dict[str, Any]:
    """What the scope says of its picture, as soon as it has all that was done."""
    line = page.locator(".scope-status")
    page.wait_for_function(
        """() => {
            const {ordered, view} = document.querySelector('.scope-status').dataset;
            return view && JSON.parse(view).drawn >= Number(ordered);
        }""",
        timeout=PATIENCE_MS,
    )
    found: dict[str, Any] = json.loads(line.get_attribute("data-view"))
    return found


def test_all_goes_by_keyboard_alone(browser: Any, server: Server, daemon: Daemon) -> None:
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.goto(server.address)
    expect(page.get_by_role("treeitem")).to_have_count(SLAVES)

    # A slave, and its parts.
    tab_to(page, slave(page, DRIVE))
    press(page, *["ArrowDown"] * (ANALOG + 1), "Enter")
    expect(page.get_by_role("heading", name="EL3008")).to_be_visible()
    expect(page.get_by_role("tabpanel", name="Slave")).to_be_focused()
    press(page, "Tab")
    for part in ("Objects", "Set-up", "Health", "Files", "EEPROM", "Now"):
        press(page, "ArrowRight")
        tab = page.get_by_role("tab", name=part)
        expect(tab).to_be_focused()
        expect(tab).to_have_attribute("aria-selected", "true")
    press(page, "/")
    expect(page.get_by_label("Find a slave")).to_be_focused()
    page.keyboard.type("el2008")
    press(page, "Enter")
    expect(page.get_by_role("heading", name="EL2008")).to_be_visible()
    press(page, "/", "Escape")
    expect(slave(page, OUTPUTS)).to_be_focused()

    # A signal is found, and drawn.
    search = page.get_by_role("combobox", name="Add a signal")
    tab_to(page, search)
    page.keyboard.type("4/0x6000:11")
    expect(page.locator("#scope-found-0")).to_be_visible()
    press(page, "Enter", "Escape", "Escape")
    curves = page.get_by_role("application")
    expect(curves).to_be_focused()
    page.wait_for_function(
        "() => JSON.parse(document.querySelector('.scope-status').dataset.view).rows > 100",
        timeout=PATIENCE_MS,
    )

    # Zoom, and cursors.
    before = seen(page)["view"]["span"]
    press(page, "+")
    assert seen(page)["view"]["span"] < before
    press(page, "ArrowLeft", "Home")
    seen(page)
    press(page, "c")
    row = page.locator(".scope-legend tbody tr")
    expect(row.locator("td")).to_have_count(5)
    cycles = seen(page)["cycles"]
    press(page, ".", ".", "/")
    moved = seen(page)["cycles"]
    # A busy machine may miss cycles.
    assert moved[0] >= cycles[0] + 2
    assert moved[1] >= cycles[1] + 1
    expect(curves).to_be_focused()

    # A trigger.
    tab_to(page, page.get_by_role("button", name="Trigger"), "Shift+Tab")
    press(page, "Enter")
    level = page.get_by_role("spinbutton", name="Level")
    tab_to(page, level)
    press(page, "Control+a")
    page.keyboard.type("0.5")
    press(page, "Tab")
    trigger = page.get_by_role("group", name="Trigger")
    expect(trigger).to_contain_text(re.compile("waits|triggered|holds"))
    tab_to(page, page.get_by_role("button", name="Trigger"), "Shift+Tab")
    press(page, "Enter")
    expect(trigger).to_have_count(0)

    # Outputs are held and released.
    press(page, "3")
    add = page.get_by_label("Add an output")
    tab_to(page, add)
    press(page, "ArrowDown")
    hold = page.get_by_role("button", name="Hold")
    tab_to(page, hold)
    by_hand = page.get_by_role("heading", name="By hand")

    def holds() -> bool:
        if hold.count():  # on a busy machine no renewal may come in time: then press again
            press(page, "Enter")
        return by_hand.inner_text().endswith("\nholding")

    wait_for(holds, daemon)
    tab_to(page, page.get_by_role("button", name="Release all by hand"))
    press(page, "Enter")
    expect(by_hand).to_contain_text("not holding")
    tab_to(page, page.get_by_role("button", name="off the list"), "Shift+Tab")
    press(page, "Enter")
    expect(page.get_by_role("button", name="off the list")).to_have_count(0)

    # The moment of an event.
    press(page, "5")
    event = page.locator("button.event-body").first
    expect(event).to_be_visible()
    tab_to(page, event)
    moment = event.locator("time").evaluate("it => Date.parse(it.dateTime)")
    press(page, "Enter")
    view = seen(page)["view"]
    assert not view["live"]
    assert view["start"] < moment < view["start"] + view["span"]

    # The keys, and a signal that goes.
    press(page, "?")
    expect(page.get_by_role("dialog", name="Keys")).to_be_visible()
    press(page, "Escape")
    expect(page.get_by_role("dialog", name="Keys")).to_have_count(0)
    tab_to(page, page.get_by_role("button", name="Remove EL3008"), "Shift+Tab")
    press(page, "Enter")
    expect(row).to_have_count(0)
    expect(curves).to_be_focused()
    page.close()


def test_values_are_live_and_have_an_owner(page: Any, daemon: Daemon) -> None:
    slave(page, OUTPUTS).click()
    value = page.locator(f'[data-signal="{OUTPUT}"] .value-number')
    expect(value).to_have_text("off")
    show(page, "Outputs")
    row = page.locator("li", has=page.locator(f'[title="{OUTPUT}"]'))
    expect(row).to_contain_text("safe")
    with daemon.client() as client, client.claim(OUTPUT, lease=30):
        client.signal(OUTPUT).raw = 1
        client.commit()
        expect(row.locator(".value-note")).to_contain_text("python")
        expect(row.locator(".value-number")).to_have_text("1")
        expect(page.locator(".outputs tbody tr", has_text="python")).to_contain_text("30000 ms")
        show(page, "Slave")
        expect(value).to_have_text("on")
    expect(value).to_have_text("off")
    show(page, "Outputs")
    expect(row).to_contain_text("released")
    with daemon.client() as client, client.claim(OUTPUT, lease=0.1):  # and then it hangs
        owner = page.locator(".outputs tbody tr", has_text="python")
        expect(owner.locator(".tag")).to_contain_text("silent")
    show(page, "Slave")
    page.locator(f'[data-signal="{OUTPUT}"] .add').click()
    expect(page.get_by_role("region", name="Scope").get_by_text("EL2008")).not_to_have_count(0)


def test_status_bits_of_a_channel_are_folded(page: Any) -> None:
    slave(page, ANALOG).click()
    bit = page.locator(f'[data-signal="{ANALOG}/0x6000:01"]')
    expect(bit).to_be_hidden()
    expect(page.locator(".channel").first).to_have_text("AI Standard Channel 1")
    page.locator("summary", has_text="5 bits of AI Standard Channel 1").click()
    expect(bit).to_contain_text(re.compile("Underrange.*off"))
    name, value = (
        page.locator(f'[data-signal="{ANALOG}/{entry}"] .value-{part}').bounding_box()
        for entry, part in (("0x6000:11", "name"), ("0x6000:11", "number"))
    )
    of_bit = bit.locator(".value-number").bounding_box()
    assert name["x"] + name["width"] <= value["x"]
    assert value["x"] + value["width"] == of_bit["x"] + of_bit["width"]


def test_outputs_are_held_by_hand(page: Any, daemon: Daemon) -> None:
    show(page, "Outputs")
    page.get_by_label("Add an output").select_option(OUTPUT)
    page.locator(".by-hand").get_by_role("switch").click()
    hold, let_go = (
        page.get_by_role("button", name=name, exact=True) for name in ("Hold", "Let go")
    )

    def is_held() -> bool:
        if hold.count():  # on a busy machine no renewal may come in time: then press again
            hold.click()
        claims = daemon.ctl_json("claims")
        owners = claims["owners"]
        found = next(item for item in claims["outputs"] if item["name"] == OUTPUT)
        return found["owner"] >= 0 and owners[found["owner"]]["by_hand"] and found["value"] == 1

    wait_for(is_held, daemon)
    with suppress(sync_api.TimeoutError):  # a busy machine may have let go just now
        let_go.click(timeout=2000)
    row = page.locator("li", has=page.locator(f'.value-name[title="{OUTPUT}"]')).last
    expect(row).to_contain_text("safe")
    expect(row.locator(".value-number")).to_have_text("0")
    page.get_by_role("button", name=re.compile("Take .* off the list")).click()


def test_a_drive_moves_only_while_a_button_is_pressed(page: Any, daemon: Daemon) -> None:
    show(page, "Drive")
    diagram = page.locator(".drive-diagram")
    expect(diagram).to_have_accessible_name(re.compile("Switch on disabled"))
    enable = page.get_by_role("button", name="Enable", exact=True)

    def is_enabled() -> bool:
        if enable.get_attribute("aria-pressed") == "false":
            enable.hover()
            page.mouse.up()
            page.mouse.down()
        page.wait_for_timeout(100)
        return "Operation enabled" in diagram.get_attribute("aria-label")

    wait_for(is_enabled, daemon)
    page.mouse.up()
    expect(diagram).not_to_have_accessible_name(re.compile("Operation enabled"))
    expect(enable).to_have_attribute("aria-pressed", "false")
    page.get_by_role("button", name="Draw these in the scope").click()
    legend = page.get_by_role("region", name="Signals of the scope")
    for quantity in ("Position", "Velocity", "Torque"):
        axis = legend.get_by_label(re.compile(f"Own axis for .*Target {quantity}"))
        expect(axis).to_have_attribute("aria-pressed", "true")
    view = page.locator(".scope-status")

    def lanes() -> list[set[str]]:
        drawn = json.loads(view.get_attribute("data-view") or "{}")
        return [{*lane["names"]} for lane in drawn.get("lanes", ())]

    wait_for(lambda: {"0/0x607A:00", "0/0x6064:00"} in lanes(), daemon)
    show(page, "Slave")


def test_a_drive_in_fault_is_marked(page: Any, daemon: Daemon, simulator: Simulator) -> None:
    def drive(*steps: tuple[int, int]) -> None:
        """Gives each controlword until the statusword has its bits."""
        values = {0x6060: 8, 0x6072: 1000, 0x607A: 100_000}
        with daemon.client() as client, client.claim(DRIVE, lease=2):
            statusword = client.signal(DRIVE, 0x6041)
            for word, wanted in steps:
                while int(statusword.raw) & 0x4F != wanted:
                    for index, value in {**values, 0x6040: word}.items():
                        client.signal(DRIVE, index).raw = value
                    client.commit()
                    client.wait()
                    client.sample()

    window = simulator.get(DRIVE, 0x6065, 0)
    simulator.set(DRIVE, 0x6065, 0, 1)
    drive((0x06, 0x01), (0x07, 0x03), (0x0F, 0x08))
    simulator.set(DRIVE, 0x6065, 0, window)
    expect(slave(page, DRIVE)).to_have_accessible_name(re.compile("FAULT"))
    expect(slave(page, DRIVE)).to_have_class(re.compile("wrong"))
    show(page, "Drive")
    expect(page.locator(".drive .trouble").first).to_contain_text("following error")
    page.get_by_role("button", name="Start-up parameters").click()
    expect(page.get_by_role("tab", name="Set-up")).to_have_attribute("aria-selected", "true")
    show(page, "Events")
    fault = page.locator(".event.error", has_text="following error").first
    fault.get_by_role("button").click()  # the scope, too, goes there
    expect(page.get_by_role("heading", name="Gold EtherCAT GCON Drive")).to_be_visible()
    live = page.get_by_role("button", name="Live", exact=True)
    expect(live).to_have_attribute("aria-pressed", "false")
    live.click()
    drive((0x80, 0x40))
    expect(slave(page, DRIVE)).to_have_class(re.compile("node op"))


def test_objects_are_read_and_written(page: Any, daemon: Daemon) -> None:
    show(page, "Objects")
    page.get_by_label("Search objects").fill("0x1018")
    page.locator(".object", has_text="0x1018").click()
    expect(page.locator(".entry", has_text="0x0000009A")).to_have_count(1)  # the vendor
    page.get_by_label("Search objects").fill("0x6083")
    page.locator(".object", has_text="0x6083").click()
    entry = page.locator(".entry").first
    expect(entry.locator(".value-link")).to_be_visible()
    entry.get_by_role("button", name="write").click()
    entry.get_by_label(re.compile("New value")).fill("4711")
    page.once("dialog", lambda dialog: dialog.accept())
    entry.get_by_role("button", name="Write", exact=True).click()
    expect(entry.locator(".value-link")).to_contain_text("4711")
    assert daemon.ctl_json("sdo-read", str(DRIVE), "0x6083")["value"] == 4711
    show(page, "Set-up")
    parameter = page.locator(".values li", has_text="0x6083:00")
    expect(parameter).to_contain_text(re.compile("777 · 4711 .*differs"))
    expect(parameter).to_contain_text(re.compile(r"\.toml:\d+"))
    show(page, "Events")
    expect(page.locator(".event", has_text="0x6083").first).to_be_visible()
    page.get_by_label("Search events").fill("no such thing")
    expect(page.locator(".event")).to_have_count(0)
    show(page, "Slave")


def test_set_up_health_and_eeprom(page: Any) -> None:
    show(page, "Set-up")
    row = page.locator("tr", has_text="vendor")
    expect(row.locator("td").nth(1)).to_have_text(row.locator("td").first.text_content())
    show(page, "Health")
    expect(page.locator("tr", has_text="master")).to_have_count(1)
    expect(page.get_by_text("keeps no diagnosis history")).to_be_visible()
    show(page, "EEPROM")
    page.get_by_role("button", name="Read it").click()
    expect(page.get_by_role("button", name="Read it again")).to_be_enabled()
    first = page.locator(".dump").text_content().splitlines()[0]
    assert re.match(r"0000( +[0-9a-f]{2}){8}", first)
    with page.expect_download() as download:
        page.get_by_role("button", name="Save", exact=True).last.click()
    assert download.value.path().read_bytes()[:8].hex(" ") in first


def test_files_are_read_and_written(
    browser: Any, start_shared: Callable[..., Daemon], tmp_path: Path
) -> None:
    daemon = start_shared(str(FILES_RIG))
    server = Server(daemon, "foe")
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    asked: list[str] = []
    page.on("dialog", lambda dialog: (asked.append(dialog.message), dialog.accept()))
    page.goto(server.address + "&slave=0&part=files")
    name, password = page.get_by_label("Name in the slave"), page.get_by_label("Password")
    chooser = page.get_by_label("File to write")
    read = page.get_by_role("button", name="Read", exact=True)
    name.fill("parameters.bin")
    with page.expect_download() as download:
        read.click()
    assert download.value.suggested_filename == "parameters.bin"
    assert download.value.path().read_bytes() == PARAMETERS
    expect(page.get_by_role("status").last).to_contain_text("bytes read from parameters.bin")
    name.fill("no such")
    read.click()
    expect(page.get_by_role("alert")).to_contain_text("it has no such file")
    slave(page, 3).click()
    file = tmp_path / FIRMWARE
    file.write_bytes(bytes(40_000))
    name.fill("")
    chooser.set_input_files(file)
    expect(page.get_by_role("alert")).to_contain_text("in BOOT only")
    page.get_by_label("in BOOT").check()
    chooser.set_input_files(file)
    expect(page.get_by_text("the slave is busy")).to_be_visible()
    # It goes on while the panel shows another slave.
    slave(page, 1).click()
    name.fill("secret.txt")
    read.click()
    expect(page.get_by_role("alert")).to_contain_text("password")
    password.fill("0xC0FFEE")
    with page.expect_download() as download:
        read.click()
    assert download.value.path().read_text() == "something"
    slave(page, 3).click()
    page.get_by_role("button", name="Abort").click()
    expect(page.get_by_role("alert")).to_contain_text("it was cancelled by")
    assert [text.split("?")[0] for text in asked] == [
        *2 * [f"Write 40\u202f000 bytes to slave 3 CiA402, as file '{FIRMWARE}'"],
        f"Stop in the middle of '{FIRMWARE}'",
    ]
    wait_for(lambda: slave(page, 3).get_attribute("class").startswith("node op"), daemon)
    page.close()
    server.stop()


def test_timing(page: Any) -> None:
    show(page, "Timing")
    for name in ("Exchange", "Wake-up", "Cycle"):
        expect(page.get_by_role("img", name=re.compile(f"{name}: half within .*s"))).to_be_visible()
    worst = page.locator(".worst", has_text="longest exchange")
    expect(worst).to_contain_text(re.compile(r"exchange [0-9.]+.*\d\d:\d\d:\d\d\.\d{3}"))
    show(page, "5 min")  # the page is not open for as long
    expect(worst).to_be_visible()
    expect(page.locator(".timing")).to_contain_text("since this page was opened")
    expect(page.locator(".timing")).to_contain_text("Scheduling")
    show(page, "Slave")


def test_a_slave_is_lost_and_comes_back(page: Any, simulator: Simulator) -> None:
    slave(page, LAST).click()
    simulator.faults.power_off(LAST)
    expect(lamp(page, "slaves_in_op")).to_have_class(re.compile("bad|warning"))
    expect(page).to_have_title(re.compile("[■▲] .* · "))
    expect(slave(page, LAST)).to_have_class(re.compile("wrong"))
    expect(page.locator(".slave .note.bad")).to_contain_text("Since")
    show(page, "Events")
    expect(page.locator(".event.error, .event.warning").first).to_be_visible()
    show(page, "Slave")
    simulator.faults.power_on(LAST)
    expect(slave(page, LAST)).to_have_class(re.compile("node op"), timeout=60_000)
    expect(page.locator(".slave .al")).to_have_text("OP")


def test_a_bad_cable_is_seen(page: Any, simulator: Simulator) -> None:
    simulator.faults.noise(ANALOG, every=40, count=0)
    try:
        cable = page.locator(".cable.bad, .cable.strained")
        expect(cable).to_have_count(1, timeout=60_000)
        slave(page, ANALOG).click()
        show(page, "Health")
        expect(page.locator(".cable-note.bad, .cable-note.warning")).to_contain_text("slave 4")
        show(page, "Now")
        expect(lamp(page, "link")).to_have_class(re.compile("bad|warning"))
        lamp(page, "link").click()
        expect(page.locator(".cable-note.bad, .cable-note.warning")).to_contain_text("slave 4")
    finally:
        simulator.faults.clear()


@pytest.mark.skipif(not AXE.exists(), reason="needs axe-core: npm ci in web/")
@pytest.mark.parametrize(
    ("scheme", "rules"),
    [
        ("light", {"type": "tag", "values": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa"]}),
        ("dark", {"type": "rule", "values": ["color-contrast"]}),
    ],
)
def test_no_barrier_is_serious(
    browser: Any, opened: Any, scheme: str, rules: dict[str, Any]
) -> None:
    state = opened.context.storage_state()
    context = browser.new_context(bypass_csp=True, color_scheme=scheme, storage_state=state)
    page = context.new_page()
    page.goto(opened.url.split("#")[0] + f"#slave={DRIVE}")
    expect(page.get_by_role("treeitem")).to_have_count(SLAVES)
    page.add_script_tag(path=str(AXE))
    found = []
    page.locator(".add").first.click()  # a curve in the scope
    page.get_by_role("button", name="Statistics").click()
    parts = ("Set-up", "Health", "Files", "Drive", "Outputs", "Timing", "Events")
    for tab in ("Objects", *parts):
        show(page, tab)
        page.wait_for_timeout(300)
        result = page.evaluate("rules => axe.run({runOnly: rules})", rules)
        found += [
            (tab, item["id"], [node["html"][:120] for node in item["nodes"][:3]])
            for item in result["violations"]
            if item["impact"] in ("serious", "critical")
        ]
    context.close()
    assert found == []


def test_a_server_that_hangs_is_a_lost_connection(page: Any, server: Server) -> None:
    server.signal(signal.SIGSTOP)
    expect(page.locator(".way")).to_contain_text("All values are old")
    expect(lamp(page, "slaves_in_op")).to_have_class(re.compile("unknown"))
    server.signal(signal.SIGCONT)
    expect(page.locator(".way")).to_have_text("live")
    expect(lamp(page, "slaves_in_op")).not_to_have_class(re.compile("unknown"))


def test_a_lost_connection_says_so_and_how_to_come_back(page: Any, server: Server) -> None:
    server.stop()
    expect(page.locator(".way")).to_contain_text("All values are old")
    expect(page.locator(".page")).to_have_class(re.compile("stale"))
    server.start()  # it has other cookies
    expect(page.get_by_role("heading", name="This page needs its address")).to_be_visible()
    page.goto(server.address)
    expect(page.get_by_role("treeitem")).to_have_count(SLAVES)
    expect(page.locator(".way")).to_have_text("live")

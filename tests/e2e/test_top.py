"""`ecatctl top` on a live bus: what it shows, its keys, and what it says when something is gone."""

from __future__ import annotations

import asyncio
import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rich.text import Text
from textual.app import App, ComposeResult
from textual.events import Key
from textual.pilot import Pilot
from textual.widgets import Input

from conftest import Daemon, free_port, names, one_line_error
from ecatd.cli.terminal_view.app import Top
from ecatd.cli.terminal_view.by_hand import ByHand
from ecatd.cli.terminal_view.lamp_line import LampLine
from ecatd.cli.terminal_view.lines import Column, Line, Lines
from ecatd.cli.terminal_view.objects import Objects
from ecatd.cli.terminal_view.signals import Signals
from ecatd.cli.terminal_view.sparkline import gather, sparkline
from ecatd.client.remote import Remote
from ecatsim.control import Simulator

SECONDS = 60.0


def test_a_peak_of_one_value_is_drawn() -> None:
    flat = sparkline([(0.0, 0.0)] * 8, 4)
    assert flat == chr(0x2800 + 0x04 + 0x20) * 4
    peak = sparkline([(0.0, 0.0)] * 7 + [(0.0, 9.0)], 4)
    assert peak == chr(0x2800 + 0x40 + 0x80) * 3 + chr(0x2800 + 0x40 + 0x80 + 0x20 + 0x10 + 0x08)
    assert sparkline([], 3) == "   "
    assert sparkline([None, (1.0, 2.0)], 1) == chr(0x2800 + 0x80 + 0x20 + 0x10 + 0x08)
    assert sparkline([(0.0, 0.0), (0.0, 9.0), None, (9.0, 9.0)], 4, braille=False) == "▄█ ▀"
    assert gather([None, (1.0, 2.0), (-1.0, 0.0)]) == (-1.0, 2.0)


class OneList(App[None]):
    """A screen with one list."""

    def compose(self) -> ComposeResult:
        """The list."""
        yield Lines((Column("NAME", 8, 20), Column("VALUE", 6, right=True)), "Nothing")


def test_the_cursor_stays_with_its_line() -> None:
    def lines(*numbers: int) -> list[Line]:
        return [Line(str(n), (Text(f"name {n}"), Text(str(n))), f"all of {n}") for n in numbers]

    async def look() -> None:
        app = OneList()
        async with app.run_test(size=(30, 6)) as pilot:
            found = app.query_one(Lines)
            assert "Nothing" in _shown(app)
            found.fill(lines(*range(100)))
            found.focus()
            await pilot.press("end", "up")
            assert (found.key, found.detail) == ("98", "all of 98")
            await pilot.pause()
            assert "name 98" in _shown(app)
            found.fill(lines(500, *range(100)))
            assert found.key == "98"
            found.fill(lines(1, 2))
            assert found.key == "2"
            await pilot.press("home")
            found.fill(lines(7, 1, 2), newest_first=True)
            assert found.key == "7"
            found.fill(lines(8, 7, 1, 2))
            assert found.key == "7"
            await pilot.click(Lines, offset=(3, 4))
            assert found.key == "2"
            assert [line[-3:] for line in _shown(app).splitlines()[1:3]] == ["  8", "  7"]
            found.fill(())
            assert (found.key, found.detail) == (None, "")
            await pilot.press("down", "pagedown", "enter")

    asyncio.run(look())


@pytest.mark.bus
def test_top_without_a_terminal_says_so(troll: Daemon) -> None:
    found = troll.ctl("top", check=False)
    assert found.returncode == 2
    names(one_line_error(found.stderr, "ecatctl"), "top draws on a terminal")
    assert troll.ctl("top", "--json", check=False).returncode == 2


@pytest.mark.bus
def test_top_without_textual_says_how_to_get_it(troll: Daemon) -> None:
    hidden = "import sys; sys.modules['textual'] = None; from ecatd.commands import ecatctl; "
    master, slave = pty.openpty()
    try:
        command = [sys.executable, "-c", hidden + "sys.exit(ecatctl())", "top"]
        found = subprocess.run(
            command, env=troll.env, stdin=slave, stdout=slave, stderr=slave, check=False
        )
        said = os.read(master, 4096).decode()
    finally:
        os.close(master)
        os.close(slave)
    assert found.returncode == 7
    names(" ".join(said.split()), "pip install 'ecatd[tui]'")


@pytest.mark.bus
@pytest.mark.parametrize("kind", ["", "dumb"])
def test_a_terminal_that_top_cannot_draw_on_is_refused(troll: Daemon, kind: str) -> None:
    status, said = _on_terminal(troll, {"TERM": kind}, lambda _master, _pid: None)
    assert status == 2
    names(" ".join(said.decode().split()), f"TERM is '{kind}'", "TERM=xterm-256color ecatctl top")


@pytest.mark.bus
def test_bytes_that_are_no_text_do_not_end_top(troll: Daemon) -> None:
    def act(master: int, _pid: int) -> None:
        os.write(master, b"\xe4\xff\xc3")
        os.write(master, b"\x80q")

    status, said = _on_terminal(troll, {}, act)
    assert (status, b"Error" in said) == (0, False)
    _is_restored(said)


@pytest.mark.bus
@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGINT, signal.SIGQUIT, signal.SIGTERM])
def test_a_signal_ends_top_and_restores_the_terminal(troll: Daemon, number: int) -> None:
    status, said = _on_terminal(troll, {}, lambda _master, pid: os.kill(pid, number))
    assert status == 128 + number
    _is_restored(said)


@pytest.mark.bus
def test_a_defect_of_top_is_one_line_and_an_exit_status(troll: Daemon) -> None:
    broken = "from ecatd.cli.terminal_view.app import Top; Top.action_help = lambda self: 1 // 0; "
    status, said = _on_terminal(troll, {}, lambda master, _pid: os.write(master, b"?"), broken)
    assert status == 70
    _is_restored(said)
    (line,) = said.decode().rpartition("\x1b[?1006l")[2].split("\r\n")[:-1]
    names(line, "ecatctl: defect in top: ZeroDivisionError")


def _is_restored(said: bytes) -> None:
    for mode in (b"?1049", b"?1000", b"?1003", b"?2004"):  # screen, mouse, pastes
        assert said.rfind(mode + b"l") > said.rfind(mode + b"h") > 0, mode
    assert said.rfind(b"?25h") > said.rfind(b"?25l") > 0  # the cursor


def _on_terminal(
    daemon: Daemon, env: dict[str, str], act: Callable[[int, int], object], before: str = ""
) -> tuple[int, bytes]:
    """Runs top on a terminal; acts as soon as the slaves are there. Returns status and output."""
    code = f"import sys; {before}from ecatd.commands import ecatctl; sys.exit(ecatctl())"
    pid, master = pty.fork()
    if not pid:
        os.environ.update(daemon.env | {"TERM": "xterm-256color"} | env)
        os.execv(sys.executable, [sys.executable, "-c", code, "top"])
    said, has_acted, deadline = b"", False, time.monotonic() + SECONDS
    fcntl.ioctl(master, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    while time.monotonic() < deadline:
        if not select.select([master], [], [], 1.0)[0]:
            continue
        try:
            said += os.read(master, 65536)
        except OSError:  # nobody has the terminal any more
            break
        if not has_acted and b"EL1018" in said:
            has_acted = True
            act(master, pid)
    else:
        os.kill(pid, signal.SIGKILL)
    os.close(master)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), said


@pytest.mark.bus
@pytest.mark.long
def test_top_shows_a_live_bus(
    start_daemon: Callable[..., Daemon], monkeypatch: pytest.MonkeyPatch
) -> None:
    daemon = start_daemon("troll")
    for name in ("ECATD_RUNTIME_DIR", "ECATD_BUS"):
        monkeypatch.setenv(name, daemon.env[name])

    async def look() -> None:
        app = Top(daemon.bus, None, 10.0)
        async with app.run_test(size=(80, 24)) as pilot:
            await _healthy(app, pilot)
            await _signals_and_outputs(app, pilot)
            await _a_slave_without_power(app, pilot, daemon)
            await _no_daemon(app, pilot, daemon)
            await pilot.press("q")

    asyncio.run(look())


@pytest.mark.bus
def test_top_changes_what_the_user_may(
    start_daemon: Callable[..., Daemon], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    audit, endpoint = tmp_path / "audit", f"tcp/127.0.0.1:{free_port()}"
    daemon = start_daemon(
        "troll", config=f'audit_file = "{audit}"\n[gateway]\nlisten = ["{endpoint}"]\n'
    )
    for name in ("ECATD_RUNTIME_DIR", "ECATD_BUS"):
        monkeypatch.setenv(name, daemon.env[name])

    async def look() -> None:
        app = Top(daemon.bus, None, 30.0)
        async with app.run_test(size=(80, 24)) as pilot:
            await _until(pilot, lambda: app.query_one("#slave-lines", Lines).keys)
            await _objects(app, pilot, daemon)
            await _an_output_by_hand(app, pilot, daemon)
        reader = Top(daemon.bus, endpoint, 30.0)
        async with reader.run_test(size=(80, 24)) as pilot:
            await _until(pilot, lambda: reader.query_one("#slave-lines", Lines).keys)
            await _no_right(reader, pilot)

    asyncio.run(look())
    said = audit.read_text()
    names(said, "0x6060:00", "changed from 0 to 8", "output 0x7010:01", "changed to 1")


async def _objects(app: Top, pilot: Pilot[Any], daemon: Daemon) -> None:
    """Reads, writes, and is refused."""
    await pilot.press("down", "enter")
    await _until(pilot, lambda: "slave 1 (EK1100) has no objects" in _shown(app))
    await pilot.press("up", "enter")
    await _until(pilot, lambda: isinstance(app.screen, Objects))
    await _until(pilot, lambda: "78 objects." in _shown(app))
    await pilot.press("slash", *"identity", "enter")
    await _until(pilot, lambda: "5 entries" in _shown(app))
    assert "Device type" not in _shown(app)
    await pilot.press("right")
    await _until(pilot, lambda: "0x0000009A 154" in _shown(app))
    await pilot.press("down", "e")  # the number of entries
    await _until(pilot, lambda: "cannot be written: its access is ro" in _shown(app))
    await pilot.press("escape", "slash", *"0x6060", "enter")
    await _until(pilot, lambda: app.screen.query_one(Lines).key == "0x6060:00")
    await _write(app, pilot, "8")
    await _until(pilot, lambda: "Written. 0x6060:00" in _shown(app))
    assert daemon.ctl("sdo-read", "0", "0x6060").stdout.split() == ["0x08", "8"]
    await _write(app, pilot, "1000")
    await _until(pilot, lambda: "0x6060:00 was not written" in _shown(app))
    names(_shown(app), "1000", "8")
    await _write(app, pilot, "99")  # a mode that there is not
    await _until(pilot, lambda: "sdos SLAVE OBJECT" in " ".join(_shown(app).split()))
    await pilot.press("e", *"3", "enter", "escape")
    await _until(pilot, lambda: "Nothing was written" in _shown(app))
    assert daemon.ctl("sdo-read", "0", "0x6060").stdout.split() == ["0x08", "8"]
    await pilot.press("escape", "escape")


async def _write(app: Top, pilot: Pilot[Any], value: str) -> None:
    await pilot.press("e")
    await _until(pilot, lambda: "Enter goes on" in _shown(app))
    app.screen.query_one("#value", Input).value = value
    await pilot.press("enter")
    await _until(pilot, lambda: f"{value}: press Enter again" in _shown(app))
    await pilot.press("enter")


async def _an_output_by_hand(app: Top, pilot: Pilot[Any], daemon: Daemon) -> None:
    await pilot.press("4")
    await _until(pilot, lambda: "3 Channel 2 / Output" in _shown(app))
    outputs = app.query_one("#output-lines", Lines)

    def held() -> bool:
        return "BY HAND" in _shown(app)

    async def hold() -> None:
        outputs.move_to("3/0x7010:01")
        await _write(app, pilot, "1")
        await _until(pilot, lambda: held() or "sign of life" in _shown(app))

    deadline = time.monotonic() + SECONDS
    while not held():  # on a busy machine it may lapse at once
        assert time.monotonic() < deadline
        await hold()
    await _until(pilot, lambda: "you, by hand" in _shown(app) or not held())
    await pilot.press("x")
    await _until(pilot, lambda: not held())
    await pilot.press("x")
    await _until(pilot, lambda: "You hold no outputs" in _shown(app))
    other = ByHand(lambda: Remote(daemon.bus), lambda _held, _text: None)
    try:
        outputs.move_to("3/0x7000:01")
        while "somebody by hand" not in outputs.detail:
            assert time.monotonic() < deadline + SECONDS, _shown(app)
            other.want({"3/0x7000:01": "1"})  # again: on a busy machine it may lapse at once
            await pilot.pause(0.5)
        await pilot.press("e")
        await _until(pilot, lambda: "never take one" in " ".join(_shown(app).split()))
    finally:
        other.close()


async def _no_right(app: Top, pilot: Pilot[Any]) -> None:
    """Who may only read is told so before a question."""
    await pilot.press("4")
    await _until(pilot, lambda: app.query_one("#output-lines", Lines).keys)
    await pilot.press("end", "e")
    await _until(pilot, lambda: "You may not drive outputs by hand" in _shown(app))
    await pilot.press("1", "home", "enter")
    await _until(pilot, lambda: "78 objects." in _shown(app))
    await pilot.press("slash", *"0x6060", "enter")
    await _until(pilot, lambda: app.screen.query_one(Lines).key == "0x6060:00")
    await pilot.press("e")
    await _until(pilot, lambda: "You may not write objects: this connection" in _shown(app))


async def _until(pilot: Pilot[Any], condition: Callable[[], Any]) -> None:
    deadline = time.monotonic() + SECONDS
    while not condition():
        assert time.monotonic() < deadline, _shown(pilot.app)
        await pilot.pause(0.05)


def _shown(app: Any) -> str:
    """All that is on the screen, as text."""
    lines = app.screen._compositor.render_strips()
    return "\n".join(strip.text for strip in lines)


def _state(app: Top, lamp: str) -> str:
    lamps = {each["id"]: each for each in app.screen_stack[0].query_one(LampLine).lamps}
    return lamps[lamp]["state"] if lamp in lamps else ""


async def _healthy(app: Top, pilot: Pilot[Any]) -> None:
    await _until(pilot, lambda: _state(app, "slaves_in_op") == "good")
    await _until(pilot, lambda: _state(app, "outputs") == "good")
    shown = _shown(app)
    names(shown, "8 slaves", "EL1018", "● OP")
    assert all(len(line) <= 80 for line in shown.splitlines())
    await pilot.press("question_mark")
    await _until(pilot, lambda: "Marks:" in _shown(app))
    await pilot.press("escape")
    await pilot.press("l")
    await _until(pilot, lambda: "Slaves in OP: 8 of 8 slaves in OP" in _shown(app))


async def _signals_and_outputs(app: Top, pilot: Pilot[Any]) -> None:
    await pilot.press("2")
    await _until(pilot, lambda: any("\u2801" <= c <= "\u28ff" for c in _shown(app)))
    for letter in "/status word":  # typed ahead of the screen; none is taken for another key
        app.post_message(Key("slash" if letter == "/" else letter, letter))
    await _until(pilot, lambda: app.query_one("#filter", Input).value == "status word")
    await pilot.press("enter")
    await _until(pilot, lambda: "Torque" not in _shown(app))
    names(_shown(app), "Status word")
    assert app.query_one(Signals).has_focus
    await pilot.press("escape")
    await _until(pilot, lambda: "Torque" in _shown(app))
    await pilot.press("4")
    await _until(pilot, lambda: "Target Position" in _shown(app))
    await pilot.press("6")
    await _until(pilot, lambda: app._bus_name in app.query_one("#bus-lines", Lines).keys)
    await pilot.press("1")


async def _a_slave_without_power(app: Top, pilot: Pilot[Any], daemon: Daemon) -> None:
    with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        simulator.faults.power_off(7)
        await _until(pilot, lambda: _state(app, "number_of_slaves") == "bad")
        await _until(pilot, lambda: _state(app, "slaves_in_op") == "bad")
        await _until(pilot, lambda: "no answer" in _shown(app))
        await pilot.press("v")
        assert app.query_one("#slave-lines", Lines).key == "7"
        await pilot.press("3")
        await _until(pilot, lambda: "7 of 8 slaves" in _shown(app) or "slave 7" in _shown(app))
        simulator.faults.power_on(7)
    await _until(pilot, lambda: _state(app, "slaves_in_op") == "good")


NOT_RUNNING = r"is not running( \(running: [^)]*\))?; start it with"
"""Other daemons of the machine may be named."""


async def _no_daemon(app: Top, pilot: Pilot[Any], daemon: Daemon) -> None:
    daemon.stop()
    await _until(pilot, lambda: "NO CONNECTION, values are of" in _shown(app))
    await _until(pilot, lambda: re.search(NOT_RUNNING, " ".join(_shown(app).split())))
    await _until(pilot, lambda: _state(app, "timing") == "unknown")

"""`ecatctl top` on a live bus: what it shows, its keys, and what it says when something is gone."""

from __future__ import annotations

import asyncio
import os
import pty
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import pytest
from textual.pilot import Pilot
from textual.widgets import DataTable, Input

from conftest import Daemon, names, one_line_error
from ecatd.cli.terminal_view.app import Top
from ecatd.cli.terminal_view.lamp_line import LampLine
from ecatd.cli.terminal_view.signals import Signals
from ecatd.cli.terminal_view.sparkline import gather, sparkline
from ecatsim.control import Simulator

SECONDS = 60.0


def test_a_peak_of_one_value_is_drawn() -> None:
    flat = sparkline([(0.0, 0.0)] * 8, 4)
    assert flat == chr(0x2800 + 0x04 + 0x20) * 4
    peak = sparkline([(0.0, 0.0)] * 7 + [(0.0, 9.0)], 4)
    assert peak == chr(0x2800 + 0x40 + 0x80) * 3 + chr(0x2800 + 0x40 + 0x80 + 0x20 + 0x10 + 0x08)
    assert sparkline([], 3) == "   "
    assert sparkline([None, (1.0, 2.0)], 1) == chr(0x2800 + 0x80 + 0x20 + 0x10 + 0x08)
    assert gather([None, (1.0, 2.0), (-1.0, 0.0)]) == (-1.0, 2.0)


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
        assert app.failure is None

    asyncio.run(look())


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
    await pilot.press("slash")
    app.query_one("#filter", Input).value = "status word"
    await pilot.press("enter")
    await _until(pilot, lambda: "Torque" not in _shown(app))
    names(_shown(app), "Status word")
    assert app.query_one(Signals).has_focus
    await pilot.press("escape")
    await _until(pilot, lambda: "Torque" in _shown(app))
    await pilot.press("4")
    await _until(pilot, lambda: "Target Position" in _shown(app))
    await pilot.press("5")
    await _until(pilot, lambda: app.query_one("#bus-table", DataTable).row_count == 1)
    await pilot.press("1")


async def _a_slave_without_power(app: Top, pilot: Pilot[Any], daemon: Daemon) -> None:
    with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        simulator.faults.power_off(7)
        await _until(pilot, lambda: _state(app, "number_of_slaves") == "bad")
        await _until(pilot, lambda: _state(app, "slaves_in_op") == "bad")
        await _until(pilot, lambda: "no answer" in _shown(app))
        await pilot.press("v")
        assert app.query_one("#slave-table", DataTable).cursor_row == 7
        await pilot.press("3")
        await _until(pilot, lambda: "7 of 8 slaves" in _shown(app) or "slave 7" in _shown(app))
        simulator.faults.power_on(7)
    await _until(pilot, lambda: _state(app, "slaves_in_op") == "good")


async def _no_daemon(app: Top, pilot: Pilot[Any], daemon: Daemon) -> None:
    daemon.stop()
    await _until(pilot, lambda: "NO CONNECTION" in _shown(app))
    await _until(pilot, lambda: _state(app, "timing") == "unknown")

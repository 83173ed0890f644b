"""Draws screens of commands, and the topology of a bus, as they look in a terminal.

    PYTHONPATH=tools .venv/bin/python -m ecatdev.screens docs/pictures

They are those of a real run on the simulated bus of the README, so they show what users get.
"""

from __future__ import annotations

import asyncio
import io
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from rich.console import Console
from rich.text import Text

from ecatd.cli.terminal_view.app import Top
from ecatsim.control import Simulator

_RIG, _BUS = "troll", "screens"
_SCREENS = {
    "screen-slaves": ("ecatctl slaves", "ecatctl graph", "ecatctl check"),
}
"""What a picture shows, by its name."""
_VIEWS = {
    "screen-top": ("1",),
    "screen-top-signals": ("2", "/", *"value", "enter"),
    "screen-top-objects": ("1", "enter", *("down",) * 5, "enter"),
}
"""Keys that bring `ecatctl top` to what a picture shows."""
_SIZE = (112, 24)
_WITHOUT_POWER = 5
_DRIFTS = 4, "0x6000:11", 40.0
"""An input that does not stand still, so that a picture shows the course of a signal."""
_WIDTH = 112
_PROMPT = "$ "


def main(folder: Path) -> None:
    """Draws all pictures into a folder."""
    programs = Path(sys.executable).parent
    with tempfile.TemporaryDirectory() as runtime:
        env = {"ECATD_RUNTIME_DIR": runtime, "ECATD_BUS": _BUS, "PATH": f"{programs}:/usr/bin:/bin"}
        daemon = subprocess.Popen(
            ["ecatd", "--simulate", _RIG, "--bus", _BUS],
            env=env,
            stderr=subprocess.PIPE,
            text=True,
            bufsize=1,
        )
        try:
            _wait_for_op(daemon)
            for name, commands in _SCREENS.items():
                _draw(folder / f"{name}.svg", commands, env)
            command = ["ecatctl", "graph", "-o", str(folder / "screen-topology.svg")]
            subprocess.run(command, env=env, check=True)
            os.environ.update(env)
            for name, keys in _VIEWS.items():
                asyncio.run(_draw_top(folder / f"{name}.svg", keys, daemon.pid))
        finally:
            daemon.terminate()
            daemon.wait()


def _wait_for_op(daemon: subprocess.Popen[str]) -> None:
    assert daemon.stderr is not None
    said = []
    for line in daemon.stderr:
        said.append(line)
        if "is in OP" in line:
            return
    raise SystemExit(f"the simulated bus did not start: {''.join(said)}")


def _draw(file: Path, commands: tuple[str, ...], env: dict[str, str]) -> None:
    console = Console(record=True, width=_WIDTH, file=io.StringIO())
    for command in commands:
        said = subprocess.check_output(["sh", "-c", command], env=env, text=True)
        console.print(Text(_PROMPT + command, style="bold"))
        console.print(Text(said))
    _save(file, console.export_svg(title="ecatctl"))


async def _draw_top(file: Path, keys: tuple[str, ...], daemon: int) -> None:
    """Draws `ecatctl top`: its signals, or slaves of which one has no power."""
    children = Path(f"/proc/{daemon}/task/{daemon}/children").read_text().split()
    simulator = next(
        pid for pid in children if "ecatsim" in Path(f"/proc/{pid}/cmdline").read_text()
    )
    app = Top(_BUS, None, 10.0)
    with Simulator(simulator) as segment:
        segment.faults.drift(*_DRIFTS)
        async with app.run_test(size=_SIZE) as pilot:
            for key in keys:
                await pilot.press(key)
                await pilot.pause(2 if key == "enter" else 0.1)  # so that objects are there
            await pilot.pause(10)  # so that the signals have a course
            if keys == ("1",):  # values of slaves that take no part are not shown
                segment.faults.power_off(_WITHOUT_POWER)
                await pilot.pause(3)
            _save(file, app.export_screenshot(title="ecatctl top"))
            segment.faults.power_on(_WITHOUT_POWER)


def _save(file: Path, picture: str) -> None:
    """Writes a picture without its fonts, which are from the web."""
    file.write_text(re.sub(r"\s*@font-face \{.*?\}", "", picture, flags=re.DOTALL))


if __name__ == "__main__":
    main(Path(sys.argv[1]))

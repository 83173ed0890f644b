"""Draws screens of commands, and the topology of a bus, as they look in a terminal.

    PYTHONPATH=tools .venv/bin/python -m ecatdev.screens docs/pictures

They are those of a real run on the simulated bus of the README, so they show what users get.
"""

from __future__ import annotations

import io
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from rich.console import Console
from rich.text import Text

_RIG, _BUS = "troll", "screens"
_SCREENS = {
    "screen-slaves": ("ecatctl slaves", "ecatctl graph", "ecatctl check"),
}
"""What a picture shows, by its name."""
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
            command = ["ecatctl", "graph", "-o", str(folder / "topology.svg")]
            subprocess.run(command, env=env, check=True)
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
    picture = console.export_svg(title="ecatctl")
    file.write_text(re.sub(r"\s*@font-face \{.*?\}", "", picture, flags=re.DOTALL))  # from the web


if __name__ == "__main__":
    main(Path(sys.argv[1]))

"""The program of docs/zenoh.md runs as it stands."""

import os
import re
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

PAGE = (Path(__file__).parents[2] / "docs" / "zenoh.md").read_text()


def test_the_python_program(start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    daemon = start_daemon("troll", config=f'[gateway]\nlisten = ["tcp/127.0.0.1:{port}"]\n')
    (program,) = re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    file = tmp_path / "program.py"
    file.write_text(program)
    command = [sys.executable, str(file), f"tcp/127.0.0.1:{port}"]
    result = subprocess.run(command, capture_output=True, text=True, env={**os.environ}, check=True)
    first, second, *values = result.stdout.splitlines()
    assert first == f"buses: {daemon.bus}"
    assert second.endswith("9a 00 00 00")
    assert len(values) == 3
    assert all(line.startswith("/ro/") for line in values)

"""The programs of docs/zenoh.md run as they stand."""

import os
import re
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "zenoh.md").read_text()
SOURCE = ROOT / "examples" / "zenoh" / "over_zenoh.c"


@pytest.fixture
def listening(start_daemon: Callable[..., Daemon]) -> tuple[Daemon, int]:
    """A daemon, and the port at which it answers."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    return start_daemon("troll", config=f'[gateway]\nlisten = ["tcp/127.0.0.1:{port}"]\n'), port


def test_the_python_program(listening: tuple[Daemon, int], tmp_path: Path) -> None:
    daemon, port = listening
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


NEEDED = ("zenohpico", "msgpack")


@pytest.mark.skipif(
    shutil.which("pkg-config") is None
    or subprocess.run(["pkg-config", "--exists", *NEEDED], check=False).returncode != 0,
    reason="zenoh-pico and msgpack-c are not installed",
)
def test_the_c_program(listening: tuple[Daemon, int], tmp_path: Path) -> None:
    daemon, port = listening
    flags = subprocess.run(
        ["pkg-config", "--cflags", "--libs", *NEEDED], capture_output=True, text=True, check=True
    ).stdout.split()
    program = tmp_path / "over_zenoh"
    warnings = ("-Wall", "-Wextra", "-Werror", "-std=gnu11", "-DZENOH_LINUX")
    subprocess.run(["cc", *warnings, SOURCE, "-o", program, *flags], check=True)
    command = [program, f"tcp/127.0.0.1:{port}"]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    first, *lines = result.stdout.splitlines()
    assert first == f"bus ecat/v1/{daemon.bus}"
    assert lines[0].endswith("/ro/sdo/0/0x1018/1")
    assert lines[1].startswith("  data: ")
    assert sum("/ro/" in line for line in lines) == 4

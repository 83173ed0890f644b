"""The programs of docs/zenoh.md run as they stand."""

import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon, free_port, names, run_module

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "zenoh.md").read_text()
SOURCE = ROOT / "examples" / "zenoh" / "over_zenoh.c"
READING, ASKING, CHANGING = re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
WITH_USERS = """\
[gateway]
listen = ["tls/127.0.0.1:{port}"]
certificate = "{folder}/daemon.pem"
key = "{folder}/daemon.key"
users_ca = "{folder}/authority.pem"
[[gateway.user]]
name = "anna"
write = ["sdo"]
slaves = [0]
"""


def run(program: str, folder: Path, *arguments: str) -> str:
    """Runs a program of the page; what it prints."""
    file = folder / "program.py"
    file.write_text(program)
    command = [sys.executable, str(file), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


@pytest.fixture
def listening(start_daemon: Callable[..., Daemon]) -> tuple[Daemon, int]:
    """A daemon, and the port at which it answers."""
    port = free_port()
    return start_daemon("troll", config=f'[gateway]\nlisten = ["tcp/127.0.0.1:{port}"]\n'), port


def test_the_python_program(listening: tuple[Daemon, int], tmp_path: Path) -> None:
    daemon, port = listening
    first, second, *values = run(READING, tmp_path, f"tcp/127.0.0.1:{port}").splitlines()
    assert first == f"buses: {daemon.bus}"
    assert second.endswith("9a 00 00 00")
    assert len(values) == 3
    assert all(line.startswith("/ro/") for line in values)


def test_the_program_that_asks_operations(
    listening: tuple[Daemon, int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    daemon, _ = listening
    for name in ("ECATD_RUNTIME_DIR", "XDG_RUNTIME_DIR"):
        if name in daemon.env:
            monkeypatch.setenv(name, daemon.env[name])
    state, status = run(ASKING.replace("ecat0", daemon.bus), tmp_path).splitlines()
    assert (state, status) == ("OP", "0800")


@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl makes the certificates")
def test_the_python_program_of_a_user(start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    folder, identity = tmp_path / "tls", str(tmp_path / "anna.pem")
    for command in (("init", "--host", "cell4.example.org"), ("user", "anna", "-o", identity)):
        made = run_module("ecatd.cli", "remote", *command, "--dir", str(folder))
        assert made.returncode == 0, made.stderr
    port = free_port()
    daemon = start_daemon("troll", config=WITH_USERS.format(port=port, folder=folder))
    arguments = (f"tls/127.0.0.1:{port}", identity, "anna")
    assert run(CHANGING, tmp_path, *arguments) == "written: Mode of operation 09\n"
    names(daemon.log, "0x6060:00", "user 'anna' [the program of this page]")
    refused = run(CHANGING.replace("/sdo/0/", "/sdo/4/"), tmp_path, *arguments)
    names(refused, "user 'anna'", "slaves 0", daemon.bus)


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

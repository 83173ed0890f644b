"""`ecatctl drive`: an axis from the command line."""

import json
import os
import pty
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable

import pytest
from test_drives_python import RIG, configuration

from conftest import PATIENCE, Daemon, names

pytestmark = pytest.mark.bus

COMMAND = [sys.executable, "-m", "ecatd.cli", "drive"]


@pytest.fixture(scope="module")
def daemon(start_shared: Callable[..., Daemon], tmp_path_factory: pytest.TempPathFactory) -> Daemon:
    file = tmp_path_factory.mktemp("axes") / "two.py"
    file.write_text(RIG)
    return start_shared(str(file), config=configuration())


def status(daemon: Daemon, axis: str = "x") -> dict[str, object]:
    found: dict[str, object] = json.loads(daemon.ctl("drive", axis, "status", "--json").stdout)
    return found


def test_it_homes_and_moves(daemon: Daemon) -> None:
    shown = daemon.ctl("drive", "x", "home", "--method", "37", "--yes").stdout
    names(shown, "axis x", "operation enabled", "rad")
    daemon.ctl("drive", "x", "move", "0.5", "--speed", "5", "--yes")
    assert status(daemon)["position"] == pytest.approx(0.5, abs=0.05)
    result = daemon.ctl("drive", "x", "move", "0.25", "--by", "--yes", "--json")
    assert json.loads(result.stdout)["position"] == pytest.approx(0.75, abs=0.05)
    assert status(daemon, "0")["enabled"] is False


@pytest.mark.parametrize(
    ("arguments", "words", "code"),
    [
        (["x", "move", "1"], ["axis x", "1.0 rad", "--yes"], 2),
        (["x", "move", "--yes"], ["POSITION"], 2),
        (["x", "home", "1", "--yes"], ["POSITION"], 2),
        (["z", "status"], ["'z'"], 7),
        (["x", "home", "--method", "-77", "--yes"], ["axis x", "-77", "0x60E3"], 7),
        (["x", "jog", "--yes"], ["terminal"], 2),
        (["x", "move", "1", "--speed", "-1", "--yes"], ["speed", "-1"], 2),
    ],
)
def test_what_cannot_be_is_explained(
    daemon: Daemon, arguments: list[str], words: list[str], code: int
) -> None:
    result = daemon.ctl("drive", *arguments, check=False)
    assert result.returncode == code, result
    names(result.stderr, *words)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_an_axis_is_off_when_the_command_has_ended(daemon: Daemon, number: int) -> None:
    process = subprocess.Popen(
        [*COMMAND, "x", "enable", "--yes"], env=daemon.env, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    names(process.stdout.readline(), "axis x", "operation enabled")
    assert status(daemon)["enabled"] is False, "it is that of this command"
    process.send_signal(number)
    process.wait(PATIENCE)
    process.stdout.close()
    with daemon.client() as bus:
        word = bus.signal("x/0x6041:00")
        while int(word.raw) & 0x6F == 0x27:
            bus.wait(timeout=PATIENCE)
            bus.sample()


def test_jog_moves_by_a_step_for_each_key(daemon: Daemon) -> None:
    before = float(str(status(daemon)["position"]))
    pid, terminal = pty.fork()
    if pid == 0:
        command = [*COMMAND, "x", "jog", "--step", "0.2", "--speed", "5", "--yes"]
        os.execve(command[0], command, daemon.env)
    shown = ""
    deadline = time.monotonic() + PATIENCE

    def read_until(condition: Callable[[], bool]) -> None:
        nonlocal shown
        while not condition():
            assert time.monotonic() < deadline, shown
            if select.select([terminal], [], [], 1)[0]:
                shown += os.read(terminal, 4096).decode(errors="replace")

    def position() -> float:
        return float(shown.rpartition("x:")[2].split()[0])

    read_until(lambda: shown.count("x:") > 2)
    goal = before

    def is_there() -> bool:
        return shown.count("x:") > 1 and abs(position() - goal) < 0.05

    for key, steps in ((b"\033[C", 1), (b"+", 2), (b"\033[D", 1)):
        os.write(terminal, key)
        goal = before + 0.2 * steps
        shown = ""
        read_until(is_there)
    os.write(terminal, b"q")
    _, code = os.waitpid(pid, 0)
    os.close(terminal)
    assert code == 0

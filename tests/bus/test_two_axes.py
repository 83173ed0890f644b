"""The examples of two axes: each client homes, moves and stops them, with the same movement."""

import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon

pytestmark = pytest.mark.bus

EXAMPLES = Path(__file__).parents[2] / "examples" / "two-axes"
CYCLE_TIME_US = 1000


@pytest.fixture(scope="module")
def daemon(start_shared: Callable[..., Daemon]) -> Daemon:
    return start_shared("two-axes", config=(EXAMPLES / "two-axes.toml").read_text())


def compiled(source: str, folder: Path, compiler: list[str]) -> list[str]:
    said = subprocess.run(
        [sys.executable, "-m", "ecatd.cli", "client-flags"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    flags = shlex.split(said)  # as a shell does
    program = folder / "two_axes"
    subprocess.run(
        [*compiler, "-Wall", "-Wextra", "-Werror", "-o", program, EXAMPLES / source, *flags],
        check=True,
    )
    return [str(program)]


CLIENTS: dict[str, Callable[[Path], list[str]]] = {
    "C": lambda folder: compiled("two_axes.c", folder, ["cc"]),
    "C++": lambda folder: compiled("two_axes.cpp", folder, ["c++", "-std=c++17"]),
    "Python": lambda _: [sys.executable, str(EXAMPLES / "two_axes.py")],
}


def fmu(daemon: Daemon, folder: Path) -> list[str]:
    daemon.ctl("generate", "Plant", str(folder), "--fmu")
    return [sys.executable, str(EXAMPLES / "two_axes_fmu.py"), str(folder / "Plant.fmu")]


@pytest.mark.parametrize("client", [*CLIENTS, "FMU"])
def test_two_axes_home_move_and_stop(daemon: Daemon, tmp_path: Path, client: str) -> None:
    made = fmu(daemon, tmp_path) if client == "FMU" else CLIENTS[client](tmp_path)
    command = [*made, daemon.bus]
    done = subprocess.run(command, env=daemon.env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    rows = [tuple(map(float, line.split(","))) for line in done.stdout.splitlines()]
    assert max(x for _, x, _ in rows) == pytest.approx(0.05, abs=0.001)
    assert max(y for _, _, y in rows) == pytest.approx(2.0, abs=0.03)
    assert rows[-1][1:] == (pytest.approx(0, abs=0.001), pytest.approx(0, abs=0.03))
    # Both move in step: x has gone a part of its way when y has.
    between = [(x / 0.05, y / 2.0) for _, x, y in rows if 0.01 < x < 0.04]
    assert between
    assert all(x == pytest.approx(y, abs=0.05) for x, y in between)
    with daemon.client() as bus:
        for axis in ("x", "y"):
            word = bus.signal(f"{axis}/0x6041:00")
            bus.sample()
            assert int(word.raw) & 0x6F != 0x27, "it is stopped"

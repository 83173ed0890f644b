"""The examples of two axes: each client homes, moves and stops them, with the same movement."""

import shlex
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from threading import Timer

import pytest

from conftest import Daemon, names, wait_for
from ecatd.base.errors import NoAnswerError, UsageError
from ecatd.client.axis_status import Homing
from ecatd.client.drives import DriveError

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


@pytest.mark.parametrize("ends", [NoAnswerError, KeyboardInterrupt])
def test_homing_that_is_given_up_holds_the_axis(daemon: Daemon, ends: type[BaseException]) -> None:
    """By a time-out, or by Ctrl-C: it comes to rest, and does not go back."""
    with daemon.client() as bus, bus.drive("x", lease=2) as axis:
        axis.enable()
        if ends is KeyboardInterrupt:
            Timer(0.5, signal.raise_signal, (signal.SIGINT,)).start()
        with pytest.raises(ends):
            axis.home(timeout=0.5 if ends is NoAnswerError else 60)
        wait_for(lambda: axis.status.enabled and abs(axis.status.speed) < 1e-3, daemon)
        rest = axis.position
        for _ in range(300):
            axis._group.wait()
        assert axis.position == pytest.approx(rest, abs=1e-4)
        assert axis.status.homing == Homing.NOT_HOMED


def test_a_homing_method_is_not_written_to_an_axis_that_cannot_home(daemon: Daemon) -> None:
    before = daemon.ctl("sdo-read", "x", "0x6098").stdout
    with (
        daemon.client() as bus,
        bus.drive("x", lease=2) as axis,
        pytest.raises(DriveError, match="enable it first"),
    ):
        axis.home(-1)
    assert daemon.ctl("sdo-read", "x", "0x6098").stdout == before


def test_scales_of_opposite_signs_are_refused(start_daemon: Callable[..., Daemon]) -> None:
    text = (EXAMPLES / "two-axes.toml").read_text()
    first, entry, rest = text.partition('entry = "0x606C:00"')
    assert entry
    config = first + entry + rest.replace("scale = ", "scale = -", 1)
    first, entry, rest = config.partition('entry = "0x60FF:00"')
    config = first + entry + rest.replace("scale = ", "scale = -", 1)
    daemon = start_daemon("two-axes", config=config)
    with daemon.client() as bus:
        with pytest.raises(UsageError) as error, bus.drive("x"):
            pass
        names(error.value, "axis x", "different signs", "[[signal]]")

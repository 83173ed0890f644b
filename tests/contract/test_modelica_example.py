"""The experiment of Figure 9 in C: its record, its end, and what happens to the drive."""

import csv
import importlib.util
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import PATIENCE, Daemon, names
from ecatd.shm.contract import Outputs
from ecatgen import examples

pytestmark = pytest.mark.unprivileged

EXAMPLE = Path(__file__).parents[2] / "examples" / "figure9"
DRIVE = 0
STATE, OPERATION_ENABLED = 0x6F, 0x27
"""In the statusword (IEC 61800-7-201)."""
LONG, SHORT = 30, 2
"""Leases in s: one that a busy machine does not end, and one that a test can wait for."""

Start = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture(scope="module")
def figure9(tmp_path_factory: pytest.TempPathFactory, compiler: str, troll: Daemon) -> Start:
    """Builds the program with the command in its head and a lease, and starts it."""
    out = tmp_path_factory.mktemp("out")
    troll.ctl("generate", "TrollPlant", str(out))
    resources = out / "EtherCAT" / "Resources"
    (archive,) = (resources / "Library").rglob("libecat.a")

    def build(lease: int) -> Path:
        program = out / f"figure9-{lease}"
        if program.exists():
            return program
        done = subprocess.run(
            [
                *(compiler, "-O2", "-Wall", "-Wextra", "-Werror", f"-DLEASE={lease}"),
                *("-I", str(resources / "Include")),
                *("-I", str(resources / "Source" / "standalone")),
                *("-I", str(out / "TrollPlant" / "Resources" / "Source")),
                *(str(EXAMPLE / "figure9.c"), str(archive), "-lm", "-o", str(program)),
            ],
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return program

    def start(*arguments: str, lease: int = LONG) -> "subprocess.Popen[str]":
        program = build(lease)
        wait_until_it_rests(troll)
        return subprocess.Popen([str(program), *arguments], stderr=subprocess.PIPE, text=True)

    return start


def read(file: Path) -> list[dict[str, float]]:
    with file.open(newline="") as lines:
        return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(lines)]


def wait_until_it_rests(troll: Daemon) -> None:
    """Waits until the motor has run out after the test before."""
    with troll.client() as client:
        velocity = client.signal(DRIVE, 0x606C)
        client.sample()
        while velocity.raw != 0:
            client.wait()
            client.sample()


def start_to_move(
    daemon: Daemon, start: Callable[[], "subprocess.Popen[str]"]
) -> "subprocess.Popen[str]":
    """Starts a program, and waits until it moves the drive.

    A drive that the busy machine loses moves no more, as it should: the program starts again.
    """
    limit = time.monotonic() + PATIENCE
    process, was_enabled = start(), False
    with daemon.client() as client:
        velocity, status = client.signal(DRIVE, 0x606C), client.signal(DRIVE, 0x6041)
        while True:
            client.wait()
            client.sample()
            active = client.slaves()[DRIVE].outputs == Outputs.ACTIVE
            if active and velocity.raw > 100_000:
                return process
            enabled = active and status.raw & STATE == OPERATION_ENABLED
            is_lost = process.poll() is not None or (was_enabled and not enabled)
            was_enabled = enabled
            is_late = time.monotonic() > limit
            if is_late or is_lost:
                process.kill()
                _, log = process.communicate()
                assert not is_late, f"the drive does not move, status {status.raw:#x}: {log}"
                process = start()


def wait_until_it_is_safe(troll: Daemon) -> None:
    limit = time.monotonic() + PATIENCE
    with troll.client() as client:
        while client.slaves()[DRIVE].outputs != Outputs.SAFE:
            assert time.monotonic() < limit, "the outputs are not safe"
            client.wait()


@pytest.mark.bus
def test_the_motor_follows_the_reference(figure9: Start, troll: Daemon, tmp_path: Path) -> None:
    file = tmp_path / "record.csv"
    process = figure9(troll.bus, "2.5", str(file))
    _, log = process.communicate()
    assert process.returncode == 0, log
    assert "2.0 of 2.5 s" in log
    rows = read(file)
    assert len(rows) == 2501
    assert rows[-1]["time"] == pytest.approx(2.5)
    assert all(row["w_m"] == row["w_ref"] == 0 for row in rows if row["time"] < 0.9)
    top = [row for row in rows if row["time"] > 2]
    assert all(row["w_ref"] == examples.MAX_SPEED for row in top)
    speeds = sorted(row["w_m"] for row in top)
    assert speeds[len(speeds) // 2] == pytest.approx(examples.MAX_SPEED, rel=0.01)
    rising = [row["i_m"] for row in rows if 1.1 < row["time"] < 1.4]
    steady = [row["i_m"] for row in top]
    # In A. A model that a busy machine delays accelerates the drive less.
    assert sum(rising) / len(rising) > 1.1 * sum(steady) / len(steady) > 0.25
    wait_until_it_is_safe(troll)


@pytest.mark.bus
def test_an_interrupt_ends_it_and_makes_the_drive_safe(
    figure9: Start, troll: Daemon, tmp_path: Path
) -> None:
    file = tmp_path / "record.csv"
    process = start_to_move(troll, lambda: figure9(troll.bus, "60", str(file)))
    process.send_signal(signal.SIGINT)
    _, log = process.communicate()
    assert process.returncode == 130
    assert "interrupted: " in log
    wait_until_it_is_safe(troll)
    assert read(file)[-1]["w_m"] > 0


@pytest.mark.bus
def test_a_program_that_is_killed_leaves_the_drive_safe(
    figure9: Start, troll: Daemon, tmp_path: Path
) -> None:
    file = str(tmp_path / "record.csv")
    process = start_to_move(troll, lambda: figure9(troll.bus, "60", file, lease=SHORT))
    process.kill()
    process.communicate()
    wait_until_it_is_safe(troll)


@pytest.mark.bus
def test_a_program_that_is_paused_loses_its_lease_and_says_so(
    figure9: Start, troll: Daemon, tmp_path: Path
) -> None:
    file = tmp_path / "record.csv"
    process = start_to_move(troll, lambda: figure9(troll.bus, "60", str(file), lease=SHORT))
    process.send_signal(signal.SIGSTOP)
    wait_until_it_is_safe(troll)
    process.send_signal(signal.SIGCONT)
    _, log = process.communicate()
    assert process.returncode == 1
    names(log, "sample", "in time", "lost its outputs")
    assert read(file)


@pytest.mark.bus
def test_a_daemon_that_dies_ends_it_with_a_sentence(
    figure9: Start, start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    daemon = start_daemon("troll")
    file = str(tmp_path / "record.csv")
    process = start_to_move(daemon, lambda: figure9(daemon.bus, "60", file))
    daemon.kill_all()
    _, log = process.communicate()
    assert process.returncode == 1
    names(log, "EtherCAT", f"'{daemon.bus}'")
    # The engine may have been dead for a moment before the lock of its daemon was.
    assert "has ended" in log or "stands still" in log


def plot(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(EXAMPLE / "plot.py"), *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.skipif(importlib.util.find_spec("matplotlib") is None, reason="needs matplotlib")
@pytest.mark.parametrize(
    "text",
    [
        "time,w_ref,w_m,i_m\n0,0,0,0\n1,62.8,62.7,0.57\n",
        '"time","keepAlive","i_m","w_m","w_ref"\n0,0,0,0,0\n1,0,0.57,62.7,62.8\n',
    ],
    ids=["c", "openmodelica"],
)
def test_the_plot_reads_both_kinds_of_results(tmp_path: Path, text: str) -> None:
    (tmp_path / "result.csv").write_text(text)
    result = plot(tmp_path / "result.csv", tmp_path / "picture.png")
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "picture.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.skipif(importlib.util.find_spec("matplotlib") is None, reason="needs matplotlib")
def test_the_plot_refuses_other_files(tmp_path: Path) -> None:
    (tmp_path / "result.csv").write_text("time,x\n0,1\n")
    result = plot(tmp_path / "result.csv", tmp_path / "picture.png")
    assert result.returncode == 1
    assert "has no column 'w_ref'" in result.stderr
    assert not (tmp_path / "picture.png").exists()

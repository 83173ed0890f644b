"""A CANopen drive behind a CAN terminal, which the program of examples/can turns.

It stops when the program dies or hangs, and when the daemon ends.
"""

from __future__ import annotations

import csv
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from turning_drive import simulator_beside

from conftest import PATIENCE, SHM, Daemon, names, stop_process
from ecatsim.can.nodes.drive import EDS
from ecatsim.control import Simulator

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

CYCLE_TIME_US = 1000
"""The program samples every millisecond, and so does its bus."""

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "can"
CONFIG = re.sub(r"^bus = .*$", "", (ROOT / "examples/troll/troll-can.toml").read_text(), flags=re.M)
DRIVE = "CANopen drive 5"
FAST = 30.0  # rad/s; the reference has 62.8
LONG, SHORT = 30, 2
"""Leases in s: one that a busy machine does not end, and one that a test can wait for."""


@pytest.fixture(scope="module")
def build(tmp_path_factory: pytest.TempPathFactory, compiler: str) -> Callable[[int], Path]:
    """Builds the program, as its head says, with a lease."""
    out = tmp_path_factory.mktemp("out")
    generate = [
        *(sys.executable, "-m", "ecatd.cli", "generate", "TrollPlant", str(out)),
        *("--from", "troll-can", "--config", str(ROOT / "examples/troll/troll-can.toml")),
        *("--can", f"can={EDS}@5"),
    ]
    subprocess.run(generate, check=True, stdout=subprocess.DEVNULL)
    resources = out / "EtherCAT" / "Resources"
    (archive,) = (resources / "Library").rglob("libecat.a")

    def build(lease: int) -> Path:
        program = out / f"wheel-{lease}"
        if not program.exists():
            command = [
                *(compiler, "-O2", "-Wall", "-Wextra", "-Werror", f"-DLEASE={lease}"),
                *("-I", resources / "Include", "-I", resources / "Source" / "standalone"),
                *("-I", out / "TrollPlant" / "Resources" / "Source"),
                *(EXAMPLE / "wheel_over_can.c", archive, "-lm", "-o", program),
            ]
            subprocess.run(command, check=True)
        return program

    return build


class Machine:
    """A daemon, the simulator beside it, and what the simulator says about the drive."""

    def __init__(self, daemon: Daemon, simulator: Simulator, record: Path) -> None:
        self.daemon = daemon
        self.record = record
        self._simulator = simulator

    @property
    def drive(self) -> dict[str, Any]:
        nodes = [node for bus in self._simulator.can() for node in bus["nodes"]]
        (drive,) = [node["application"] for node in nodes if node["name"] == DRIVE]
        return drive

    def wait(self, condition: Callable[[dict[str, Any]], bool]) -> None:
        end = time.monotonic() + PATIENCE
        while not condition(drive := self.drive):
            assert time.monotonic() < end, f"{drive}\n{self.daemon.log}"
            time.sleep(0.02)

    def wait_until_it_stands_still(self) -> None:
        self.wait(lambda drive: drive["nmt"] == "stopped" and drive["speed"] == 0)

    @contextmanager
    def turning(self, program: Path) -> Iterator[subprocess.Popen[str]]:
        """The program, when it turns the drive; it begins anew if a busy machine loses it."""
        end = time.monotonic() + PATIENCE
        while True:
            command = [program, self.daemon.bus, "3600", self.record]
            process = subprocess.Popen(
                command, env=self.daemon.env, stderr=subprocess.PIPE, text=True
            )
            begin = time.monotonic()
            while process.poll() is None and time.monotonic() < begin + 30:
                if self.drive["speed"] > FAST:
                    try:
                        yield process
                    finally:
                        process.kill()
                        process.wait()
                        assert process.stderr
                        process.stderr.close()
                    return
                time.sleep(0.02)
            process.kill()
            _, said = process.communicate()
            assert time.monotonic() < end, f"{said}\n{self.drive}\n{self.daemon.log}"


@contextmanager
def machine(folder: Path, config: str = CONFIG) -> Iterator[Machine]:
    with simulator_beside("troll-can") as (simulator, interface, enter):
        daemon = Daemon(
            *(folder, "", "--interface", interface),
            config=config,
            preexec=enter,
            cycle_time_us=CYCLE_TIME_US,
        )
        try:
            yield Machine(daemon.wait_ready(), simulator, folder / "record.csv")
        finally:
            daemon.close()


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Machine]:
    with machine(tmp_path_factory.mktemp("machine")) as found:
        yield found


def test_the_motor_follows_the_reference(
    shared: Machine, build: Callable[[int], Path], tmp_path: Path
) -> None:
    file = tmp_path / "record.csv"
    for _ in range(3):  # a busy machine may lose the drive
        command = [build(LONG), shared.daemon.bus, "2.5", file]
        result = subprocess.run(
            command, env=shared.daemon.env, capture_output=True, text=True, check=False
        )
        assert result.returncode == 0, result.stderr
        with file.open(newline="") as lines:
            rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(lines)]
        assert len(rows) == 2501
        top = [row for row in rows if row["time"] > 2]
        speeds = sorted(row["w_m"] for row in top)
        if speeds[len(speeds) // 2] == pytest.approx(top[0]["w_ref"], rel=0.01):
            break
    else:
        pytest.fail(f"{speeds[len(speeds) // 2]} rad/s\n{shared.daemon.log}")
    assert all(row["w_m"] == row["w_ref"] == 0 for row in rows if row["time"] < 0.9)
    rising = [row["i_m"] for row in rows if 1.1 < row["time"] < 1.4]
    steady = [row["i_m"] for row in top]
    assert sum(rising) / len(rising) > 1.1 * sum(steady) / len(steady) > 0.25
    assert all(row["age_m"] >= 0 for row in rows)
    shared.wait_until_it_stands_still()


def test_a_program_that_ends_in_order_stops_the_drive(
    shared: Machine, build: Callable[[int], Path]
) -> None:
    with shared.turning(build(LONG)) as program:
        program.send_signal(signal.SIGINT)
        assert program.wait() == 130
        shared.wait_until_it_stands_still()


def test_a_program_that_is_killed_stops_the_drive(
    shared: Machine, build: Callable[[int], Path]
) -> None:
    with shared.turning(build(LONG)) as program:
        program.kill()
        shared.wait_until_it_stands_still()


def test_a_program_that_hangs_stops_the_drive(
    shared: Machine, build: Callable[[int], Path]
) -> None:
    with shared.turning(build(SHORT)) as program:
        stop_process(program.pid)
        shared.wait_until_it_stands_still()
        program.send_signal(signal.SIGCONT)
        _, said = program.communicate()
        assert program.returncode == 1
        names(said, "slave 6", "lease")


def test_a_daemon_that_is_stopped_stops_the_drive(
    build: Callable[[int], Path], tmp_path: Path
) -> None:
    with machine(tmp_path) as own, own.turning(build(LONG)):
        assert own.daemon.stop() == 0
        own.wait_until_it_stands_still()


def test_without_safe_frames_the_drive_turns_on(
    build: Callable[[int], Path], tmp_path: Path
) -> None:
    """What the other tests would see if ecatd sent nothing."""
    config = re.sub(r"\[\[slave\.can\.safe\]\]\n(?:.+\n)+", "", CONFIG)
    assert "safe]]" not in config
    with machine(tmp_path, config) as own, own.turning(build(LONG)) as program:
        program.kill()
        program.wait()
        end = time.monotonic() + PATIENCE
        while own.daemon.ctl_json("can", "stats", "can")["channels"][0]["senders"]:
            assert time.monotonic() < end
        time.sleep(0.5)
        assert own.drive["nmt"] == "operational"
        assert own.drive["speed"] > FAST


@pytest.mark.long
@pytest.mark.timeout(300)
def test_the_demo_goes_through(tmp_path: Path) -> None:
    result = subprocess.run(
        [
            *(sys.executable, EXAMPLE / "demo.py", "--out", tmp_path / "demo"),
            *("--bus", "tdemocan", "--seconds", "3"),
        ],
        env={**os.environ, "ECATD_RUNTIME_DIR": str(tmp_path / "run")},
        text=True,
        capture_output=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert (tmp_path / "demo" / "figure9-can.png").read_bytes().startswith(b"\x89PNG")
    for words in ("missed", "exchange with the slaves", "age of the measured speed", "p99"):
        assert words in result.stdout
    assert not list(SHM.glob("tdemocan*"))
    assert not list((tmp_path / "run").iterdir())

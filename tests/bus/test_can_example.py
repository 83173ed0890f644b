"""The example with the CANopen drive: its model, and the program that makes the same calls."""

from __future__ import annotations

import csv
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon
from ecatdev.checks import check_translation
from ecatsim.can.nodes.drive import EDS

pytestmark = pytest.mark.bus

CYCLE_TIME_US = 1000
"""The program takes a sample in each cycle, as it tells the drive."""

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def daemon(start_shared: Callable[..., Daemon]) -> Daemon:
    text = (EXAMPLES / "troll" / "troll-can.toml").read_text()
    return start_shared("troll-can", config=text.replace('bus = "ecat0"\n', ""))


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory, daemon: Daemon) -> Path:
    folder = tmp_path_factory.mktemp("out")
    daemon.ctl("generate", "CanPlant", str(folder), "--can", f"can-drives={EDS}@5")
    return folder


def test_the_model_is_translated(out: Path, tmp_path: Path) -> None:
    shutil.copytree(out, tmp_path / "out")
    shutil.copy(EXAMPLES / "can" / "CanopenDrive.mo", tmp_path / "out")
    assert list(check_translation(tmp_path / "out", ["CanopenDrive"])) == []


def test_the_program(out: Path, daemon: Daemon, tmp_path: Path, compiler: str) -> None:
    resources = out / "EtherCAT" / "Resources"
    (archive,) = (resources / "Library").rglob("libecat.a")
    subprocess.run(
        [
            *(compiler, "-O2", "-Wall", "-Wextra", "-Werror", "-DLEASE=30"),
            *(f"-I{resources / 'Include'}", f"-I{resources / 'Source' / 'standalone'}"),
            f"-I{out / 'CanPlant' / 'Resources' / 'Source'}",
            *(str(EXAMPLES / "can" / "figure9_can.c"), str(archive), "-lm"),
            *("-o", str(tmp_path / "program")),
        ],
        check=True,
    )
    done = subprocess.run(
        [str(tmp_path / "program"), daemon.bus, "10", str(tmp_path / "result.csv")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    with (tmp_path / "result.csv").open() as file:
        rows = [{name: float(text) for name, text in row.items()} for row in csv.DictReader(file)]
    steady = [row["w_m"] for row in rows if 3 < row["time"] < 7]
    assert sum(steady) / len(steady) == pytest.approx(62.832, rel=0.02)
    assert max(row["i_m"] for row in rows) > 0.3
    assert abs(rows[-1]["w_m"]) < 2

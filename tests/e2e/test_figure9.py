"""The experiment of the paper: the generated library's calls, in C, on the simulated rig."""

import csv
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import SHM, Daemon, names, wait_for
from ecatd.shm import contract as shm

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged, pytest.mark.long]

CYCLE_TIME_US = 1000
"""The model samples every millisecond, and so does its bus."""

FIGURE9 = Path(__file__).parents[2] / "examples" / "figure9"


@pytest.fixture(scope="module")
def figure9(troll: Daemon, tmp_path_factory: pytest.TempPathFactory, compiler: str) -> Path:
    """The program, built against nothing but the generated library."""
    out = tmp_path_factory.mktemp("figure9")
    troll.ctl("generate", "TrollPlant", str(out))
    library = out / "EtherCAT" / "Resources"
    (archive,) = (library / "Library").rglob("libecat.a")
    subprocess.run(
        [
            compiler,
            *("-O2", "-Wall", "-Wextra", "-Werror", "-DLEASE=60"),  # the machine may be busy
            f"-I{library / 'Include'}",
            f"-I{library / 'Source' / 'standalone'}",
            f"-I{out / 'TrollPlant' / 'Resources' / 'Source'}",
            FIGURE9 / "figure9.c",
            archive,
            "-lm",
            "-o",
            out / "figure9",
        ],
        check=True,
    )
    return out / "figure9"


def test_the_motor_follows_the_reference(figure9: Path, troll: Daemon, tmp_path: Path) -> None:
    record = tmp_path / "record.csv"
    result = subprocess.run(
        [figure9, troll.bus, "3", record], text=True, capture_output=True, check=False
    )
    assert result.returncode == 0, result.stderr
    with record.open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3001
    reference = [float(row["w_ref"]) for row in rows]
    speed = [float(row["w_m"]) for row in rows]
    current = [float(row["i_m"]) for row in rows]
    top = max(reference)
    assert top > 0
    assert all(v == 0 for v in reference[:1000])  # not before it is enabled and it is time
    # At rest before, and at the reference speed after the ramp.
    assert max(abs(v) for v in speed[:900]) < 0.02 * top
    assert all(abs(v - top) < 0.1 * top for v in speed[-200:])
    # The current accelerates the wheel: more than friction needs, and friction needs some.
    ramp = current[1050:1200]
    cruise = current[-200:]
    assert sum(ramp) / len(ramp) > 1.2 * sum(cruise) / len(cruise) > 0
    # The outputs are given back at the end.
    with troll.client() as client:
        for _ in range(100):
            client.wait()
            if client.slaves()[0].outputs == shm.Outputs.SAFE:
                break
        else:
            pytest.fail("the drive is still owned")


def test_an_interrupt_gives_the_outputs_back(figure9: Path, troll: Daemon, tmp_path: Path) -> None:
    with subprocess.Popen(
        [figure9, troll.bus, "60", tmp_path / "record.csv"], stderr=subprocess.PIPE, text=True
    ) as program:
        with troll.client() as client:
            while client.slaves()[0].outputs != shm.Outputs.ACTIVE:
                client.wait()
            program.send_signal(signal.SIGINT)
            assert program.wait() == 130
            wait_for(lambda: client.slaves()[0].outputs == shm.Outputs.SAFE, troll)
        assert program.stderr
        assert "interrupted" in program.stderr.read()


def test_another_bus_is_refused_in_one_sentence(
    figure9: Path, start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    other = start_daemon("line:8")
    result = subprocess.run(
        [figure9, other.bus, "1", tmp_path / "record.csv"],
        text=True,
        capture_output=True,
        check=False,
    )
    assert result.returncode not in (0, 139)
    (sentence,) = [line for line in result.stderr.splitlines() if "EtherCAT:" in line]
    there, _, here = sentence.partition("generated for")
    names(there, "slave 0", f"'{other.bus}'", "Loopback32")
    names(here, "Gold EtherCAT GCON Drive", "ecatctl generate TrollPlant")


def test_the_daemon_that_dies_ends_the_experiment(
    figure9: Path, start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    daemon = start_daemon("troll")
    with subprocess.Popen(
        [figure9, daemon.bus, "60", tmp_path / "record.csv"], stderr=subprocess.PIPE, text=True
    ) as program:
        with daemon.client() as client:
            while client.slaves()[0].outputs != shm.Outputs.ACTIVE:
                client.wait()
        daemon.kill_all()
        assert program.wait() not in (0, 139)
        assert program.stderr
        # While the daemon dies, which takes long on a busy machine, its cycle only stands still.
        assert re.search("has ended; start it again|stands still since", program.stderr.read())


def run_demo(out: Path, bus: str, *arguments: str) -> list[str]:
    return [
        sys.executable,
        str(FIGURE9 / "demo.py"),
        *("--out", str(out)),
        *("--bus", bus),
        *arguments,
    ]


@pytest.mark.timeout(300)
def test_the_demo_goes_through(tmp_path: Path) -> None:
    env = {**os.environ, "ECATD_RUNTIME_DIR": str(tmp_path / "run")}
    result = subprocess.run(
        run_demo(tmp_path / "demo", "tdemo", "--seconds", "3"),
        env=env,
        text=True,
        capture_output=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert (tmp_path / "demo" / "figure9.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "demo" / "TrollPlant" / "package.mo").is_file()
    assert "EL1018" in result.stdout
    for words in ("missed", "exchange with the slaves", "sample-to-bus delay", "p99"):
        assert words in result.stdout
    assert not list(SHM.glob("tdemo*"))
    assert not list((tmp_path / "run").iterdir())


def test_ctrl_c_ends_the_demo_and_all_it_started(tmp_path: Path) -> None:
    # Interrupted in the C program, whose progress tells when; so omc must not be found.
    path = [p for p in os.environ["PATH"].split(":") if not (Path(p) / "omc").exists()]
    env = {
        **os.environ,
        "PATH": ":".join(path),
        "ECATD_RUNTIME_DIR": str(tmp_path / "run"),
    }
    with subprocess.Popen(
        run_demo(tmp_path / "demo", "tdemoc", "--seconds", "60"),
        env=env,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    ) as demo:
        assert demo.stdout
        for line in demo.stdout:
            if "of 60 s" in line:
                break
        os.killpg(demo.pid, signal.SIGINT)  # as a terminal does
        demo.stdout.read()
        assert demo.wait() == 130
    assert not list(SHM.glob("tdemoc*"))
    assert not list((tmp_path / "run").iterdir())


@pytest.mark.skipif(not shutil.which("omc"), reason="OpenModelica (omc) is not on PATH")
@pytest.mark.timeout(300)
def test_the_demo_uses_openmodelica_where_it_is(tmp_path: Path) -> None:
    env = {**os.environ, "ECATD_RUNTIME_DIR": str(tmp_path / "run")}
    result = subprocess.run(
        run_demo(tmp_path / "demo", "tdemoo", "--seconds", "3"),
        env=env,
        text=True,
        capture_output=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert "TrollPlant.Examples.PointToPointMovement, with " in result.stdout


def test_a_plot_says_that_the_motor_was_lost(tmp_path: Path) -> None:
    record = tmp_path / "record.csv"
    rows = (f"{n / 100},60,{60 if n < 40 else 0},0" for n in range(101))
    record.write_text("\n".join(["time,w_ref,w_m,i_m", *rows]) + "\n")
    result = subprocess.run(
        [sys.executable, FIGURE9 / "plot.py", record, tmp_path / "x.png"],
        text=True,
        capture_output=True,
        check=True,
    )
    names(result.stdout, "stands still", "0.6 s", "`enable`")

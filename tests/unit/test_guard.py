"""What tests leave behind is named and makes the run fail; processes are ended as well."""

import os
import shutil
import signal
import subprocess
import sys
import uuid
from pathlib import Path

import pytest

import guard
from conftest import PATIENCE, SHM, children

GUARD = Path(guard.__file__)

TESTS = """
import os, subprocess
from pathlib import Path

def test_tidy():
    subprocess.run(["true"], check=True)

def test_careless():
    script = f"sleep 1000 & echo $! > {os.environ['LEFT']}"
    subprocess.run(["setsid", "sh", "-c", script], check=True)
    Path("/dev/shm", os.environ["NAME"]).touch()
    assert os.environ["WHAT"] != "fail"
    if os.environ["WHAT"] == "die":
        os.kill(os.getpid(), 9)
"""


PATIENT = {"ECATD_TEST_PATIENCE_S": "120"}
"""Another run of the tests on this machine may leave something for a moment: it gets the time."""


def guarded(*command: object, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, GUARD, *map(str, command)],
        env={**os.environ, "ECATD_TEST_PATIENCE_S": "0.5", **environment},
        text=True,
        capture_output=True,
        check=False,
    )


@pytest.mark.parametrize(
    ("what", "status"), [("pass", guard.EXIT_STATUS), ("fail", 1), ("die", -9 % 256)]
)
def test_what_a_test_leaves_is_named_and_ended(tmp_path: Path, what: str, status: int) -> None:
    (tmp_path / "test_left.py").write_text(TESTS)
    conftest = GUARD.with_name("conftest.py")
    (tmp_path / "conftest.py").write_text(
        f"import sys\nsys.path.insert(0, {str(GUARD.parent)!r})\n"
        + conftest.read_text().partition("class Daemon")[0]
    )
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    name = f"{SHM.name}/t{uuid.uuid4().hex[:10]}"
    left = tmp_path / "pid"
    pytest_command = (sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", tmp_path)
    run = guarded(*pytest_command, WHAT=what, NAME=name, LEFT=str(left))
    assert run.returncode == status, run.stdout + run.stderr
    pid = int(left.read_text())
    test = "test_left.py::test_careless"
    assert f"left behind: process {pid} (sleep 1000), started by {test}" in run.stderr
    assert f"left behind: shared memory /dev/shm/{name}, left by {test}" in run.stderr
    assert not Path(f"/proc/{pid}").exists()
    Path("/dev/shm", name).unlink()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root makes files of other users")
@pytest.mark.parametrize(("owner", "ours"), [(2, False), (guard._NOBODY, True), (54399, True)])
def test_what_another_user_of_the_machine_makes_meanwhile_is_theirs(
    tmp_path: Path, owner: int, ours: bool
) -> None:
    """Another user may begin to run ecatd in a folder of their own while the tests run."""
    folder = Path(f"/dev/shm/ecat-{owner}")
    run = guarded(
        *("sh", "-c", f"mkdir {folder} && touch {folder}/x && chown -R {owner} {folder}"),
    )
    shutil.rmtree(folder)
    assert run.returncode == (guard.EXIT_STATUS if ours else 0)
    assert (f"{folder}/x" in run.stderr) == ours


def test_nothing_is_left(tmp_path: Path) -> None:
    run = guarded(sys.executable, "-c", "import subprocess; subprocess.run(['true'])", **PATIENT)
    assert (run.returncode, run.stderr) == (0, "")
    assert guarded(sys.executable, "-c", "raise SystemExit(3)").returncode == 3


OTHER = """
import mmap, os, signal, sys
begin, there, name = sys.argv[1:]
open(begin).read()
with open(name, "w+b") as file:
    file.truncate(4096)
    memory = mmap.mmap(file.fileno(), 4096)
os.closerange(3, 100)  # the mapping has a descriptor of its own in Python, but not in C
open(there, "w").close()
signal.pause()
"""


def test_what_another_program_has_mapped_is_not_left_behind(tmp_path: Path) -> None:
    begin, there = tmp_path / "begin", tmp_path / "there"
    os.mkfifo(begin)
    os.mkfifo(there)
    name = SHM / f"t{uuid.uuid4().hex[:10]}"
    other = subprocess.Popen([sys.executable, "-c", OTHER, begin, there, name])
    try:
        # The guard has taken stock before the other program makes its shared memory.
        run = guarded("sh", "-c", f"echo > {begin}; cat {there}", **PATIENT)
        assert (run.returncode, run.stderr) == (0, "")
        assert name.exists()
    finally:
        other.kill()
        other.wait()
        name.unlink(missing_ok=True)


def test_tests_that_were_running_are_suspects() -> None:
    diary = [
        '["begin", "a", [[], [], []]]',
        '["begin", "b", [[], [], []]]',
        '["end", "b", [["/dev/shm/ecat/x"], [], []]]',
        '["begin", "c", [["/dev/shm/ecat/x"], ["veth0"], []]]',
        '["end", "a", [["/dev/shm/ecat/x"], ["veth0"], []]]',
    ]
    assert guard.suspects(diary, "/dev/shm/ecat/x") == ["a", "b"]
    assert guard.suspects(diary, "veth0") == ["a"], "it was there before the other one began"
    assert guard.suspects(diary, "eth7") == ["c"]


@pytest.mark.parametrize("victim", ["first", "second"])
def test_nothing_stays_when_the_guard_is_killed(tmp_path: Path, victim: str) -> None:
    left = tmp_path / "pid"
    os.mkfifo(left)
    script = f"setsid sleep 1000 & echo $! >{left}; wait"
    run = subprocess.Popen(
        [sys.executable, GUARD, "sh", "-c", script],
        env={**os.environ, "ECATD_TEST_PATIENCE_S": "0.5"},
        stderr=subprocess.PIPE,
    )
    pid = int(left.read_text())
    (second,) = children(run.pid)
    os.kill(run.pid if victim == "first" else second, signal.SIGKILL)
    _, said = run.communicate(timeout=PATIENCE)  # nobody has it open any more
    assert f"left behind: process {pid} (" in said.decode()
    assert not Path(f"/proc/{pid}").exists()

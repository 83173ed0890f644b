"""What tests leave behind is named, ended and removed, and makes the run fail."""

import os
import subprocess
import sys
import uuid
from pathlib import Path

import pytest

import guard

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
    name = f"ecat.t{uuid.uuid4().hex[:10]}"
    left = tmp_path / "pid"
    pytest_command = (sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", tmp_path)
    run = guarded(*pytest_command, WHAT=what, NAME=name, LEFT=str(left))
    assert run.returncode == status, run.stdout + run.stderr
    pid = int(left.read_text())
    test = "test_left.py::test_careless"
    assert f"left behind: process {pid} (sleep 1000), started by {test}" in run.stderr
    assert f"left behind: shared memory /dev/shm/{name}, left by test_left.py" in run.stderr
    assert not Path(f"/proc/{pid}").exists()
    Path("/dev/shm", name).unlink()


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
    name = Path("/dev/shm", f"ecat.t{uuid.uuid4().hex[:10]}")
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


def test_files_of_tests_that_were_running_are_suspects() -> None:
    diary = [
        '["begin", "a.py", [[], [], []]]',
        '["begin", "b.py", [[], [], []]]',
        '["end", "b.py", [["/dev/shm/ecat.x"], [], []]]',
        '["begin", "c.py", [["/dev/shm/ecat.x"], ["veth0"], []]]',
        '["end", "a.py", [["/dev/shm/ecat.x"], ["veth0"], []]]',
    ]
    assert guard.suspects(diary, "/dev/shm/ecat.x") == ["a.py", "b.py"]
    assert guard.suspects(diary, "veth0") == ["a.py", "c.py"]
    assert guard.suspects(diary, "eth7") == ["c.py"]

"""python-can's own tests, on channels of ecatd. They come from its source, which pip fetches."""

import fcntl
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import can
import pytest
from test_can import CONFIG, CYCLE_TIME_US, LEFT, RIG, RIGHT  # noqa: F401 (conftest.py reads the cycle time)

from conftest import Daemon

pytestmark = pytest.mark.bus
HERE = Path(__file__).parent
OFFLINE = "ECATD_TEST_OFFLINE"
"""Set in the environment where there is no network: these tests are skipped."""
PASSED = {"OneChannel": 10, "TwoTerminals": 10, "Threads": 12, "Filters": 3}
"""How many tests of python-can 4.6.1 each of our classes has; later versions may have more."""


def source_of_python_can() -> Path:
    """The source of the python-can that is installed. The first test process fetches it."""
    folder = Path(tempfile.gettempdir()) / f"ecatd-tests-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    there = folder / f"python_can-{can.__version__}"
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not there.exists():
            with tempfile.TemporaryDirectory(dir=folder) as new:
                _fetch(Path(new))
                (Path(new) / there.name).rename(there)
    return there


def _fetch(to: Path) -> None:
    wanted = f"python-can=={can.__version__}"
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check"]
    command += ["--no-deps", "--no-binary", ":all:", "--dest", str(to), wanted]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, (
        f"pip cannot fetch the source of {wanted}, whose tests this one runs; without a network, "
        f"set {OFFLINE}=1 to skip it\n{done.stderr}"
    )
    (archive,) = to.glob("*.tar.gz")
    subprocess.run(["tar", "xf", str(archive), "-C", str(to)], check=True)


@pytest.mark.skipif(bool(os.environ.get(OFFLINE)), reason=f"{OFFLINE} says there is no network")
def test_the_tests_of_python_can_pass(start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    tests = source_of_python_can() / "test"
    rig = tmp_path / "pair.toml"
    rig.write_text(RIG)
    daemon = start_daemon(str(rig), config=CONFIG)
    program = [sys.executable, str(HERE / "python_can_own.py")]
    done = subprocess.run(
        [*program, str(tests), daemon.bus, str(LEFT), str(RIGHT)],
        env=daemon.env,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert done.returncode == 0, done.stdout
    found = json.loads(done.stdout.splitlines()[-1])
    assert not [name for one in found.values() for name in one["wrong"]], done.stdout
    counts = {name: one["passed"] for name, one in found.items()}
    if can.__version__ == "4.6.1":
        assert counts == PASSED, done.stdout
    else:
        assert all(counts[name] >= PASSED[name] for name in PASSED), done.stdout

"""How other processes are."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from ecatd.linux.process_state import WORDS, has_open, look_at_process


def until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 30
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def state_of(pid: int, since_ns: int = 0) -> str | None:
    found = look_at_process(pid, since_ns)
    return found.state if found else None


def test_a_process_sleeps_is_stopped_and_ends() -> None:
    before_ns = time.monotonic_ns() - 1_000_000_000
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        until(lambda: state_of(process.pid) == "sleeps")
        found = look_at_process(process.pid)
        assert found is not None
        assert found.name.startswith("python")
        process.send_signal(signal.SIGSTOP)
        until(lambda: state_of(process.pid) == "stopped")
        assert state_of(process.pid, time.monotonic_ns()) == "stopped"
        assert state_of(process.pid, before_ns) is None  # the number was that of another one then
        process.kill()
        until(lambda: state_of(process.pid) == "ended")  # nobody has waited for it
    assert look_at_process(process.pid) is None
    own = look_at_process(os.getpid())
    assert own is not None
    assert own.state in WORDS


def test_which_files_a_process_has_open(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    with file.open() as opened:
        assert has_open(os.getpid(), opened.fileno()) is True
        with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
            until(lambda: state_of(process.pid) == "sleeps")
            assert has_open(process.pid, opened.fileno()) is False
            process.kill()
        assert has_open(process.pid, opened.fileno()) is None

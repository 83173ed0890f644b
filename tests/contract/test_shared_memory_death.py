"""A daemon that is killed while it makes its shared memory: the next start can make it anew."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from test_shared_memory import make_bus

from conftest import SHM, naming
from ecatd.base.errors import EcatError
from ecatd.master.engine.process_image import lay_out
from ecatd.master.engine.shared_memory import SharedMemory

KILLED_AT_EVERY_LINE = """
import os, signal, sys
from test_shared_memory import make_bus
from ecatd.master.engine import shared_memory as module
from ecatd.master.engine.process_image import lay_out
from ecatd.client import Client
from ecatd.shm.files import make_folder

bus = make_bus()
SHM = make_folder(print)
files = lambda: sorted(path.name for path in SHM.glob(f"*{bus.name}*"))

def serve():
    made = module.SharedMemory(bus.name, SHM)
    made.fill(bus, lay_out(bus, set()), 5_000_000, 500_000_000)
    made.header.cycle_end_ns = 1 << 62
    made.publish()
    return made

def die_at(number):
    seen = set()
    def trace(frame, event, argument):
        if frame.f_code.co_filename != module.__file__:
            return None
        seen.add((frame.f_code, frame.f_lineno))
        if len(seen) > number:
            os.kill(os.getpid(), signal.SIGKILL)
        return trace
    sys.settrace(trace)

left = set()
for number in range(10000):
    child = os.fork()
    if child == 0:
        die_at(number)
        serve()
        os._exit(0)
    _, status = os.waitpid(child, 0)
    left.add(tuple(files()))
    again = serve()
    Client(bus.name).close()
    assert files() == [bus.name, f"{bus.name}.out"], (number, files())
    again.close()
    assert files() == [], (number, files())
    if os.WIFEXITED(status):
        break
print(number, len(left))
"""


def test_r26_a_start_that_is_killed_at_any_point_is_healed() -> None:
    path = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    run = subprocess.run(
        [sys.executable, "-c", KILLED_AT_EVERY_LINE],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    lines, leftovers = map(int, run.stdout.split())
    assert lines > 80
    assert leftovers >= 3  # nothing, the first file, both


@pytest.mark.parametrize("kind", ["file", "symlink", "dangling", "fifo"])
@pytest.mark.parametrize("suffix", ["", ".out"])
def test_whatever_has_the_name_is_replaced(kind: str, suffix: str, tmp_path: Path) -> None:
    bus = make_bus()
    path = SHM / f"{bus.name}{suffix}"
    target = tmp_path / "target"
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "file":
        path.write_bytes(b"x" * 100)
    else:
        path.symlink_to(target)
    if kind == "symlink":
        target.write_text("not ours")
    shared = SharedMemory(bus.name, SHM)
    shared.fill(bus, lay_out(bus, set()), 1, 1)
    assert path.is_file()
    assert not path.is_symlink()
    shared.close()
    assert not path.exists()
    assert target.exists() == (kind == "symlink")
    assert kind != "symlink" or target.read_text() == "not ours"


@pytest.mark.parametrize("suffix", ["", ".out"])
def test_what_cannot_be_replaced_is_named(suffix: str) -> None:
    bus = make_bus()
    path = SHM / f"{bus.name}{suffix}"
    path.mkdir()
    try:
        with pytest.raises(EcatError, match=naming(path, "directory")) as told:
            SharedMemory(bus.name, SHM).fill(bus, lay_out(bus, set()), 1, 1)
        assert "another user" not in str(told.value)
    finally:
        path.rmdir()
        (SHM / bus.name).unlink(missing_ok=True)

"""A minute of `soak.py`; `make soak` runs it for half an hour."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

SOAK = Path(__file__).with_name("soak.py")
MEMORY = "mount -t tmpfs -o size=64m none /dev/shm && exec "


@pytest.mark.bus
@pytest.mark.long
def test_r02_r22_r44_a_minute_of_faults() -> None:
    """As root with shared memory of its own, which can be filled up."""
    command = [sys.executable, str(SOAK), os.environ.get("ECAT_SOAK_S", "60")]
    command.append(os.environ.get("ECAT_SEED", "1"))
    env = dict(os.environ)
    if os.geteuid() == 0:
        env["ECAT_OWN_SHM"] = "1"
        own = ["unshare", "--mount", "--propagation", "private", "sh", "-ec"]
        command = [*own, MEMORY + shlex.join(command)]
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr[-6000:]

"""Folders of buses that root makes beside those of the service."""

import os
import subprocess
from pathlib import Path

import pytest

from conftest import PYTHON

pytestmark = pytest.mark.skipif(os.geteuid() != 0, reason="these are folders that root makes")

CODE = """
import os, sys
from pathlib import Path
from ecatd.base.paths import make_dir, user_dir
for bus in ("ecat0", "hand"):
    make_dir(bus, user_dir())
for name in ("", "ecat0", "hand"):
    state = (Path(os.environ["ECATD_RUNTIME_DIR"]) / name).stat()
    print(f"{state.st_mode & 0o7777:o}")
"""


def modes(folder: Path, *there: str) -> list[str]:
    """Modes of the folder for all buses and of those of two buses, made by root beside others."""
    run = folder / "run"
    for path in there:
        (folder / path).mkdir()
        (folder / path).chmod(0o755)
    group = folder / "group"
    group.write_text("root:x:0:\necat:x:0:\n")
    script = f'umask 077; mount --bind {group} /etc/group; exec {PYTHON} -c "$0"'
    command = ["unshare", "--mount", "sh", "-ec", script, CODE]
    env = {**os.environ, "ECATD_RUNTIME_DIR": str(run)}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=env)
    return done.stdout.split()


def test_folders_that_are_there_stay_as_they_are(tmp_path: Path) -> None:
    assert modes(tmp_path, "run", "run/ecat0") == ["755", "755", "2750"]


def test_the_folder_of_all_buses_is_as_systemd_makes_it(tmp_path: Path) -> None:
    assert modes(tmp_path) == ["755", "2750", "2750"]

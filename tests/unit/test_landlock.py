"""Landlock: what a process may still do, tried in a process of its own."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import os, signal, subprocess, sys
from pathlib import Path
from ecatd.base.landlock import restrict
from ecatd.base.process import drop_rights
inside, outside, parent = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
drop_rights()
opened = (outside / "open").open("w")
print(restrict([inside]))
def tried(what):
    try:
        what()
    except OSError as error:
        return type(error).__name__
    return "done"
print(tried(lambda: (inside / "new").write_text("x")))
print(tried(lambda: (inside / "new").unlink()))
print(tried(lambda: (outside / "new").write_text("x")))
print(tried(lambda: (outside / "there").write_text("x")))
print(tried(lambda: (outside / "there").unlink()))
print(tried(lambda: (outside / "there").read_text()))
print(tried(lambda: opened.write("x")))
print(tried(lambda: subprocess.run(["/bin/true"])))
"""


def test_a_process_can_be_restricted(tmp_path: Path) -> None:
    inside, outside = tmp_path / "inside", tmp_path / "outside"
    for folder in (inside, outside):
        folder.mkdir()
    (outside / "there").write_text("there")
    command = [sys.executable, "-c", PROGRAM, inside, outside, str(os.getpid())]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    possible, *tried = done.stdout.split()
    if possible == "False":
        pytest.skip("this kernel has no Landlock")
    refused = "PermissionError"
    assert tried == ["done", "done", refused, refused, refused, "done", "done", refused]
    assert (outside / "there").read_text() == "there"


def test_a_folder_that_is_not_there() -> None:
    program = (
        "from pathlib import Path\nfrom ecatd.base.landlock import restrict\n"
        "from ecatd.base.process import drop_rights\ndrop_rights()\n"
        "try: print(restrict([Path('/absent')]))\nexcept OSError as error: print(error.strerror)"
    )
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.strip() in ("False", os.strerror(errno.ENOENT))


@pytest.mark.skipif(os.geteuid() != 0, reason="only root has rights to drop")
def test_rights_are_dropped_but_some() -> None:
    program = (
        "from pathlib import Path\nfrom ecatd.base.process import OF_A_SEGMENT, drop_rights\n"
        "import subprocess\ndrop_rights(OF_A_SEGMENT)\n"
        "print(subprocess.run(['cat', '/proc/self/status'], capture_output=True).stdout.decode())\n"
        "print(Path('/proc/self/status').read_text())"
    )
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    lines = [line.split(":\t") for line in done.stdout.splitlines() if ":\t" in line]
    segment = 1 << 12 | 1 << 13 | 1 << 14 | 1 << 23
    for name in ("CapPrm", "CapEff", "CapBnd"):
        found = [int(value, 16) for key, value in lines if key == name]
        assert found == [segment, segment], name
    assert [value for key, value in lines if key == "NoNewPrivs"] == ["1", "1"]

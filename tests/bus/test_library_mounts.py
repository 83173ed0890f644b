"""Libraries on file systems of their own: full, read-only, mount points."""

import subprocess
import sys
from pathlib import Path

import pytest

from conftest import names

pytestmark = pytest.mark.bus  # needs user namespaces, too

PROGRAM = """
import pathlib, sys
from ecatd.base.errors import EcatError
from ecatgen.output import install
out, size = pathlib.Path(sys.argv[1]), int(sys.argv[2])
try:
    install(out, {"Plant": {"a": b"x" * size, "b": b"y"}}, "Plant")
except EcatError as error:
    print(error)
print(len((out / "Plant" / "a").read_bytes()), sorted(path.name for path in out.iterdir()))
"""


def run(script: str, *arguments: str) -> list[str]:
    """Runs a shell script that may mount; `install OUT SIZE` is the program above."""
    text = 'install() { "$PYTHON" -c "$PROGRAM" "$@"; }\n' + script
    ended = subprocess.run(
        ["unshare", "--user", "--map-root-user", "--mount", "sh", "-ec", text, "sh", *arguments],
        env={"PYTHON": sys.executable, "PROGRAM": PROGRAM, **_environment()},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    return ended.stdout.splitlines()


def _environment() -> dict[str, str]:
    return {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "PYTHONPATH": ":".join(sys.path)}


def test_a_full_disk(tmp_path: Path) -> None:
    said = run(
        'mount -t tmpfs -o size=256k tmpfs "$1"; install "$1" 1000; install "$1" 1000000',
        str(tmp_path),
    )
    assert said[0] == said[2] == "1000 ['Plant']"
    names(said[1], tmp_path, "No space left")


def test_a_disk_that_may_only_be_read(tmp_path: Path) -> None:
    said = run(
        'mount -t tmpfs tmpfs "$1"; install "$1" 1; mount -o remount,bind,ro "$1"; install "$1" 2',
        str(tmp_path),
    )
    assert said[0] == said[2] == "1 ['Plant']"
    names(said[1], tmp_path, "Read-only file system")


def test_a_mount_point(tmp_path: Path) -> None:
    said = run(
        'install "$1" 1; mount --bind "$1/Plant" "$1/Plant"; install "$1" 2; umount "$1/Plant"',
        str(tmp_path),
    )
    assert said[0] == said[2] == "1 ['Plant']"
    names(said[1], tmp_path / "Plant", "mount point")

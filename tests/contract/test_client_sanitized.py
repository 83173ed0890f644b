"""The Python client on a library that checks every access to memory."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import ecatd

pytestmark = pytest.mark.long


CLIENT = Path(__file__).parents[2] / "client_c"
TESTS = ("test_client_objects", "test_return", "test_shared_memory")


def test_r16_no_call_touches_memory_that_it_must_not(tmp_path: Path, compiler: str) -> None:
    """AddressSanitizer and UndefinedBehaviorSanitizer; also what Python keeps after a close."""
    package = tmp_path / "ecatd"
    for folder in ecatd.__path__:
        shutil.copytree(folder, package, dirs_exist_ok=True)
    subprocess.run(
        [
            *(compiler, "-std=c11", "-O1", "-g", "-D_GNU_SOURCE", "-fPIC", "-shared"),
            *("-fvisibility=hidden", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"),
            *(f"-I{CLIENT / 'include'}", *(CLIENT / "src").glob("*.c")),
            *("-o", package / "_native" / "libecat.so", "-lm"),
        ],
        check=True,
    )
    preload = subprocess.run(
        [compiler, "-print-file-name=libasan.so"], check=True, text=True, capture_output=True
    ).stdout.strip()
    others = [folder for folder in sys.path if folder]
    result = subprocess.run(
        [
            *(sys.executable, "-m", "pytest", "-q", "-s", "-p", "no:cacheprovider"),
            *(Path(__file__).with_name(f"{name}.py") for name in TESTS),
        ],
        env={
            **os.environ,
            "LD_PRELOAD": preload,
            "ASAN_OPTIONS": "detect_leaks=0",  # Python does not free all of its own
            "PYTHONPATH": os.pathsep.join([str(tmp_path), *others]),
        },
        text=True,
        capture_output=True,
    )
    assert result.returncode == 0, result.stdout + result.stderr

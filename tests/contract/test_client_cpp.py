"""The C++ client: what it promises, on a live bus, and two threads under the thread sanitizer."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from conftest import Daemon

HERE = Path(__file__).parent
CLIENT = HERE.parents[1] / "client_c"
WARNINGS = (
    *("-Wall", "-Wextra", "-Wconversion", "-Wsign-conversion", "-Wshadow", "-Wpointer-arith"),
    *("-Wvla", "-Werror"),
)
STRICTER = ("-Wpedantic", "-Wold-style-cast", "-Wnon-virtual-dtor")

pytestmark = [pytest.mark.bus, pytest.mark.long]


def build(
    folder: Path, source: Path, compilers: tuple[str, str], standard: str, *flags: str
) -> Path:
    """A program with the client, both from their sources and with the same flags."""
    c, cpp = compilers
    if shutil.which(cpp) is None:
        pytest.skip(f"{cpp} is not installed")
    include = f"-I{CLIENT / 'include'}"
    objects = []
    for file in sorted((CLIENT / "src").glob("*.c")):
        objects.append(folder / f"{file.stem}.o")
        subprocess.run(
            [
                *(c, "-std=c11", "-D_GNU_SOURCE", "-O2", "-g", *WARNINGS, include, *flags),
                *("-c", file, "-o", objects[-1]),
            ],
            check=True,
        )
    program = folder / source.stem
    command = (cpp, standard, *flags, "-O2", "-g", *WARNINGS, *STRICTER, include, source, *objects)
    subprocess.run([*command, "-lm", "-pthread", "-o", program], check=True)
    return program


@pytest.mark.parametrize(
    ("c", "cpp", "standard"),
    [
        ("gcc", "g++", "-std=c++17"),
        ("clang", "clang++", "-std=c++20"),
    ],
)
def test_the_cpp_client_keeps_its_promises(
    c: str, cpp: str, standard: str, troll: Daemon, tmp_path: Path
) -> None:
    program = build(tmp_path, HERE / "cpp_client.cpp", (c, cpp), standard)
    result = subprocess.run([program, troll.bus], text=True, capture_output=True, check=False)
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")


@pytest.fixture(scope="module")
def threads(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program of two threads with the thread sanitizer."""
    folder = tmp_path_factory.mktemp("threads")
    # gcc says that its thread sanitizer knows no fences; what they order is atomic.
    flags = ("-fsanitize=thread", "-Wno-tsan")
    probe = subprocess.run(
        ["g++", "-fsanitize=thread", "-x", "c++", "-", "-o", folder / "probe"],
        input="int main() {}",
        text=True,
        capture_output=True,
        check=False,
    )
    if probe.returncode != 0:
        pytest.skip("g++ has no thread sanitizer")
    return build(folder, HERE / "two_threads.cpp", ("gcc", "g++"), "-std=c++17", *flags)


def run_threads(program: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        # The sanitizer needs its usual places in memory.
        ["setarch", "-R", program, *arguments],
        env={**os.environ, "TSAN_OPTIONS": "halt_on_error=0 exitcode=66"},
        text=True,
        capture_output=True,
        check=False,
    )


def test_two_threads_with_a_handle_each_do_not_meet(threads: Path, troll: Daemon) -> None:
    result = run_threads(threads, troll.bus)
    assert (result.returncode, result.stderr) == (0, "")


def test_two_threads_with_one_handle_are_found(threads: Path, troll: Daemon) -> None:
    """The counter-example: the sanitizer sees what the other test says is not there."""
    result = run_threads(threads, troll.bus, "shared")
    assert result.returncode != 0
    assert "ThreadSanitizer: data race" in result.stderr

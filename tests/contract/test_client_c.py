"""What a C or C++ user does with the client: compile, link statically, run."""

import shutil
import subprocess
from importlib import import_module
from pathlib import Path

import pytest

from conftest import Daemon, names

ROOT = Path(__file__).parents[2]

PROGRAM = r"""
#include <ecat/ecat.h>
#include <stdio.h>

int main(int argc, char **argv) {
  ecat_t *bus = NULL;
  double value = 0;
  int position, output, input, i, code = ecat_open(&bus, argc > 1 ? argv[1] : NULL);
  if (code != 0) {
    printf("%s: %s\n", ecat_strerror(code), ecat_error(bus));
    ecat_close(bus);
    return 3;
  }
  position = ecat_find(bus, 2, 0x07D83052, 0);
  output = ecat_bind(bus, position, 0x7000, 1, ECAT_OUTPUT);
  input = ecat_bind(bus, ecat_find(bus, 2, 0x03FA3052, 0), 0x6000, 1, ECAT_INPUT);
  if (output < 0 || input < 0 || ecat_claim(bus, position, 30.0) != 0) return 4;
  if (ecat_write(bus, output, 2) != ECAT_ERANGE) return 5;
  if (ecat_write(bus, output, 1) != 0 || ecat_commit(bus) != 0) return 6;
  for (i = 0; i < 3000 && value != 1; i++)
    if (ecat_wait(bus, 1, 30.0) != 0 || ecat_sample(bus) != 0 || ecat_read(bus, input, &value) != 0)
      return 7;
  ecat_close(bus);
  printf("%g\n", value);
  return 0;
}
"""


def archive() -> Path:
    for folder in import_module("ecatgen").__path__:
        found = Path(folder) / "_client" / "lib" / "libecat.a"
        if found.exists():
            return found
    raise AssertionError("libecat.a is not installed")


@pytest.fixture(params=[("gcc", "-std=c89", ".c"), ("g++", "-std=c++17", ".cpp")])
def program(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    compiler, standard, suffix = request.param
    source = tmp_path / f"use{suffix}"
    source.write_text(PROGRAM)
    subprocess.run(
        [
            compiler,
            *(standard, "-pedantic-errors", "-Wall", "-Wextra", "-Werror"),
            f"-I{ROOT / 'client_c' / 'include'}",
            source,
            archive(),
            *("-lm", "-o", tmp_path / "use"),
        ],
        check=True,
    )
    return tmp_path / "use"


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize(
    ("header", "language", "standards"),
    [
        ("ecat.h", "c", "c89 c99 c11 c17"),
        ("ecat_shm.h", "c", "c89 c99 c11 c17"),
        ("ecat_session.h", "c", "c89 c99 c11 c17"),
        ("ecat_axis.h", "c", "c89 c99 c11 c17"),
        ("ecat.h", "c++", "c++11 c++14 c++17 c++20"),
        ("ecat_shm.h", "c++", "c++11 c++14 c++17 c++20"),
        ("ecat_session.h", "c++", "c++11 c++14 c++17 c++20"),
        ("ecat_axis.h", "c++", "c++11 c++14 c++17 c++20"),
        ("ecat_axis.hpp", "c++", "c++17 c++20"),
        ("ecat.hpp", "c++", "c++17 c++20"),
    ],
)
def test_public_headers_are_clean(
    compiler: str, header: str, language: str, standards: str, tmp_path: Path
) -> None:
    """No warning in any standard, alone, included twice, and beside macros of the program."""
    command = compiler if language == "c" else compiler.replace("gcc", "g") + "++"
    if shutil.which(command) is None:
        pytest.skip(f"{command} is not installed")
    source = tmp_path / "use"
    mine = ["CONST", "ENUM", "FIRST", "VALUE", "STRUCT", "FIELD", "END"]
    source.write_text(
        "".join(f"#define {name} 1\n" for name in mine)
        + 2 * f"#include <ecat/{header}>\n"
        + f"int main(void) {{ return {' + '.join(mine)} - {len(mine)}; }}\n"
    )
    for standard in standards.split():
        subprocess.run(
            [
                *(command, f"-std={standard}", "-x", language, "-pedantic-errors"),
                *("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror"),
                *("-Wundef", "-fsyntax-only", f"-I{ROOT / 'client_c' / 'include'}", source),
            ],
            check=True,
        )


@pytest.mark.bus
@pytest.mark.unprivileged
def test_a_program_drives_an_output_and_reads_it_back(program: Path, troll: Daemon) -> None:
    result = subprocess.run([program, troll.bus], text=True, capture_output=True, check=False)
    assert (result.returncode, result.stdout) == (0, "1\n")


def test_a_program_without_a_daemon_is_told_what_to_do(program: Path) -> None:
    result = subprocess.run([program, "nobody"], text=True, capture_output=True, check=False)
    assert result.returncode == 3
    names(result.stdout, "not running", "'nobody'", "systemctl start ecatd@nobody'")


def test_the_hot_path_makes_no_system_call(troll: Daemon, tmp_path: Path) -> None:
    """Sample, read, write and commit, 10 000 times, under strace: no call in between."""
    strace = subprocess.run(["which", "strace"], capture_output=True, check=False)
    if strace.returncode != 0:
        pytest.skip("strace is not installed")
    source = tmp_path / "hot.c"
    source.write_text(
        r"""
#include <ecat/ecat.h>
#include <unistd.h>
int main(int argc, char **argv) {
  ecat_t *bus = NULL;
  double value;
  int i, output, code = 0;
  (void)argc;
  if (ecat_open(&bus, argv[1]) != 0 || ecat_claim(bus, 3, 30.0) != 0) return 1;
  output = ecat_bind(bus, 3, 0x7000, 1, ECAT_OUTPUT);
  ecat_sample(bus);
  getppid();
  for (i = 0; i < 10000; i++) {
    code |= ecat_sample(bus) | ecat_read(bus, output, &value);
    code |= ecat_write(bus, output, i & 1) | ecat_commit(bus);
  }
  getppid();
  ecat_close(bus);
  return code == 0 ? 0 : 2;
}
"""
    )
    subprocess.run(
        [
            *("gcc", "-O2", f"-I{ROOT / 'client_c' / 'include'}", source, archive()),
            *("-lm", "-o", tmp_path / "hot"),
        ],
        check=True,
    )
    subprocess.run(["strace", "-o", tmp_path / "calls", tmp_path / "hot", troll.bus], check=True)
    calls = (tmp_path / "calls").read_text().splitlines()
    # Allowed, and rare: a sample that finds the engine interrupted while it writes lets it run, and
    # one that sees no cycle for a while looks whether the daemon still has its lock.
    calls = [call for call in calls if not call.startswith(("sched_yield", "fcntl"))]
    first, second = [n for n, line in enumerate(calls) if line.startswith("getppid")]
    assert calls[first + 1 : second] == []

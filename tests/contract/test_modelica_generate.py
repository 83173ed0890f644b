"""generateConfiguration: the C function that runs `ecatctl generate` inside a Modelica tool."""

import os
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon, names

RESOURCES = Path(__file__).parents[2] / "codegen/ecatgen/modelica/EtherCAT/Resources"

PROGRAM = """
#include "ecatm_generate.h"
int main(int argc, char **argv) {
  if (argc != 5) return 3;
  ecatm_generate(argv[1], argv[2], argv[3], argv[4]);
  return 0;
}
"""

Generate = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def generate(tmp_path: Path, compiler: str) -> Generate:
    """Calls the function with: program, bus, name, path."""
    file, binary = tmp_path / "program.c", tmp_path / "program"
    file.write_text(PROGRAM)
    subprocess.run(
        [
            *(compiler, "-std=c89", "-pedantic-errors", "-Wall", "-Wextra", "-Werror"),
            *("-I", str(RESOURCES / "Include")),
            *("-I", str(RESOURCES / "Source" / "standalone")),
            *(str(file), "-o", str(binary)),
        ],
        check=True,
    )

    def run(
        *arguments: str, env: dict[str, str] | None = None
    ) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            [str(binary), *arguments],
            cwd=tmp_path,
            env=env,
            capture_output=True,
            text=True,
            check=False,
        )

    return run


def script(tmp_path: Path, text: str) -> Path:
    """A program that a shell runs."""
    folder = tmp_path / "bin"
    folder.mkdir()
    file = folder / "ecatctl"
    file.write_text(f"#!/bin/sh\n{text}\n")
    file.chmod(0o755)
    return file


@pytest.fixture
def ecatctl(tmp_path: Path) -> Path:
    return script(tmp_path, f'exec {shlex.quote(sys.executable)} -m ecatd.cli "$@"')


@pytest.mark.bus
def test_the_library_of_the_live_bus(
    generate: Generate, ecatctl: Path, troll: Daemon, tmp_path: Path
) -> None:
    folder = tmp_path / "my models; touch 'x' $(touch y) `touch z`"
    result = generate(str(ecatctl), troll.bus, "TrollPlant", str(folder), env=troll.env)
    assert result.returncode == 0, result.stderr
    assert (folder / "TrollPlant" / "package.mo").is_file()
    assert (folder / "EtherCAT" / "package.mo").is_file()
    assert {file.name for file in tmp_path.iterdir()} & {"x", "y", "z"} == set()
    assert result.stderr.startswith(f"EtherCAT: {folder}/TrollPlant: ")  # as a message
    assert result.stdout == result.stderr  # and for OpenModelica, which shows no messages here


@pytest.mark.bus
def test_what_ecatctl_refuses_is_the_error(
    generate: Generate, ecatctl: Path, troll: Daemon, tmp_path: Path
) -> None:
    result = generate(str(ecatctl), troll.bus, "model", str(tmp_path / "out"), env=troll.env)
    assert result.returncode == 1
    assert result.stdout == ""
    assert result.stderr.startswith("EtherCAT: ")
    names(result.stderr, "no library", "ecatctl: 'model'")
    assert not (tmp_path / "out").exists()


def test_the_program_is_found_on_the_path(generate: Generate, tmp_path: Path) -> None:
    program = script(tmp_path, 'echo "$#: $*"')
    env = {**os.environ, "PATH": f"{program.parent}:{os.environ['PATH']}"}
    result = generate("ecatctl", "a  b", "Plant", "/tmp/out", env=env)
    assert result.stdout == "EtherCAT: 5: --bus a  b generate Plant /tmp/out\n"


def test_a_program_that_is_not_there(generate: Generate, tmp_path: Path) -> None:
    result = generate(str(tmp_path / "nowhere"), "ecat0", "Plant", "/tmp/out")
    assert result.returncode == 1
    names(result.stderr, tmp_path / "nowhere", "No such file", "install ecatd")


def test_a_program_that_ends_without_a_word(generate: Generate, tmp_path: Path) -> None:
    result = generate(str(script(tmp_path, "kill -9 $$")), "ecat0", "Plant", "/tmp/out")
    assert result.returncode == 1
    names(result.stderr, "no library", "ecatctl")


def test_the_end_of_a_long_output_is_left_out(generate: Generate, tmp_path: Path) -> None:
    program = script(tmp_path, "i=0; while [ $i -lt 9999 ]; do echo $i; i=$((i + 1)); done")
    result = generate(str(program), "ecat0", "Plant", "/tmp/out")
    assert result.returncode == 0
    assert result.stdout.startswith("EtherCAT: 0\n1\n2\n")
    assert 4000 < len(result.stdout) <= 4096 + len("EtherCAT: ")


@pytest.mark.parametrize(
    "arguments", [("-b", "Plant", "/tmp/out"), ("b", "--json", "/tmp/out"), ("b", "Plant", "-o")]
)
def test_nothing_passes_for_an_option(
    generate: Generate, tmp_path: Path, arguments: tuple[str, str, str]
) -> None:
    result = generate(str(script(tmp_path, "touch called")), *arguments)
    assert result.returncode == 1
    names(result.stderr, "'-'")
    assert not (tmp_path / "called").exists()

"""The C client as a package: CMake, also as a subfolder, from the wheel, and through pkg-config."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from conftest import run_module
from ecatd.base.version import VERSION

pytestmark = pytest.mark.long


ROOT = Path(__file__).parents[2]
CLIENT = ROOT / "client_c"

PROGRAM = r"""
#include <ecat/ecat.h>
#include <stdio.h>
int main(void) {
  ecat_t *bus = NULL;
  int code = ecat_open(&bus, "nobody");
  puts(ecat_error(bus));
  ecat_close(bus);
  return code == ECAT_EDOWN ? 0 : 1;
}
"""

PROJECT = """
cmake_minimum_required(VERSION 3.20)
project(user C)
{client}
foreach(kind ecat ecat_static)
  add_executable(with_${{kind}} program.c)
  target_link_libraries(with_${{kind}} PRIVATE ecat::${{kind}})
endforeach()
"""


def tool(name: str) -> str:
    """A program, from the environment of these tests first."""
    places = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    found = shutil.which(name, path=places)
    if found is None:
        pytest.skip(f"{name} is not installed")
    return found


def run(*command: str | Path, env: dict[str, str] | None = None) -> str:
    result = subprocess.run(
        command, text=True, capture_output=True, check=False, env={**os.environ, **(env or {})}
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def install(source: Path, build: Path, prefix: Path) -> None:
    """Builds a CMake project and installs it, as its users are told to."""
    cmake = tool("cmake")
    run(cmake, "-S", source, "-B", build, "-DCMAKE_BUILD_TYPE=Release")
    run(cmake, "--build", build, "--parallel", "2")
    run(cmake, "--install", build, "--prefix", prefix)


@pytest.fixture(scope="module")
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The client, installed by itself, and then moved: nothing in it may name its place."""
    folder = tmp_path_factory.mktemp("client")
    install(CLIENT, folder / "build", folder / "first")
    return (folder / "first").rename(folder / "second")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The packages with what the wheel puts into them."""
    folder = tmp_path_factory.mktemp("wheel")
    for package in ("daemon/ecatd", "codegen/ecatgen"):
        ignored = shutil.ignore_patterns("_native", "_client", "__pycache__")
        shutil.copytree(ROOT / package, folder / "site" / Path(package).name, ignore=ignored)
    install(ROOT, folder / "build", folder / "site")
    return folder / "site"


def build_and_run(folder: Path, client: str, *options: str) -> None:
    """A user's CMake project: both libraries are linked, run, and have the dependency they say."""
    (folder / "program.c").write_text(PROGRAM)
    (folder / "CMakeLists.txt").write_text(PROJECT.format(client=client))
    run(tool("cmake"), "-S", folder, "-B", folder / "build", *options)
    run(tool("cmake"), "--build", folder / "build")
    for kind, shared in (("ecat", True), ("ecat_static", False)):
        program = folder / "build" / f"with_{kind}"
        assert "'nobody'" in run(program)
        assert ("libecat.so." in run("readelf", "-d", program)) == shared


def test_cmake_finds_the_installed_client(prefix: Path, tmp_path: Path) -> None:
    build_and_run(
        tmp_path, "find_package(ecat 0.1 CONFIG REQUIRED)", f"-DCMAKE_PREFIX_PATH={prefix}"
    )


def test_cmake_finds_the_client_of_the_wheel(wheel: Path, tmp_path: Path) -> None:
    flags = run(
        *(sys.executable, "-m", "ecatd.cli", "client-flags", "--cmake-dir"),
        env={"PYTHONPATH": str(wheel)},
    )
    assert Path(flags.strip()).is_relative_to(wheel)
    build_and_run(tmp_path, "find_package(ecat 0.1 CONFIG REQUIRED)", f"-Decat_DIR={flags.strip()}")


def test_the_client_is_a_subfolder_of_another_project(tmp_path: Path) -> None:
    build_and_run(tmp_path, f'add_subdirectory("{CLIENT}" client)')


@pytest.mark.parametrize("origin", ["prefix", "wheel"])
def test_pkg_config_finds_the_client(
    origin: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    where: Path = request.getfixturevalue(origin)
    folder = str(where / "lib" / "pkgconfig")
    if origin == "wheel":
        command = (sys.executable, "-m", "ecatd.cli", "client-flags", "--pkg-config-dir")
        folder = run(*command, env={"PYTHONPATH": str(where)}).strip()
    paths = {"PKG_CONFIG_PATH": folder}
    flags = run(tool("pkg-config"), "--cflags", "--libs", "ecat", env=paths).split()
    assert "-lm" not in flags
    assert "-lm" in run(tool("pkg-config"), "--static", "--libs", "ecat", env=paths).split()
    (tmp_path / "program.c").write_text(PROGRAM)
    run("gcc", tmp_path / "program.c", *flags, "-o", tmp_path / "program")
    library = run(tool("pkg-config"), "--variable=libdir", "ecat", env=paths).strip()
    assert "is not running" in run(tmp_path / "program", env={"LD_LIBRARY_PATH": library})


def test_the_lines_of_the_page(wheel: Path, tmp_path: Path) -> None:
    """What docs/process-image.md says about building is done as it stands, but for names."""
    for name in ("cmake", "pkg-config"):
        tool(name)
    page = (ROOT / "docs" / "process-image.md").read_text()
    section = page.split("\n## Build\n")[1].split("\n## ")[0]

    def blocks(language: str, text: str) -> list[str]:
        return re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)

    static, shared, cmake, alone = blocks("sh", section)
    (project,) = blocks("cmake", section)
    (program,) = blocks("c", page)
    (tmp_path / "blink.c").write_text(program.replace('"ecat0"', '"nobody"'))
    (tmp_path / "CMakeLists.txt").write_text(project)
    (tmp_path / "client_c").symlink_to(CLIENT)
    ecatctl = tmp_path / "bin" / "ecatctl"
    ecatctl.parent.mkdir()
    ecatctl.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m ecatd.cli "$@"\n')
    ecatctl.chmod(0o755)
    env = {name: value for name, value in os.environ.items() if name != "LD_LIBRARY_PATH"} | {
        "PYTHONPATH": str(wheel),
        "PATH": f"{ecatctl.parent}:{Path(sys.executable).parent}:{os.environ['PATH']}",
    }

    def follow(line: str, built: str) -> str:
        script = f"set -e\n{line}\n{built}"
        done = subprocess.run(
            ["sh", "-c", script], cwd=tmp_path, env=env, text=True, capture_output=True, check=False
        )
        return done.stdout + done.stderr

    for line, built in ((static, "./blink"), (shared, "./blink"), (cmake, "build/blink")):
        assert "'nobody'" in follow(line, built), line
    (tmp_path / "build").rename(tmp_path / "done")
    elsewhere = alone.replace("/usr/local", str(tmp_path / "local"))
    installed = follow(elsewhere, f"ls {tmp_path}/local/include/ecat {tmp_path}/local/lib")
    assert {"ecat.h", "ecat.hpp", "libecat.a", "libecat.so"} <= set(installed.split())


def test_the_command_says_all_at_once_to_programs(wheel: Path) -> None:
    command = (sys.executable, "-m", "ecatd.cli", "client-flags")
    text = run(*command, "--json", env={"PYTHONPATH": str(wheel)})
    for option in ("--cmake-dir", "--pkg-config-dir"):
        assert run(*command, option, env={"PYTHONPATH": str(wheel)}).strip() in text
    both = run_module("ecatd.cli", "client-flags", "--cmake-dir", "--pkg-config-dir")
    assert both.returncode == 2


def test_the_version_is_that_of_ecatd(prefix: Path) -> None:
    assert f"VERSION {VERSION} " in (ROOT / "CMakeLists.txt").read_text()
    assert f"\nVersion: {VERSION}\n" in (prefix / "lib/pkgconfig/ecat.pc").read_text()
    interface = ".".join(VERSION.split(".")[:2])
    soname = re.search(r"SONAME.*\[(.*)\]", run("readelf", "-d", prefix / "lib/libecat.so"))
    assert soname
    assert soname[1] == f"libecat.so.{interface}"


def test_the_library_exports_its_interface_and_nothing_else(prefix: Path) -> None:
    names = run("nm", "-D", "--defined-only", prefix / "lib" / "libecat.so")
    exported = {line.split()[-1] for line in names.splitlines()}
    declared = set()
    for header in (CLIENT / "include" / "ecat").glob("*.h"):
        text = header.read_text()
        declared |= set(re.findall(r"^ECAT(?:_SHM)?_API [\w *]*?\b(ecat_\w+)\(", text, re.M))
    assert "ecat_open" in declared
    assert exported == declared

"""Templates of the user, by options and in the standard folder."""

from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess

import pytest

from conftest import names, one_line_error, run_module
from ecatd.description import bus_file
from ecatdev import sample_buses

Generate = Callable[..., CompletedProcess[str]]


@pytest.fixture
def generate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Generate:
    """Runs `ecatctl generate` on a saved scan, with an empty folder as that of the user."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    scan = tmp_path / "bus.json"
    scan.write_text(bus_file.dump(sample_buses.troll()))

    def run(*options: str) -> CompletedProcess[str]:
        where = ("P", str(tmp_path / "out"), "--from", str(scan))
        return run_module("ecatd.cli", "generate", *where, *options)

    return run


def folder(path: Path, name: str, text: str) -> str:
    path.mkdir(parents=True, exist_ok=True)
    (path / name).write_text(text)
    return str(path)


def test_templates_replace_files(generate: Generate, tmp_path: Path) -> None:
    standard = tmp_path / "config" / "ecatd" / "templates"
    folder(standard, "users_guide.mo.j2", "standard\n")
    folder(standard, "examples.mo.j2", "standard\n")
    given = folder(tmp_path / "one", "users_guide.mo.j2", "given {{ library.bus | string }}\n")
    assert generate("--templates", given).returncode == 0
    library = tmp_path / "out" / "P"
    assert (library / "UsersGuide.mo").read_text() == 'given "ecat0"\n'
    assert (library / "Examples" / "package.mo").read_text() == "standard\n"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--templates", "nowhere"), "nowhere | folder"),
        (("--templates", ".", "--fmu"), "--templates | --fmu"),
    ],
)
def test_wrong_folders_are_one_sentence(
    generate: Generate, options: tuple[str, ...], message: str
) -> None:
    done = generate(*options)
    assert done.returncode == 2
    names(one_line_error(done.stderr, "ecatctl"), *message.split(" | "))

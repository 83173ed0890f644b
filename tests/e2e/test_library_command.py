"""`ecatctl library`: the static library alone, for people who write their own blocks."""

import json
import os
import re
from pathlib import Path

import pytest

from conftest import names, one_line_error, run_module
from ecatgen.static_library import VERSION
from openmodelica import OpenModelica, at_home, needs_omc

FOLDER = f"EtherCAT {VERSION}"


def test_the_library_is_complete_and_has_its_version(tmp_path: Path) -> None:
    result = run_module("ecatd.cli", "library", str(tmp_path / "new" / "folder"))
    assert result.returncode == 0, result.stderr
    library = tmp_path / "new" / "folder" / FOLDER
    assert f"open {library / 'package.mo'} in a Modelica tool" in result.stdout
    (version,) = re.findall(r'\bversion = "([\d.]+)",\n', (library / "package.mo").read_text())
    assert version == VERSION
    assert (library / "Resources" / "Include" / "ecat" / "ecat.h").is_file()
    assert list((library / "Resources" / "Library").rglob("libecat.a"))


def test_a_second_run_changes_nothing_and_loses_nothing(tmp_path: Path) -> None:
    run_module("ecatd.cli", "library", str(tmp_path))
    mine = tmp_path / FOLDER / "UsersGuide" / "package.mo"
    again = json.loads(run_module("ecatd.cli", "library", str(tmp_path), "--json").stdout)
    assert again["written"] == again["removed"] == []
    mine.write_text("mine")
    refused = run_module("ecatd.cli", "library", str(tmp_path))
    assert refused.returncode == 7
    assert "UsersGuide/package.mo" in one_line_error(refused.stderr, "ecatctl")
    assert mine.read_text() == "mine"
    assert run_module("ecatd.cli", "library", str(tmp_path), "--check").returncode == 1
    forced = run_module("ecatd.cli", "library", str(tmp_path), "--force")
    assert forced.returncode == 0, forced.stderr
    assert mine.with_name("package.mo.orig").read_text() == "mine"
    assert run_module("ecatd.cli", "library", str(tmp_path), "--check").returncode == 0


@pytest.mark.parametrize("arguments", [(), ("folder", "--openmodelica")])
def test_one_place_must_be_said(tmp_path: Path, arguments: tuple[str, ...]) -> None:
    result = run_module(
        "ecatd.cli", "library", *arguments, env={**os.environ, "HOME": str(tmp_path)}
    )
    assert result.returncode == 2
    names(one_line_error(result.stderr, "ecatctl"), "DIR", "--openmodelica")
    assert not list(tmp_path.iterdir())


def test_for_openmodelica(tmp_path: Path) -> None:
    result = run_module("ecatd.cli", "library", "--openmodelica", env=at_home(tmp_path))
    assert result.returncode == 0, result.stderr
    assert (tmp_path / ".openmodelica" / "libraries" / FOLDER / "package.mo").is_file()


@pytest.mark.parametrize(
    ("variable", "folder"),
    [
        ("{0}/locked/none:{0}/mine:{0}/other", "mine"),
        ("{0}/mine:{0}/home/.openmodelica/libraries", "home/.openmodelica/libraries"),
        ("", "home/.openmodelica/libraries"),
        ("{0}/locked/none", None),
    ],
)
def test_the_folders_of_openmodelica_are_those_of_its_variable(
    tmp_path: Path, variable: str, folder: str | None
) -> None:
    for name in ("mine", "other"):
        (tmp_path / name).mkdir()
    env = os.environ | {
        "HOME": str(tmp_path / "home"),
        "OPENMODELICALIBRARY": variable.format(tmp_path),
    }
    result = run_module("ecatd.cli", "library", "--openmodelica", env=env)
    if folder is None:
        assert result.returncode == 6
        names(one_line_error(result.stderr, "ecatctl"), "OPENMODELICALIBRARY", "folder")
        return
    assert result.returncode == 0, result.stderr
    assert (tmp_path / folder / FOLDER / "package.mo").is_file()


@needs_omc
def test_openmodelica_finds_it(tmp_path: Path) -> None:
    """Also when it loads a library that uses it."""
    omc = OpenModelica(tmp_path, tmp_path)
    folder = tmp_path / "home" / ".openmodelica" / "libraries"
    folder.mkdir(parents=True)
    where = omc.script("getModelicaPath();").strip().strip('"')
    for library in (item for path in where.split(":") for item in Path(path).glob("*")):
        if not library.name.startswith("EtherCAT") and not (folder / library.name).exists():
            (folder / library.name).symlink_to(library)
    env = at_home(tmp_path / "home")
    assert run_module("ecatd.cli", "library", "--openmodelica", env=env).returncode == 0
    user = tmp_path / "User.mo"
    user.write_text(
        "package User\n"
        "  model M\n"
        "    extends EtherCAT.Examples.DigitalIO;\n"
        "  end M;\n"
        f'  annotation (uses(EtherCAT(version = "{VERSION}")));\n'
        "end User;\n"
    )
    load = "loadModel(EtherCAT); checkModel(EtherCAT.Examples.DigitalIO);"
    answer = omc.script(load, "getErrorString();", home=tmp_path / "home")
    assert "Check of EtherCAT.Examples.DigitalIO completed successfully" in answer, answer
    answer = omc.script(f'loadFile("{user}");', "checkModel(User.M);", home=tmp_path / "home")
    assert "Check of User.M completed successfully" in answer, answer

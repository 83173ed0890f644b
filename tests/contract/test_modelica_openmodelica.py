"""The libraries in OpenModelica, wherever it is installed: every class is checked."""

import shlex
import sys
from pathlib import Path

import pytest

from conftest import Daemon
from ecatdev import sample_buses
from ecatgen import generate
from openmodelica import OpenModelica, needs_omc

pytestmark = [needs_omc, pytest.mark.long, pytest.mark.timeout(900)]


@pytest.fixture(scope="module", params=sample_buses.ALL)
def omc(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> OpenModelica:
    folder = tmp_path_factory.mktemp(request.param)
    generate(sample_buses.ALL[request.param](), "Plant", folder / "libraries")
    return OpenModelica(folder, folder / "libraries", "Plant")


def test_every_class_of_a_generated_library_is_sound(omc: OpenModelica) -> None:
    classes = omc.classes("Plant")
    assert "Plant.Examples.AllSlaves" in classes
    assert list(omc.findings(classes)) == []


def test_every_class_of_the_static_library_is_sound(tmp_path: Path) -> None:
    generate(sample_buses.troll(), "Plant", tmp_path / "libraries")
    omc = OpenModelica(tmp_path, tmp_path / "libraries", "Plant")
    classes = omc.classes("EtherCAT")
    for name in ("EtherCATMaster", "Objects.PDO", "Functions.commit", "Examples.DigitalIO"):
        assert f"EtherCAT.{name}" in classes
    assert list(omc.findings(classes)) == []


@pytest.mark.parametrize("library", ["EtherCAT", "Plant"])
def test_the_old_front_end_has_no_complaints(tmp_path: Path, library: str) -> None:
    generate(sample_buses.troll(), "Plant", tmp_path / "libraries")
    omc = OpenModelica(tmp_path, tmp_path / "libraries", "Plant", old_front_end=True)
    classes = omc.classes(library)
    assert {"EtherCAT.EtherCATMaster", "Plant.Drives.GoldGCONDrive"} & set(classes)
    assert list(omc.findings(classes)) == []


def test_classes_of_the_user_are_part_of_the_library(tmp_path: Path) -> None:
    plant = tmp_path / "libraries" / "Plant"
    generate(sample_buses.troll(), "Plant", plant.parent)
    (plant / "Own").mkdir()
    (plant / "Own" / "package.mo").write_text('within Plant;\npackage Own "mine"\nend Own;\n')
    for folder, name in ((plant, "Mine"), (plant / "Examples", "Test")):
        within = "Plant" if folder == plant else "Plant.Examples"
        text = f'within {within};\nmodel {name} "mine"\n  Real x = time;\nend {name};\n'
        (folder / f"{name}.mo").write_text(text)
    generate(sample_buses.troll(), "Plant", plant.parent)
    omc = OpenModelica(tmp_path, plant.parent, "Plant")
    assert "EL6751_2, Mine, Own}" in omc.run("getClassNames(Plant);")
    assert list(omc.findings(["Plant.Mine", "Plant.Examples.Test"])) == []


@pytest.mark.parametrize(
    ("file", "old", "new", "problem"),
    [
        ("EL1018.mo", "readBoolean", "readBool", "readBool"),
        ("EL1018.mo", "BooleanOutput", "RealOutput", "Type mismatch"),
        ("Examples/AllSlaves.mo", "el2008.channel1Output", "el2008.channel9Output", "channel9"),
    ],
)
def test_the_check_sees(tmp_path: Path, file: str, old: str, new: str, problem: str) -> None:
    generate(sample_buses.troll(), "Plant", tmp_path / "libraries")
    path = tmp_path / "libraries" / "Plant" / file
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    omc = OpenModelica(tmp_path, tmp_path / "libraries", "Plant")
    name = f"Plant.{file.removesuffix('.mo').replace('/', '.')}"
    assert problem in "\n".join(omc.findings([name]))


@pytest.mark.bus
def test_a_library_is_generated_and_loaded_in_one_session(troll: Daemon, tmp_path: Path) -> None:
    """The commands that the documentation of generateConfiguration has for OpenModelica."""
    generate(sample_buses.troll(), "Plant", tmp_path / "libraries")
    program = tmp_path / "ecatctl"
    program.write_text(
        "#!/bin/sh\n"
        f"export ECATD_RUNTIME_DIR={shlex.quote(troll.env['ECATD_RUNTIME_DIR'])}\n"
        f'exec {shlex.quote(sys.executable)} -m ecatd.cli "$@"\n'
    )
    program.chmod(0o755)
    omc = OpenModelica(tmp_path, tmp_path / "libraries", "Plant")
    out = tmp_path / "my models"
    answer = omc.run(
        'setCommandLineOptions("-d=gen");',
        f'file := EtherCAT.generateConfiguration("Live", "{out}", "{troll.bus}", "{program}");',
        "loadFile(file);",
        "checkModel(Live.Examples.AllSlaves);",
    )
    assert f'"{out}/Live/package.mo"' in answer, answer
    assert "Check of Live.Examples.AllSlaves completed successfully" in answer, answer

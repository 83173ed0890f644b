"""The library as Modelica: all that can be checked without a Modelica tool."""

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymoca.parser import parse

from ecatd.config.meanings import give_meanings
from ecatd.config.profiles import load_profiles
from ecatd.description.bus import Bus, Slave
from ecatd.etg.pdo import Entry, Pdo
from ecatdev import sample_buses
from ecatdev.checks import check_externals, check_structure, check_syntax, check_translation
from ecatgen import generate
from ecatgen.build import build_library
from ecatgen.render import render

pytestmark = pytest.mark.long


LIBRARY = "Plant"


@pytest.fixture(scope="module", params=sample_buses.ALL)
def out(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp(request.param)
    generate(sample_buses.ALL[request.param](), LIBRARY, folder)
    return folder


@pytest.fixture
def troll(tmp_path: Path) -> Path:
    generate(sample_buses.troll(), LIBRARY, tmp_path)
    return tmp_path


def examples(out: Path) -> Iterator[str]:
    for library in ("EtherCAT", LIBRARY):
        for file in sorted((out / library / "Examples").glob("*.mo")):
            if file.name != "package.mo":
                yield f"{library}.Examples.{file.stem}"


def test_files_names_and_texts(out: Path) -> None:
    assert list(check_structure(out / "EtherCAT")) == []
    assert list(check_structure(out / LIBRARY)) == []


def test_a_parser_reads_every_file(out: Path) -> None:
    assert list(check_syntax(out / "EtherCAT")) == []
    assert list(check_syntax(out / LIBRARY)) == []


def test_a_compiler_resolves_names_checks_types_and_counts_equations(out: Path) -> None:
    models = list(examples(out))
    assert f"{LIBRARY}.Examples.AllSlaves" in models
    assert list(check_translation(out, models)) == []


@settings(max_examples=15)
@given(st.text(max_size=220), st.text(max_size=220))
def test_any_name_of_a_slave_or_an_entry_gives_modelica(slave: str, entry: str) -> None:
    entries = [Entry(0x6000, n, entry, 5, 8) for n in (1, 2)]
    bus = Bus(slave, 1000, [Slave(0, slave, 1, 2, 3, inputs=[Pdo(0x1A00, slave, 3, entries)])])
    for path, data in render(build_library(give_meanings(bus, load_profiles()), "Plant")).items():
        if path.endswith(".mo"):
            assert parse(data.decode()) is not None


def test_external_functions_are_those_of_the_header_in_c89(troll: Path) -> None:
    assert list(check_externals(troll / "EtherCAT")) == []


def test_the_calls_for_c_are_c89(out: Path, compiler: str) -> None:
    resources = out / "EtherCAT" / "Resources"
    done = subprocess.run(
        [
            *(compiler, "-std=c89", "-pedantic-errors", "-Wall", "-Wextra", "-Werror"),
            *("-I", str(resources / "Include")),
            *("-I", str(resources / "Source" / "standalone")),
            *("-fsyntax-only", "-x", "c", str(out / LIBRARY / "Resources" / "Source" / "Plant.h")),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_package_order_is_not_the_order_of_the_alphabet(troll: Path) -> None:
    order = (troll / LIBRARY / "package.order").read_text().split()
    assert order[:5] == ["UsersGuide", "Examples", "Drives", "Channels", "GoldGCONDrive"]
    assert order[-2:] == ["fingerprint", "generateCommand"]


def edit(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))


@pytest.mark.parametrize(
    ("file", "old", "new", "problem"),
    [
        ("EL1018.mo", "within Plant;", "within Plants;", "within 'Plants'"),
        ("EL1018.mo", "within Plant;\n", "", "does not begin with a within clause"),
        ("EL1018.mo", "block EL1018 ", "block EL1019 ", "defines EL1019"),
        ("EL1018.mo", "end EL1018;", "end EL1019;", "does not end with"),
        ("EL1018.mo", "</table>", "", "HTML closes <html>"),
        ("package.mo", "Plant.Examples", "Plant.Nowhere", "Plant.Nowhere does not exist"),
        ("package.order", "EL1018\n", "", "lacks EL1018"),
        ("package.order", "EL1018\n", "EL1018\nEL1019\n", "has EL1019, which does not exist"),
        ("package.order", "EL1018\n", "EL1018\nEL1018\n", "not at all"),
    ],
)
def test_the_check_of_files_sees(troll: Path, file: str, old: str, new: str, problem: str) -> None:
    edit(troll / LIBRARY / file, old, new)
    assert problem in "\n".join(check_structure(troll / LIBRARY))


@pytest.mark.parametrize(
    ("file", "old", "new", "problem"),
    [
        ("EL1018.mo", "when sampled", "when sampld", "sampld"),
        ("EL1018.mo", "readBoolean", "readBool", "readBool"),
        ("EL1018.mo", "BooleanOutput", "RealOutput", "channel1Input"),
        ("EL1018.mo", "    channel2Input = EtherCAT", "    channel1Input = EtherCAT", ""),
        ("Examples/AllSlaves.mo", "el2008.channel1Output", "el2008.channel9Output", "channel9"),
    ],
)
def test_the_translation_sees(troll: Path, file: str, old: str, new: str, problem: str) -> None:
    edit(troll / LIBRARY / file, old, new)
    problems = "\n".join(check_translation(troll, [f"{LIBRARY}.Examples.AllSlaves"]))
    assert problems
    assert problem in problems


@pytest.mark.parametrize(
    ("file", "old", "new", "named"),
    [
        ("Functions/readReal.mo", "input Real t", "input Integer t", "readReal.mo: readReal: "),
        ("Functions/readReal.mo", "output Real y", "output Integer y", "readReal.mo: readReal: "),
        ("Functions/commit.mo", "t, order)", "t)", "EtherCAT/Functions/commit.mo: commit: "),
        ("Objects/PDO.mo", "ecatm_pdo_close", "ecatm_pdo_shut", "PDO.mo: destructor: "),
        ("Resources/Include/ecatm_samples.h", "int ecatm_wait(", "long ecatm_wait(", "waitCycle: "),
        ("Resources/Include/ecat_modelica.h", "#endif\n", "#endif // not C89\n", "modelica.h: "),
        ("Resources/Include/ecat_modelica.h", '"ecatm_sdo.h"', '"ecatm_s.h"', "ecatm_s.h: No such"),
    ],
)
def test_the_check_of_external_functions_sees(
    troll: Path, file: str, old: str, new: str, named: str
) -> None:
    edit(troll / "EtherCAT" / file, old, new)
    assert named in next(check_externals(troll / "EtherCAT"))


def test_the_parser_sees(troll: Path) -> None:
    edit(troll / LIBRARY / "EL1018.mo", "equation", "equatin")
    assert list(check_syntax(troll / LIBRARY))


def test_there_must_be_external_functions(tmp_path: Path) -> None:
    assert "has no external functions" in next(check_externals(tmp_path))


def test_there_must_be_a_compiler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda _: None)
    assert "no C compiler" in next(check_externals(tmp_path))

"""FMUs as files: valid, always the same bytes, complete, and never over a file of somebody else."""

import re
import subprocess
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

pytest.importorskip("fmpy", reason="FMPy is not installed (extra 'test')")

import fmpy
from fmpy import extract, read_model_description
from fmpy.validation import validate_fmu
from lxml import etree

from conftest import names, naming, one_line_error, run_module
from ecatd.base.errors import StateError
from ecatd.config.meanings import give_meanings
from ecatd.config.profiles import load_profiles
from ecatd.description.bus import Bus
from ecatdev import sample_buses
from ecatgen.build import build_library
from ecatgen.fmu import FmuReport, generate_fmu

pytestmark = pytest.mark.long

Make = Callable[[Callable[[], Bus], int], FmuReport]

BUSES = (sample_buses.troll, sample_buses.awkward)
VERSIONS = pytest.mark.parametrize("fmi", [2, 3])


@pytest.fixture(scope="module")
def make(tmp_path_factory: pytest.TempPathFactory) -> Make:
    """Makes the FMU of a bus, once for all tests that only read it."""

    @cache
    def make(bus: Callable[[], Bus], fmi: int) -> FmuReport:
        return generate_fmu(bus(), "Plant", tmp_path_factory.mktemp("fmu"), fmi)

    return make


def headers(folder: Path, fmi: int) -> set[str]:
    """The functions that the standard declares for co-simulation."""
    text = (folder / "sources" / "fmi" / f"fmi{fmi}Functions.h").read_text()
    exchange = text.find("for FMI2 for Model Exchange"), text.find("for FMI2 for Co-Simulation")
    if fmi == 2:  # functions of another interface may be left out
        text = text[: exchange[0]] + text[exchange[1] :]
    return set(re.findall(rf"^#define (fmi{fmi}[A-Z]\w+) +fmi{fmi}FullName", text, re.MULTILINE))


def symbols(library: Path) -> set[str]:
    """What a shared library shows to others."""
    listed = subprocess.run(
        ["nm", "-D", "--defined-only", str(library)], capture_output=True, text=True, check=True
    )
    return {line.split()[-1] for line in listed.stdout.splitlines()}


@VERSIONS
@pytest.mark.parametrize("bus", BUSES)
def test_fmpy_finds_nothing_wrong(bus: Callable[[], Bus], fmi: int, make: Make) -> None:
    """It checks the schema, names, units, start values and the model structure."""
    report = make(bus, fmi)
    assert validate_fmu(str(report.fmu)) == []
    description = read_model_description(str(report.fmu))
    assert description.fmiVersion == f"{fmi}.0"
    assert description.variableNamingConvention == "structured"
    assert float(description.defaultExperiment.stepSize) == bus().cycle_time_us / 1e6
    causes = [item.causality for item in description.modelVariables]
    assert (causes.count("input"), causes.count("output")) == (report.inputs, report.outputs)


def test_terminals_and_build_description_fit_their_schemas(make: Make, tmp_path: Path) -> None:
    """Each slave is a terminal of an FMU for FMI 3.0."""
    folder = Path(extract(str(make(sample_buses.awkward, 3).fmu), str(tmp_path / "plant")))
    schemas = Path(fmpy.__file__).parent / "schema" / "fmi3"
    build = etree.parse(folder / "sources" / "buildDescription.xml")
    etree.XMLSchema(etree.parse(schemas / "fmi3BuildDescription.xsd")).assertValid(build)
    terminals = etree.parse(folder / "terminalsAndIcons" / "terminalsAndIcons.xml")
    etree.XMLSchema(etree.parse(schemas / "fmi3TerminalsAndIcons.xsd")).assertValid(terminals)
    assert len(list(terminals.iter("Terminal"))) == len(sample_buses.awkward().slaves)


@VERSIONS
@pytest.mark.parametrize("bus", BUSES)
def test_names_are_those_of_the_library(bus: Callable[[], Bus], fmi: int, make: Make) -> None:
    description = read_model_description(str(make(bus, fmi).fmu))
    causality = {item.name: item.causality for item in description.modelVariables}
    for block in build_library(give_meanings(bus(), load_profiles()), "Plant").blocks:
        for connector in block.writes:
            assert causality.pop(f"{block.instance}.{connector.name}") == "input"
        for connector in block.reads:
            assert causality.pop(f"{block.instance}.{connector.name}") == "output"
        for name in ("valid", "alState", "alStatusCode"):
            assert causality.pop(f"{block.instance}.{name}") == "output"
    assert not [name for name in causality if "." in name]


@VERSIONS
def test_the_same_bus_gives_the_same_bytes(fmi: int, tmp_path: Path) -> None:
    one = generate_fmu(sample_buses.troll(), "Plant", tmp_path / "one", fmi)
    two = generate_fmu(sample_buses.troll(), "Plant", tmp_path / "two", fmi)
    assert one.fmu.read_bytes() == two.fmu.read_bytes()
    assert one.is_change
    assert not generate_fmu(sample_buses.troll(), "Plant", tmp_path / "one", fmi).is_change
    other = sample_buses.troll()
    other.slaves[3].outputs[0].entries[0].name = "Lamp"
    before, content = read_model_description(str(one.fmu)), one.fmu.read_bytes()
    would = generate_fmu(other, "Plant", tmp_path / "one", fmi, check=True)
    assert (would.is_change, one.fmu.read_bytes()) == (True, content)
    again = generate_fmu(other, "Plant", tmp_path / "one", fmi)
    assert again.differences == would.differences
    assert again.details()[0] == (
        "slave 3 EL2008: connector channel1Output is now called lamp (output 0x7000:01)"
    )
    after = read_model_description(str(again.fmu))
    token = "guid" if fmi == 2 else "instantiationToken"
    assert getattr(before, token) != getattr(after, token)
    assert [path.name for path in (tmp_path / "one").iterdir()] == ["Plant.fmu"]


def test_another_fmu_of_the_same_bus_is_told_as_such(tmp_path: Path) -> None:
    assert generate_fmu(sample_buses.troll(), "Plant", tmp_path, 2).details() == []
    report = generate_fmu(sample_buses.troll(), "Plant", tmp_path, 3, check=True)
    assert report.to_dict()["generator"] is True
    (line,) = report.details()
    names(line, "the bus is the same", "version")
    assert generate_fmu(sample_buses.troll(), "Plant", tmp_path, 2).to_dict()["generator"] is False


def test_files_of_others_are_kept(tmp_path: Path) -> None:
    file = tmp_path / "Plant.fmu"
    generate_fmu(sample_buses.troll(), "Plant", tmp_path)
    ours = file.read_bytes()
    with zipfile.ZipFile(file, "a") as archive:
        archive.writestr("binaries/win64/Plant.dll", "compiled by the user")
    changed = file.read_bytes()
    for content in (changed, b"", b"my plant", changed[:-100], ours + b"mine", b"mine" + ours):
        file.write_bytes(content)
        with pytest.raises(StateError, match=naming(file, "not made", "changed")):
            generate_fmu(sample_buses.awkward(), "Plant", tmp_path)
        assert file.read_bytes() == content
    file.unlink()
    file.mkdir()
    with pytest.raises(StateError, match=naming(file, "not made")):
        generate_fmu(sample_buses.troll(), "Plant", tmp_path)
    (tmp_path / "file").touch()
    with pytest.raises(StateError, match=naming(tmp_path / "file", "not a directory")):
        generate_fmu(sample_buses.troll(), "Plant", tmp_path / "file")


@VERSIONS
def test_the_binary_needs_nothing_and_shows_nothing_else(
    fmi: int, make: Make, tmp_path: Path
) -> None:
    folder = Path(extract(str(make(sample_buses.troll, fmi).fmu), str(tmp_path / "plant")))
    (binary,) = (folder / "binaries").rglob("Plant.so")
    assert symbols(binary) >= headers(folder, fmi)
    assert all(name.startswith(f"fmi{fmi}") for name in symbols(binary))
    listed = subprocess.run(["objdump", "-p", str(binary)], capture_output=True, text=True).stdout
    assert set(re.findall(r"NEEDED +(\S+)", listed)) <= {"libc.so.6", "libm.so.6"}
    assert "RPATH" not in listed
    assert "RUNPATH" not in listed


def stated(folder: Path, fmi: int) -> tuple[list[str], list[str]]:
    """Source files, and the options that the FMU says they need."""
    if fmi == 2:
        root = ET.parse(folder / "modelDescription.xml").getroot()
        return [str(item.get("name")) for item in root.iter("File")], ["-I."]
    root = ET.parse(folder / "sources" / "buildDescription.xml").getroot()
    (group,) = root.iter("SourceFileSet")
    options = [f"-std={str(group.get('language')).lower()}"]
    options += [f"-D{i.get('name')}={i.get('value')}" for i in group.iter("PreprocessorDefinition")]
    options += [f"-I{item.get('name')}" for item in group.iter("IncludeDirectory")]
    return [str(item.get("name")) for item in group.iter("SourceFile")], options


@VERSIONS
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_the_sources_make_the_binary(compiler: str, fmi: int, make: Make, tmp_path: Path) -> None:
    folder = Path(extract(str(make(sample_buses.troll, fmi).fmu), str(tmp_path / "plant")))
    sources, options = stated(folder, fmi)
    done = subprocess.run(
        [
            *(compiler, "-shared", "-fPIC", "-Wall", "-Wextra", "-Werror", *options, *sources),
            *("-lm", "-Wl,-z,defs", "-o", str(tmp_path / "plant.so")),
        ],
        cwd=folder / "sources",
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert symbols(tmp_path / "plant.so") >= headers(folder, fmi)


def test_wrong_options(tmp_path: Path) -> None:
    for options in (
        *(["--fmi", "3"], ["--fmu", "--fmi", "4"], ["--fmu", "--force"]),
        *(["--ls-bus-ecus", "2"], ["--ls-bus-clock", "triggered"], ["--ls-bus", "6", "--fmu"]),
        *(["--ls-bus", "6", "--force"], ["--ls-bus", "6", "--can", "6=x.dbc"]),
    ):
        result = run_module("ecatd.cli", "generate", "Plant", str(tmp_path), *options)
        assert result.returncode == 2
        assert not result.stdout
    result = run_module("ecatd.cli", "generate", "Plant", str(tmp_path), "--fmi", "3")
    names(one_line_error(result.stderr, "ecatctl"), "--fmi", "--fmu")
    assert list(tmp_path.iterdir()) == []

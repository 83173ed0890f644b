"""The conventions of the Modelica Standard Library, in every class of our libraries."""

from pathlib import Path

import pytest

from ecatdev import sample_buses
from ecatdev.checks import check_conventions
from ecatgen import generate


@pytest.mark.parametrize("bus", sample_buses.ALL)
def test_generated_libraries(tmp_path: Path, bus: str) -> None:
    generate(sample_buses.ALL[bus](), "Plant", tmp_path)
    assert list(check_conventions(tmp_path / "Plant")) == []


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("out")
    generate(sample_buses.troll(), "Plant", folder)
    return folder


def test_the_static_library(out: Path) -> None:
    assert list(check_conventions(out / "EtherCAT")) == []


@pytest.mark.parametrize(
    ("file", "old", "new", "problem"),
    [
        (
            "SynchronizeRealtime.mo",
            ' "Pace a model without a bus by the clock of the machine"',
            "",
            "SynchronizeRealtime has no description",
        ),
        ("SynchronizeRealtime.mo", "clock of the machine", "clock.", "full stop"),
        ("SynchronizeRealtime.mo", "Boolean enable =", "Boolean Enable =", "Enable is not a name"),
        (
            "SynchronizeRealtime.mo",
            "choices(checkBox = true), ",
            "",
            "setPriority has no check box",
        ),
        (
            "SynchronizeRealtime.mo",
            'defaultComponentName = "synchronizeRealtime",',
            "",
            "has no defaultComponentName",
        ),
        ("Examples/DigitalIO.mo", "experiment(StopTime = 3, Interval = 0.001),", "", "stop time"),
        ("Functions/commit.mo", "  extends Modelica.Icons.Function;\n", "", "icon for a function"),
        ("Functions/commit.mo", "Documentation(info", "Document(info", "has no documentation"),
        ("Functions/commit.mo", ' "Equal to order"', "", "commit.done has no description"),
        ("Objects/PDO.mo", 'pdo "Entry"', "pdo", "constructor.pdo has no description"),
        ("Types/AnalogRange.mo", "  extends Modelica.Icons.Record;\n", "", "icon for a record"),
    ],
)
def test_the_check_sees(
    tmp_path: Path, out: Path, file: str, old: str, new: str, problem: str
) -> None:
    source = (out / "EtherCAT" / file).read_text()
    assert old in source
    copy = tmp_path / "EtherCAT" / file
    copy.parent.mkdir(parents=True)
    copy.write_text(source.replace(old, new, 1))
    assert problem in "\n".join(check_conventions(tmp_path / "EtherCAT"))

"""The files of an FMU with bus terminals (FMI-LS-BUS): as the standards say, and by their names."""

import json
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path

import pytest

pytest.importorskip("fmpy", reason="FMPy is not installed (extra 'test')")

import fmpy
from fmpy.validation import validate_fmu

from conftest import names, one_line_error, run_module

LS = "{http://fmi-standard.org/fmi-ls-manifest}"


def generate(out: Path, *options: str, status: int = 0) -> str:
    result = run_module(
        "ecatd.cli", "generate", "CanBus", str(out), "--from", "troll-can", *options
    )
    assert result.returncode == status, result.stderr
    return result.stdout if status == 0 else one_line_error(result.stderr, "ecatctl")


def read(fmu: Path, name: str) -> ET.Element:
    with zipfile.ZipFile(fmu) as archive:
        return ET.fromstring(archive.read(name))


@pytest.mark.parametrize("clock", ["countdown", "triggered"])
def test_bus_terminals(clock: str, tmp_path: Path) -> None:
    said = generate(tmp_path, "--ls-bus", "6", "--ls-bus-ecus", "2", "--ls-bus-clock", clock)
    names(said, "2 bus terminals", "EL6751", "written")
    fmu = tmp_path / "CanBus.fmu"
    assert validate_fmu(str(fmu)) == []
    manifest = read(fmu, "extra/org.fmi-standard.fmi-ls-bus/fmi-ls-manifest.xml")
    assert manifest.get("isBusSimulationFMU") == "true"
    assert manifest.get(f"{LS}fmi-ls-name") == "org.fmi-standard.fmi-ls-bus"
    assert manifest.get(f"{LS}fmi-ls-version") == "1.0.0"
    variables = {item.name: item for item in fmpy.read_model_description(str(fmu)).modelVariables}
    terminals = read(fmu, "terminalsAndIcons/terminalsAndIcons.xml").findall("Terminals/Terminal")
    buses = [item for item in terminals if item.get("terminalKind")]
    assert [item.get("name") for item in buses] == ["Ecu1", "Ecu2"]
    for bus in buses:
        assert bus.get("terminalKind") == "org.fmi-ls-bus.network-terminal"
        assert bus.get("matchingRule") == "org.fmi-ls-bus.transceiver"
        of = {
            item.get("memberName"): variables[item.get("variableName", "")]
            for item in bus.findall("TerminalMemberVariable")
        }
        assert set(of) == {"Rx_Data", "Rx_Clock", "Tx_Data", "Tx_Clock"}
        for end in ("Rx", "Tx"):
            assert of[f"{end}_Data"].clocks == [of[f"{end}_Clock"]]
        assert of["Tx_Data"].causality == "output"
        assert (of["Rx_Clock"].causality, of["Rx_Clock"].intervalVariability) == (
            *("input", "triggered"),
        )
        assert of["Tx_Clock"].intervalVariability == clock
        assert of["Tx_Clock"].causality == ("input" if clock == "countdown" else "output")
        (notified,) = bus.findall("Terminal/TerminalMemberVariable")
        assert notified.get("memberName") == "BusNotifications"
        flag = variables[notified.get("variableName", "")]
        assert (flag.causality, flag.variability, flag.start) == ("output", "constant", "true")
    assert ("interval" in variables) == (clock == "countdown")


def test_the_same_terminal_gives_the_same_file(tmp_path: Path) -> None:
    made = json.loads(generate(tmp_path, "--ls-bus", "7", "--json"))
    assert (made["ecus"], made["fmi"], made["changed"]) == (1, "3.0", True)
    before = (tmp_path / "CanBus.fmu").read_bytes()
    names(generate(tmp_path, "--ls-bus", "7"), "1 bus terminal", "unchanged")
    assert (tmp_path / "CanBus.fmu").read_bytes() == before
    names(generate(tmp_path, "--ls-bus", "7", "--check"), "nothing would change")
    generate(tmp_path, "--ls-bus", "7", "--ls-bus-ecus", "3")
    assert (tmp_path / "CanBus.fmu").read_bytes() != before


def test_what_cannot_be(tmp_path: Path) -> None:
    names(generate(tmp_path, "--ls-bus", "6", "--ls-bus-ecus", "17", status=2), "17", "16")
    names(generate(tmp_path, "--ls-bus", "6", "--ls-bus-ecus", "0", status=2), "0", "16")
    names(generate(tmp_path, "--ls-bus", "99", status=7), "99")
    names(generate(tmp_path, "--ls-bus", "EL6751", status=7), "EL6751", "position")
    assert list(tmp_path.iterdir()) == []

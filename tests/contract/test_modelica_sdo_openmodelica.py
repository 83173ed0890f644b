"""The SDO blocks in OpenModelica: all six in one model, as a program and as FMU."""

from pathlib import Path

import pytest

from conftest import Daemon, names
from ecatdev import sample_buses
from ecatgen import generate
from openmodelica import OpenModelica, needs_omc, read_csv, result_of, start

pytest_plugins = ["sdo_fixtures"]
pytestmark = [needs_omc, pytest.mark.long, pytest.mark.bus]

MODEL = Path(__file__).with_name("Requests.mo")
TOLD = """
model Told "Requests, and prints its strings"
  extends Requests;
equation
  when {readString.count >= 10, refused.abortCode > 0} then
    Modelica.Utilities.Streams.print("text '" + readString.y + "'");
    Modelica.Utilities.Streams.print("refused '" + refused.abortText + "'");
  end when;
end Told;
"""
LOAD = ('loadFile("Requests.mo");', 'loadFile("Told.mo");')
NUMBERS = {
    "readInteger.y": -42,
    "readReal.y": 3e15,
    "refused.abortCode": 0x06020000,
    "listState": 2,
}
REFUSED = "slave 0, 0x5FFF:00: SDO abort 0x06020000: The object does not exist"


@pytest.fixture
def omc(tmp_path: Path) -> OpenModelica:
    generate(sample_buses.troll(), "TrollPlant", tmp_path / "libraries")
    (tmp_path / "Requests.mo").write_text(MODEL.read_text())
    (tmp_path / "Told.mo").write_text(TOLD)
    return OpenModelica(tmp_path, tmp_path / "libraries")


def test_the_check_says_nothing(omc: OpenModelica) -> None:
    answer = omc.run(*LOAD, "getErrorString();", "checkModel(Requests);")
    assert "Check of Requests completed successfully" in answer, answer
    assert "Warning" not in answer, answer


def test_values_of_all_kinds_go_both_ways(omc: OpenModelica, tmp_path: Path, bus: Daemon) -> None:
    answer = omc.run(*LOAD, 'buildModel(Told, outputFormat = "csv");')
    program = tmp_path / "Told"
    assert program.is_file(), answer
    with start(program, 2, bus=bus.bus) as process:
        log, _ = process.communicate()
    assert process.returncode == 0, log
    last = read_csv(result_of(program))[-1]
    assert {name: last[name] for name in NUMBERS} == NUMBERS
    assert "text 'café'" in log
    assert f"refused '{REFUSED}" in log


@pytest.mark.filterwarnings("default")  # FMPy's own
def test_the_same_as_fmu(omc: OpenModelica, tmp_path: Path, bus: Daemon) -> None:
    fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
    from fmpy.fmi2 import FMU2Slave

    answer = omc.run(*LOAD, 'buildModelFMU(Told, version = "2.0", fmuType = "cs");')
    (file,) = tmp_path.glob("*.fmu")
    description = fmpy.read_model_description(str(file))  # valid, or an error
    variables = {variable.name: variable for variable in description.modelVariables}
    assert variables["readReal.y"].unit == "V", answer
    references = {name: variable.valueReference for name, variable in variables.items()}
    fmu = FMU2Slave(
        guid=description.guid,
        unzipDirectory=fmpy.extract(str(file), str(tmp_path / "fmu")),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="requests",
    )
    fmu.instantiate()
    fmu.setString([references["etherCATMaster.bus"]], [bus.bus])
    fmu.setupExperiment(startTime=0)
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    for step in range(2000):
        fmu.doStep(step * 0.001, 0.001)
    strings = fmu.getString([references["readString.y"], references["refused.abortText"]])
    reals = fmu.getReal([references["readReal.y"]])
    integers = fmu.getInteger([references["readInteger.y"], references["refused.abortCode"]])
    fmu.terminate()
    fmu.freeInstance()
    assert strings[0].decode() == "café"
    assert strings[1].decode().startswith(REFUSED)
    assert [*integers, *reals] == [-42, 0x06020000, 3e15]


def test_functions_work_in_a_session(omc: OpenModelica, bus: Daemon) -> None:
    arguments = f'"{bus.bus}", 0, "0x2006:00", EtherCAT.Types.DataType.UNSIGNED16'
    answer = omc.run(
        'setCommandLineOptions("-d=gen");',
        f"EtherCAT.Functions.writeObjectInteger({arguments}, 4711);",
        f"EtherCAT.Functions.readObjectInteger({arguments});",
        f'EtherCAT.Functions.readObjectString("{bus.bus}", 0, "0x1008", '
        "EtherCAT.Types.DataType.VISIBLE_STRING);",
        f"EtherCAT.Functions.writeObjectReal({arguments}, 70000);",
    )
    assert "\n4711\n" in answer
    assert '"Objects"' in answer
    names(answer, "0x2006:00", 70000, 0, 65535)

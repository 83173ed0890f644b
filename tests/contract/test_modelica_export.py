"""Models that OpenModelica exports as FMUs, run by FMPy, wherever both are installed."""

import statistics
from pathlib import Path

import pytest

from conftest import Daemon
from openmodelica import OpenModelica, needs_omc

fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")

pytestmark = [
    needs_omc,
    pytest.mark.long,
    pytest.mark.bus,
    pytest.mark.filterwarnings("default"),  # FMPy's own
]


@pytest.fixture
def omc(tmp_path: Path, troll: Daemon) -> OpenModelica:
    troll.ctl("generate", "TrollPlant", str(tmp_path / "libraries"))
    return OpenModelica(tmp_path, tmp_path / "libraries")


def test_the_drive_follows_the_exported_fmu(omc: OpenModelica) -> None:
    fmu = omc.export("TrollPlant.Examples.PointToPointMovement")
    rows = fmpy.simulate_fmu(
        str(fmu),
        validate=False,  # OpenModelica gives String parameters a variability that FMI does not know
        fmi_type="CoSimulation",
        stop_time=2.5,
        output_interval=0.001,
        start_values={"etherCATMaster.lease": 10.0},
        output=["w_ref", "w_m"],
    )
    top = rows[rows["time"] > 2]
    assert statistics.median(top["w_ref"]) > 0
    assert statistics.median(top["w_m"]) == pytest.approx(statistics.median(top["w_ref"]), rel=0.01)


def test_the_bus_of_an_exported_fmu_is_a_parameter(omc: OpenModelica, troll: Daemon) -> None:
    fmu = omc.export("EtherCAT.Examples.AnalogScaling")
    rows = fmpy.simulate_fmu(
        str(fmu),
        validate=False,
        fmi_type="CoSimulation",
        stop_time=1.5,  # more than a period of 0.8 Hz
        output_interval=0.001,
        start_values={"etherCATMaster.bus": troll.bus, "etherCATMaster.lease": 10.0},
        output=["el3008.y[8]"],
    )
    assert max(rows["el3008.y[8]"]) == pytest.approx(26214, rel=0.01)

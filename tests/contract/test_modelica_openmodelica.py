"""The library in OpenModelica, wherever it is installed."""

import csv
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon
from ecatgen import examples, generate
from ecatgen.checks import sample_buses

pytestmark = [
    pytest.mark.skipif(shutil.which("omc") is None, reason="omc (OpenModelica) is not on PATH"),
    pytest.mark.timeout(600),
]

MODELS = (
    "EtherCAT.Examples.ReadObject",
    "TrollPlant.Examples.AllSlaves",
    "TrollPlant.Examples.PointToPointMovement",
)

Omc = Callable[..., str]


@pytest.fixture
def omc(tmp_path: Path) -> Omc:
    """Runs OpenModelica commands with the libraries of a folder loaded; returns what it says."""

    def run(libraries: Path, *commands: str) -> str:
        script = tmp_path / "script.mos"
        load = [
            'loadModel(Modelica, {"4.0.0"});',
            f'loadFile("{libraries}/EtherCAT/package.mo");',
            f'loadFile("{libraries}/TrollPlant/package.mo");',
        ]
        script.write_text("\n".join([*load, *commands, "getErrorString();", ""]))
        done = subprocess.run(
            ["omc", str(script)], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        return done.stdout + done.stderr

    return run


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("out")
    generate(sample_buses.troll(), "TrollPlant", folder)
    return folder


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory, troll: Daemon) -> Path:
    folder = tmp_path_factory.mktemp("live")
    troll.ctl("generate", "TrollPlant", str(folder))
    return folder


@pytest.mark.parametrize("model", MODELS)
def test_models_have_as_many_equations_as_variables(omc: Omc, out: Path, model: str) -> None:
    answer = omc(out, f"checkModel({model});")
    assert f"Check of {model} completed successfully" in answer, answer


@pytest.mark.parametrize("model", MODELS)
def test_models_are_translated_and_compiled(
    omc: Omc, out: Path, tmp_path: Path, model: str
) -> None:
    answer = omc(out, f"buildModel({model});")
    assert "Error:" not in answer, answer
    assert (tmp_path / model).is_file(), answer


@pytest.mark.bus
def test_the_drive_follows_the_model(omc: Omc, live: Path, tmp_path: Path) -> None:
    answer = omc(
        live,
        f'simulate({MODELS[2]}, stopTime = 2.5, numberOfIntervals = 2500, outputFormat = "csv", '
        'fileNamePrefix = "movement");',
    )
    with (tmp_path / "movement_res.csv").open(newline="") as lines:
        rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(lines)]
    top = sorted(row["w_m"] for row in rows if row["time"] > 2)
    assert top, answer
    assert top[len(top) // 2] == pytest.approx(examples.MAX_SPEED, rel=0.01)


@pytest.mark.bus
def test_a_model_of_another_bus_fails_with_one_sentence(
    omc: Omc, start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    daemon = start_daemon(str(Path(__file__).parents[1] / "rigs" / "odd_names.py"))
    bus = sample_buses.troll()
    bus.name = daemon.bus
    generate(bus, "TrollPlant", tmp_path / "out")
    answer = omc(tmp_path / "out", f"simulate({MODELS[1]}, stopTime = 0.1);")
    assert "but this library was generated for" in answer  # which slave comes first is omc's choice
    assert "regenerate it with: ecatctl generate TrollPlant DIR" in answer


def test_a_model_is_exported_as_fmu(omc: Omc, out: Path, tmp_path: Path) -> None:
    answer = omc(out, f'buildModelFMU({MODELS[2]}, version = "2.0", fmuType = "cs");')
    assert list(tmp_path.glob("*.fmu")), answer


@pytest.mark.bus
@pytest.mark.filterwarnings("default")  # FMPy's own
def test_the_drive_follows_the_exported_fmu(omc: Omc, live: Path, tmp_path: Path) -> None:
    fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
    answer = omc(live, f'buildModelFMU({MODELS[2]}, version = "2.0", fmuType = "cs");')
    fmus = list(tmp_path.glob("*.fmu"))
    assert fmus, answer
    rows = fmpy.simulate_fmu(
        str(fmus[0]),
        fmi_type="CoSimulation",
        stop_time=2.5,
        output_interval=0.001,
        output=["w_m"],
    )
    top = sorted(rows["w_m"][rows["time"] > 2])
    assert top[len(top) // 2] == pytest.approx(examples.MAX_SPEED, rel=0.01)

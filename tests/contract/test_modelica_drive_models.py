"""Drives in models that OpenModelica simulates on the rig troll, wherever it is installed."""

from pathlib import Path

import pytest

from conftest import Daemon
from openmodelica import OpenModelica, Row, needs_omc, simulate

pytestmark = [needs_omc, pytest.mark.long, pytest.mark.bus, pytest.mark.timeout(900)]

MODELS = Path(__file__).with_name("DriveModels.mo")


@pytest.fixture(scope="module")
def omc(tmp_path_factory: pytest.TempPathFactory, troll: Daemon) -> OpenModelica:
    folder = tmp_path_factory.mktemp("omc")
    troll.ctl("generate", "TrollPlant", str(folder / "libraries"))
    return OpenModelica(folder, folder / "libraries")


def play(omc: OpenModelica, troll: Daemon, model: str, seconds: float, **values: str) -> list[Row]:
    answer = omc.run(
        f'loadFile("{MODELS}");', f'buildModel(DriveModels.{model}, outputFormat = "csv");'
    )
    assert "Error:" not in answer, answer
    assert "Warning:" not in answer, answer
    return simulate(omc.folder / f"DriveModels.{model}", seconds, bus=troll.bus, **values)


def test_a_speed_controller_in_the_model(omc: OpenModelica, troll: Daemon) -> None:
    rows = play(omc, troll, "SpeedLoop", 2)
    steady = [row["drive.w"] for row in rows if 1.4 < row["time"] < 1.7]
    assert sum(steady) / len(steady) == pytest.approx(30, rel=0.02)
    assert all(row["drive.w"] == 0 for row in rows if row["time"] < 0.45)


def test_a_reference_of_the_same_instant_is_no_algebraic_loop(
    omc: OpenModelica, troll: Daemon
) -> None:
    begin = play(omc, troll, "Away", 0.1)[-1]["drive.phi"]
    rows = play(omc, troll, "Feedthrough", 2, start=str(begin))
    assert rows[-1]["drive.phi"] == pytest.approx(begin + 5, abs=0.02)
    before = [row["drive.phi"] for row in rows if 0.1 < row["time"] < 0.45]
    assert max(before) - min(before) < 0.01


def test_position_does_not_jump_at_the_start(omc: OpenModelica, troll: Daemon) -> None:
    away = play(omc, troll, "Away", 2)
    assert away[-1]["drive.phi"] - away[0]["drive.phi"] > 25
    rows = play(omc, troll, "Position", 2)
    begin = next(row["drive.phi"] for row in rows if row["drive.state"] > 1)
    still = [row for row in rows if row["drive.state"] > 1 and row["time"] < 0.45]
    assert any(row["drive.enabled"] for row in still)
    assert max(abs(row["drive.phi"] - begin) for row in still) < 0.01
    for row in still:
        assert abs(row["drive.cia402.targetPosition"] - row["drive.slave.positionActualValue"]) < 50
    assert rows[-1]["drive.phi"] - begin == pytest.approx(3, abs=0.02)

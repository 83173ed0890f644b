"""The blocks of EtherCAT.CAN, in a model."""

import shutil
from pathlib import Path

import pytest

from conftest import run_module
from ecatdev import sample_buses
from ecatdev.checks import check_translation
from ecatgen import generate
from ecatsim.can.nodes.drive import EDS

MODEL = Path(__file__).with_name("CanModels.mo")
EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture
def out(tmp_path: Path) -> Path:
    generate(sample_buses.troll(), "Plant", tmp_path)
    shutil.copy(MODEL, tmp_path)
    return tmp_path


def test_the_model_is_translated(out: Path) -> None:
    assert list(check_translation(out, ["CanModels"])) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("connect(once.y, start.trigger);", ""),
        ("startBit = 7", "startBits = 7"),
        ("CANNumber.Signed", "CANNumber.Sign"),
        ("  mode.u = 1;\n", ""),
    ],
)
def test_the_check_sees(out: Path, old: str, new: str) -> None:
    file = out / MODEL.name
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    assert list(check_translation(out, ["CanModels"])) != []


def test_the_example_with_a_canopen_drive_is_translated(tmp_path: Path) -> None:
    config = ("--config", str(EXAMPLES / "troll" / "troll-can.toml"))
    found = run_module(
        *("ecatd.cli", "generate", "TrollPlant", str(tmp_path), "--from", "troll-can", *config),
        *("--can", f"can={EDS}@5"),
    )
    assert found.returncode == 0, found.stderr
    shutil.copy(EXAMPLES / "can" / "WheelOverCAN.mo", tmp_path)
    assert list(check_translation(tmp_path, ["WheelOverCAN"])) == []

"""FMUs as plants: real FMUs of FMI 2.0 and 3.0, compiled here from a first-order motor in C."""

import math
import shutil

import pytest

from conftest import naming

pytest.importorskip("fmpy", reason="FMPy is not installed (extra 'fmu')")

from motor_fmu import make_fmu

from ecatd.base.errors import ConfigError, StateError, UsageError
from ecatsim import Rig
from ecatsim.devices.library import make
from ecatsim.plants.fmu import Connection, FmuPlant, add_fmu
from ecatsim.rigs.library import make as make_rig

VERSIONS = ("2.0", "3.0")


@pytest.fixture(scope="module")
def fmus(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fmu")
    return {version: make_fmu(folder, version) for version in VERSIONS}


def bench(fmu, **options):
    """An FMU between an analog output and an analog input: 10 V is 10 V, 100 rad/s is 10 V."""
    output, inputs = make("EL4004"), make("EL3102")
    rig = Rig("motor", [output, inputs])
    plant = add_fmu(
        rig,
        fmu,
        [
            Connection("voltage", (output, 0x7000, 1)),
            Connection("speed", (inputs, 0x6000, 0x11), scale=0.1),
            Connection("running", (inputs, 0x6010, 0x11), scale=5.0, offset=-1.0),
        ],
        **options,
    )
    return rig, output, inputs, plant


@pytest.mark.parametrize("version", VERSIONS)
def test_a_motor_behind_analog_terminals(fmus, version):
    """The speed approaches gain * voltage with the time constant of the model."""
    rig, output, inputs, plant = bench(fmus[version], start={"gain": 8.0, "lag": 0.05})
    output.connection(0x7000, 1).value = 0.5 * 32767  # 5 V
    for i in range(301):
        for item in rig.plants:
            item(i / 1000)
        inputs.step(i / 1000)
        expected = 40.0 * (1 - math.exp(-(i + 1) / 1000 / 0.05))
        assert inputs[0x6000, 0x11] / 32767 * 100 == pytest.approx(expected, abs=0.01)
    assert inputs[0x6010, 0x11] == pytest.approx(4.0 / 10 * 32767, abs=1), "a Boolean: running"
    assert plant.cost.steps == 301
    assert 0 < plant.cost.mean <= plant.cost.worst
    plant.close()


@pytest.mark.parametrize("version", VERSIONS)
def test_a_longer_step_size_gives_the_same_motion(fmus, version):
    rig, output, inputs, plant = bench(fmus[version], start={"lag": 0.05}, period=0.01)
    output.connection(0x7000, 1).value = 32767.0
    for i in range(101):
        rig.plants[0](i / 1000)
    inputs.step(0.1)
    assert plant.cost.steps == 11
    expected = 100.0 * (1 - math.exp(-0.11 / 0.05))
    assert inputs[0x6000, 0x11] / 32767 * 100 == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize("version", VERSIONS)
def test_an_error_of_the_fmu_is_said(fmus, version):
    rig, *_ = bench(fmus[version], start={"fail_at": 0.005})
    with pytest.raises(StateError, match=r"motor.*\.fmu: .*0\.005 s .*DoStep.*winding"):
        for i in range(100):
            rig.plants[0](i / 1000)


@pytest.mark.parametrize("version", VERSIONS)
def test_a_start_value_that_the_fmu_refuses(fmus, version):
    with pytest.raises(StateError, match=r"motor.*\.fmu: .*InitializationMode"):
        bench(fmus[version], start={"lag": -1.0})


def test_unpacked_files_go_with_the_plant(fmus):
    from pathlib import Path

    _, _, _, plant = bench(fmus["2.0"])
    folder = Path(plant._folder)
    assert folder.is_dir()
    plant.close()
    assert not folder.exists()
    plant.close()


def test_unknown_variables_are_said(fmus):
    terminal = (make("EL4004"), 0x7000, 1)
    for wrong, message in (
        ("sped", "variable | 'sped' | speed"),
        ("q", "variable | 'q' | voltage | speed | running"),
        ("time", "'time' | independent"),
    ):
        with pytest.raises(ConfigError, match=naming(*message.split(" | "))):
            FmuPlant(fmus["2.0"], [Connection(wrong, terminal)])
    with pytest.raises(ConfigError, match=naming("variable", "'gian'", "gain")):
        FmuPlant(fmus["3.0"], [], {"gian": 1.0})
    with pytest.raises(UsageError, match=naming("EL4004", "0x7000:02")):
        FmuPlant(fmus["2.0"], [Connection("voltage", (terminal[0], 0x7000, 2))])


def test_files_that_are_no_fmu_of_use(tmp_path):
    with pytest.raises(ConfigError, match=naming("no FMU", f"'{tmp_path / 'gone.fmu'}'")):
        FmuPlant(tmp_path / "gone.fmu", [])
    (tmp_path / "text.fmu").write_text("not a zip file")
    with pytest.raises(ConfigError, match=naming(tmp_path / "text.fmu", "FMU", "zip")):
        FmuPlant(tmp_path / "text.fmu", [])
    for change, message in (
        ({"kind": "ModelExchange"}, "co-simulation"),
        ({"platform": "win64"}, "linux64 | win64"),
        ({"variables": "<broken"}, "FMPy"),
    ):
        with pytest.raises(ConfigError, match=naming(*message.split(" | "))):
            FmuPlant(make_fmu(tmp_path, "2.0", **change), [])


def test_fmpy_is_asked_for_where_it_is_not_installed(fmus, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "fmpy", None)
    with pytest.raises(UsageError, match=naming("FMPy", "pip install 'ecatd[fmu]'")):
        FmuPlant(fmus["2.0"], [])


# --- rig files -------------------------------------------------------------------------------

RIG = """
name = "motor"
[[slave]]
device = "EL4004"
[[slave]]
device = "EL3102"
[[plant]]
fmu = "motor.fmu"
period = 0.002
start = { gain = 8.0, lag = 0.05 }
[[plant.connect]]
variable = "voltage"
slave = 0
entry = "0x7000:01"
[[plant.connect]]
variable = "speed"
slave = 1
entry = "0x6000:11"
scale = 0.1
"""


def rig_from(folder, fmu, text):
    shutil.copy(fmu, folder / "motor.fmu")
    (folder / "rig.toml").write_text(text)
    return make_rig(str(folder / "rig.toml"))


def test_an_fmu_in_a_rig_file(fmus, tmp_path):
    rig = rig_from(tmp_path, fmus["3.0"], RIG)
    output, inputs = rig.devices
    output.connection(0x7000, 1).value = 32767.0
    for i in range(400):
        for plant in rig.plants:
            plant(i / 1000)
    inputs.step(0.4)
    assert inputs[0x6000, 0x11] / 32767 * 100 == pytest.approx(80.0, abs=0.1)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('variable = "speed"', 'variable = "sped"', "motor.fmu: | variable | 'sped'"),
        ("slave = 1", "slave = 2", "rig.toml:17: | plant[0].connect[1].slave | 2 | 0 | 1"),
        ("gain = 8.0", 'gain = "x"', "rig.toml:10: | plant[0].start.gain | number | 'x'"),
        (
            "scale = 0.1",
            "scal = 0.1",
            "rig.toml:19: | plant[0].connect[1].scal | not a key | 'scale'",
        ),
        ('"0x6000:11"', '"0x6000:55"', "EL3102 | 0x6000:55"),
        ('fmu = "motor.fmu"', 'fmu = "gone.fmu"', "no FMU | gone.fmu"),
    ],
)
def test_wrong_fmus_in_rig_files(fmus, tmp_path, old, new, message):
    assert old in RIG
    with pytest.raises(ConfigError, match=naming(*message.split(" | "))):
        rig_from(tmp_path, fmus["2.0"], RIG.replace(old, new))


def test_an_fmu_without_connections(fmus, tmp_path):
    with pytest.raises(ConfigError, match=naming("connections", "no effect")):
        rig_from(tmp_path, fmus["2.0"], RIG.split("[[plant.connect]]")[0])

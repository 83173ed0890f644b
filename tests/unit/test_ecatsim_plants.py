"""Wires, waveforms and plants at a fixed rate."""

import math
import re
import statistics
import struct
import time
from pathlib import Path

import pytest

from conftest import naming
from ecatd.base.errors import ConfigError, UsageError
from ecatsim import DataType, Device, Entry, Pdo, Rig
from ecatsim.devices.library import make
from ecatsim.plants import waveforms
from ecatsim.plants.fixed_step import FixedStep
from ecatsim.plants.point import Point


def run(rig, now=0.0):
    for plant in rig.plants:
        plant(now)
    for device in rig.devices:
        device.step(now)


# --- points and wires ------------------------------------------------------------------------


def test_a_point_has_the_unit_of_its_entry():
    device = make("AnalogIO", range=20.0, unit="mA")
    point = Point((device, 0x6000, 2))
    point.set(10.0)
    assert device[0x6000, 2] == round(32767 / 2)
    assert point.get() == pytest.approx(10.0, abs=20 / 32767)
    assert point.unit == "mA"


@pytest.mark.parametrize(("bits", "most"), [(16, 0x7FFF), (32, 0x7FFFFFFF)])
def test_a_point_holds_values_within_the_range_of_its_type(bits, most):
    device = make("AnalogIO", bits=bits)
    point = Point((device, 0x6000, 1))
    for value, raw in ((1e9, most), (-1e9, -most - 1), (float("inf"), most), (-10.0, -most)):
        point.set(value)
        assert device[0x6000, 1] == raw
    point.set(float("nan"))
    assert device[0x6000, 1] == -most, "not a number changes nothing"


def test_what_a_real32_cannot_hold_is_infinite():
    class Level(Device):
        vendor, product, revision, order = 1, 2, 3, "Level"
        tx_pdos = (Pdo(0x1A00, "In", 0, [Entry(0x6000, 1, "Level", DataType.REAL32, 32)]),)

    device = Level()
    point = Point((device, 0x6000, 1))
    for value, stored in ((1e300, math.inf), (-1e39, -math.inf), (1.5, 1.5)):
        point.set(value)
        assert device.give() == struct.pack("<f", stored)


def test_an_output_that_is_no_number_reads_as_0():
    class Valve(Device):
        vendor, product, revision, order = 1, 2, 3, "Valve"
        rx_pdos = (Pdo(0x1600, "Out", 0, [Entry(0x7000, 1, "Open", DataType.REAL32, 32)]),)

    device = Valve()
    point = Point((device, 0x7000, 1))
    for written, read in ((0.5, 0.5), (math.nan, 0.0), (math.inf, 0.0)):
        device.receive(struct.pack("<f", written))
        assert point.get() == read


def test_a_point_says_which_entries_there_are():
    with pytest.raises(UsageError, match=naming("DigitalIO", "0x6000:09", "0x6000:01")):
        Point((make("DigitalIO", outputs=0), 0x6000, 9))


def test_a_wire_carries_volts_between_terminals_of_different_resolution():
    source, fine, coarse = make("AnalogIO", bits=32), make("AnalogIO", bits=16), make("EL3102")
    rig = Rig("wires", [source, fine, coarse])
    rig.connect_entries((source, 0x7000, 1), (fine, 0x6000, 1))
    rig.connect_entries((source, 0x7000, 1), (coarse, 0x6000, 0x11), scale=0.5, offset=1.0)
    source[0x7000, 1] = round(0.4 * 0x7FFFFFFF)  # 4 V
    run(rig)
    assert fine[0x6000, 1] == round(0.4 * 32767)
    assert coarse[0x6000, 0x11] == round(0.3 * 32767)


def test_a_wire_from_an_analog_output_to_an_analog_input():
    output, inputs = make("EL4004"), make("EL3102")
    rig = Rig("wires", [output, inputs])
    rig.connect_entries((output, 0x7010, 1), (inputs, 0x6010, 0x11))
    output.connection(0x7010, 1).value = 12345.0
    run(rig)
    assert inputs[0x6010, 0x11] == 12345


def test_a_waveform_beyond_the_range_sets_the_status_of_the_input():
    device = make("EL3102")
    rig = Rig("signals", [device])
    rig.drive((device, 0x6000, 0x11), waveforms.constant(12.0))
    run(rig)
    assert device[0x6000, 0x11] == 32767
    assert (device[0x6000, 1], device[0x6000, 2], device[0x6000, 7]) == (0, 1, 1)


# --- fixed rate ------------------------------------------------------------------------------


def test_a_plant_is_called_at_its_own_rate():
    times = []
    plant = FixedStep(times.append, 0.004)
    for i in range(101):
        plant(50.0 + i / 1000)
    assert times == pytest.approx([50.0 + 0.004 * i for i in range(26)])
    fast = FixedStep(times.append, 0.00025)
    times.clear()
    fast(0.0)
    fast(0.001)
    assert times == pytest.approx([0.0, 0.00025, 0.0005, 0.00075, 0.001])


def test_a_plant_catches_up_within_bounds():
    times = []
    plant = FixedStep(times.append, 0.001, catch_up=0.1)
    plant(0.0)
    plant(0.05)
    assert len(times) == 51, "a short pause is made up for"
    plant(10.0)
    assert len(times) == 151, "a long pause is not"
    assert times[-1] == pytest.approx(10.0)
    assert plant.steps == 151
    assert plant.steps + plant.left_out == 10001


def test_a_plant_that_cannot_keep_up_gives_way():
    """Steps of 2 ms of computing that last 1 ms: at most three at one go, the rest later."""

    def slow(now):
        end = time.thread_time() + 0.002
        while time.thread_time() < end:
            pass

    plant = FixedStep(slow, 0.001)
    plant(0.0)
    for i in range(1, 11):
        before = plant.steps
        plant(i * 0.05)
        assert 1 <= plant.steps - before <= 3
    assert plant.left_out > 300


def test_the_same_period_as_the_simulation_means_one_step_each_time():
    times = []
    plant = FixedStep(times.append, 0.001)
    for i in range(5000):
        plant(1234.5 + i * 0.001)
        assert len(times) == i + 1


@pytest.mark.parametrize("period", [0.0, -1.0, float("nan"), float("inf")])
def test_a_period_must_be_positive(period):
    with pytest.raises(UsageError, match=naming("period", "positive")):
        Rig("x").add_plant(lambda now: None, period)


# --- waveforms -------------------------------------------------------------------------------


def test_periodic_waveforms():
    at = (0.0, 0.25, 0.5, 0.75, 1.0)
    assert [waveforms.square(1.0, -2, 5)(t) for t in at] == [5, 5, -2, -2, 5]
    assert [waveforms.ramp(-1.0, 1.0, 1.0)(t) for t in at] == [-1, -0.5, 0, 0.5, -1]
    assert [waveforms.triangle(-1.0, 1.0, 1.0)(t) for t in at] == [-1, 0, 1, 0, -1]
    assert [waveforms.sine(2.0, 1.0, offset=1.0)(t) for t in at] == pytest.approx([1, 3, 1, -1, 1])


def test_noise_is_the_same_for_the_same_seed():
    runs = [[waveforms.noise(2.0, 5.0, seed)(0.0) for _ in range(3)] for seed in (1, 1, 2)]
    assert runs[0] == runs[1] != runs[2]
    source = waveforms.noise(2.0, 5.0)
    values = [source(0.0) for _ in range(4000)]
    assert statistics.fmean(values) == pytest.approx(5.0, abs=0.2)
    assert statistics.stdev(values) == pytest.approx(2.0, rel=0.1)


def test_waveforms_from_a_table(tmp_path):
    file = tmp_path / "speed.csv"
    file.write_text("time,speed,torque\n0,0,7\n1,10,7\n\n3,-10,7\n")
    waveform = waveforms.table(file, "speed", "time")
    assert [waveform(100.0 + t) for t in (0, 0.5, 1, 2, 3, 99)] == [0, 5, 10, 0, -10, -10]
    again = waveforms.table(file, 1, repeat=True)
    assert [again(7.0 + t) for t in (0, 3.5, 4)] == [0, 5, 10]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "t.csv | no values"),
        ("time,speed\n", "t.csv | no values"),
        ("\n\n", "t.csv | no values"),
        ("time,power\n0,0\n", "t.csv | 'speed' | time | power"),
        ("0,0\n1,1\n", "t.csv | 'speed' | no names"),
        ("time,speed\n0,0\n0,1\n", "t.csv:3: | ascend"),
        ("time,speed\n0,nan\n", "t.csv:2: | numbers"),
        ("time,speed\n0,0\n1,fast\n", "t.csv:3: | time | value"),
        ("time,speed\n0\n", "t.csv:2: | time | value"),
    ],
)
def test_wrong_tables(tmp_path, text, message):
    file = tmp_path / "t.csv"
    file.write_text(text)
    with pytest.raises(ConfigError, match=naming(*message.split(" | "))):
        waveforms.table(file, "speed")


def test_tables_that_cannot_be_read(tmp_path):
    with pytest.raises(UsageError, match=naming(tmp_path / "gone.csv", "No such file")):
        waveforms.table(tmp_path / "gone.csv")
    (tmp_path / "b.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match=naming(tmp_path / "b.csv", "CSV")):
        waveforms.table(tmp_path / "b.csv")
    with pytest.raises(UsageError, match=naming("columns", 0, -1)):
        (tmp_path / "c.csv").write_text("0,0\n")
        waveforms.table(tmp_path / "c.csv", -1)


def test_the_tank_of_the_documentation():
    text = (Path(__file__).parents[2] / "docs/simulator-rigs.md").read_text()
    (source,) = [part for part in re.findall(r"```python\n(.*?)```", text, re.S) if "tank" in part]
    found = {}
    exec(source, found)
    rig = found["rig"]()
    _, outputs, inputs, more = rig.devices
    outputs.connection(0x7000, 1).value = outputs.connection(0x7010, 1).value = 32767.0  # 10 V
    for i in range(1001):
        for plant in rig.plants:
            plant(i / 1000)
    inputs.step(1.0)
    assert inputs[0x6000, 0x11] / 32767 * 10 == pytest.approx(0.5, abs=0.01)
    assert inputs[0x6010, 0x11] / 32767 * 10 == pytest.approx(5.0, abs=0.01)
    assert more[0x6000, 1] / 32767 * 20 == pytest.approx(12.0, abs=0.1)

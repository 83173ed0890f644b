"""Models that OpenModelica simulates on the simulated bus, wherever it is installed."""

import bisect
import math
import re
import signal
import statistics
import subprocess
import sys
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from conftest import Daemon, names
from ecatd.shm.contract import Outputs, Reason
from ecatdev import sample_buses
from ecatgen import generate
from openmodelica import OpenModelica, Row, needs_omc, read_csv, simulate, start, until

pytestmark = [needs_omc, pytest.mark.long, pytest.mark.bus, pytest.mark.timeout(900)]

DRIVE, DIGITAL_OUTPUTS = 0, 3

AL_OP = 6
"""Number of the element of EtherCAT.Types.ALState."""


@pytest.fixture(scope="module")
def omc(tmp_path_factory: pytest.TempPathFactory, troll: Daemon) -> OpenModelica:
    folder = tmp_path_factory.mktemp("omc")
    troll.ctl("generate", "TrollPlant", str(folder / "libraries"))
    return OpenModelica(folder, folder / "libraries")


def changes(rows: list[Row], name: str) -> list[float]:
    """The times at which a variable changes."""
    return [after["time"] for before, after in pairwise(rows) if before[name] != after[name]]


@pytest.mark.parametrize("old", [False, True], ids=["front end", "old front end"])
def test_digital_io(omc: OpenModelica, troll: Daemon, old: bool) -> None:
    omc = replace(omc, old_front_end=old)
    rows = simulate(omc.build("EtherCAT.Examples.DigitalIO"), 3, bus=troll.bus)
    for channel in range(1, 5):  # are wired to the outputs
        sent, seen = f"blink[{channel}].y", f"el1018.y[{channel}]"
        assert abs(len(changes(rows, sent)) - len(changes(rows, seen))) <= 2
        same = sum(row[sent] == row[seen] for row in rows)
        assert same > 0.9 * len(rows)
    assert len(changes(rows, "el1018.y[8]")) > len(changes(rows, "el1018.y[5]")) >= 4
    assert len({row["word.y"] for row in rows}) > 10


def test_analog_scaling(omc: OpenModelica, troll: Daemon) -> None:
    rows = simulate(omc.build("EtherCAT.Examples.AnalogScaling"), 3, bus=troll.bus)
    assert max(row["v[4]"] for row in rows) == pytest.approx(8, rel=0.01)
    assert max(row["el3008.y[4]"] for row in rows) == pytest.approx(26214, rel=0.01)
    for row in rows:
        assert row["v[4]"] == pytest.approx(row["el3008.y[4]"] * 10 / 32767)
        assert abs(row["back.y"]) <= 10
    saturated = [row for row in rows if row["toRaw.saturated"]]
    assert {abs(row["back.y"]) for row in saturated} == {10}
    share = len(saturated) / len(rows)
    assert share == pytest.approx(1 - 2 * math.asin(10 / 12) / math.pi, abs=0.02)
    following = [row for row in rows if not row["toRaw.saturated"] and row["time"] > 0.01]
    distances = [abs(row["back.y"] - row["wanted.y"]) for row in following]
    assert max(distances) < 0.2  # what a sine of 12 V and 1 Hz rises in a sample, twice


def test_two_domains(omc: OpenModelica, troll: Daemon) -> None:
    rows = simulate(omc.build("EtherCAT.Examples.TwoDomains"), 1, bus=troll.bus)
    slow = changes(rows, "slowValue.y") + changes(rows, "word.y")
    assert len(slow) > 200
    assert all(abs(time / 0.004 - round(time / 0.004)) < 1e-6 for time in slow)
    fast = changes(rows, "fast.y[8]")
    assert any(abs(time / 0.004 - round(time / 0.004)) > 0.1 for time in fast)


TOGETHER = """
package Own
  model Together "One slave in both domains"
    extends EtherCAT.Examples.TwoDomains;
    EtherCAT.Examples.Utilities.EL3008 again(domainID = 2);
    Integer shared(start = 0, fixed = true) "Instants of both domains";
    Integer different(start = 0, fixed = true) "Of these, with two values of the slave";
  equation
    when etherCATMaster.sampled[2] then
      shared = pre(shared) + 1;
      different = pre(different) + (if fast.y[8] == again.y[8] then 0 else 1);
    end when;
  end Together;
  model Never
    extends EtherCAT.Examples.TwoDomains(etherCATMaster(sampleTime = {0.001, 0.00101}));
  end Never;
  model Backwards
    extends EtherCAT.Examples.TwoDomains(etherCATMaster(sampleTime = {0.001, -0.004}));
  end Backwards;
end Own;
"""


@pytest.fixture(scope="module")
def together(omc: OpenModelica) -> Path:
    (omc.folder / "Own.mo").write_text(TOGETHER)
    answer = omc.run('loadFile("Own.mo");', 'buildModel(Own.Together, outputFormat = "csv");')
    assert not re.search(r"Error:|Warning:", answer), answer
    return omc.folder / "Own.Together"


@pytest.mark.parametrize(
    ("stop_time", "wait", "flags"),
    [
        (60, True, []),
        (12, True, ["-s=cvode"]),
        (3600, False, ["-noEventEmit"]),
    ],
    ids=["a minute", "cvode", "an hour that does not wait"],
)
def test_domains_stay_together(
    together: Path, troll: Daemon, stop_time: int, wait: bool, flags: list[str]
) -> None:
    rows = simulate(
        together,
        stop_time,
        flags=flags,
        bus=troll.bus,
        stepSize=f"{stop_time / 60}",
        etherCATMaster__waitForBus=f"{wait}".lower(),
    )
    assert rows[-1]["shared"] >= stop_time * 250 - 1
    assert rows[-1]["different"] == 0


@pytest.mark.parametrize(
    ("model", "problem"), [("Never", "no multiples of one time"), ("Backwards", "positive")]
)
def test_sample_times_without_a_base_are_refused_at_translation(
    omc: OpenModelica, model: str, problem: str
) -> None:
    (omc.folder / "Own.mo").write_text(TOGETHER)
    answer = omc.run('loadFile("Own.mo");', f"buildModel(Own.{model});")
    names(answer, "EtherCAT: ", "sample times", problem)
    assert not (omc.folder / f"Own.{model}").exists()


def test_an_object_is_read(omc: OpenModelica, troll: Daemon) -> None:
    rows = simulate(omc.build("EtherCAT.Examples.ReadObject"), 1, bus=troll.bus)
    assert rows[-1]["deviceType.y"] == 0x20192
    assert rows[-1]["deviceType.abortCode"] == 0


def test_a_drive_follows_its_reference(omc: OpenModelica, troll: Daemon) -> None:
    rows = simulate(omc.build("EtherCAT.Examples.Drive"), 3, bus=troll.bus)
    top = [row for row in rows if row["time"] > 2.2]
    assert statistics.median(row["ptp.y"] for row in top) == pytest.approx(62.83, rel=1e-3)
    assert statistics.median(row["drive.w"] for row in top) == pytest.approx(62.83, rel=0.01)


def test_a_position_is_relative_and_does_not_jump(omc: OpenModelica, troll: Daemon) -> None:
    rows = simulate(omc.build("TrollPlant.Examples.RelativePosition"), 3)
    origin = next(row["phi_m"] for row in rows if row["time"] > 0.2)
    before = [row["phi_m"] - origin for row in rows if 0.2 < row["time"] < 1]
    assert max(map(abs, before)) < 0.1  # the drive was enabled, and stays where it was
    assert rows[-1]["phi_ref"] > 50
    assert rows[-1]["phi_m"] - origin == pytest.approx(rows[-1]["phi_ref"], rel=0.05)


def test_no_example_is_left_out(omc: OpenModelica) -> None:
    """Every example of both libraries is simulated in this file."""
    source = Path(__file__).read_text("utf-8")
    for library in ("EtherCAT", "TrollPlant"):
        for file in sorted((omc.libraries / library / "Examples").glob("*.mo")):
            name = f"{library}.Examples.{file.stem}"
            assert file.name == "package.mo" or f'"{name}"' in source, name


def test_the_pace_of_a_model_without_a_bus(omc: OpenModelica) -> None:
    rows = simulate(omc.build("EtherCAT.Examples.RealtimeWithoutBus"), 2.2)
    available = "synchronizeRealtime.availableTime"
    early = [row[available] for row in rows if 1 < row["time"] < 1.9]
    late = [row[available] for row in rows if row["time"] > 2.1]
    # Never more than a sample time is left; on a busy machine few samples have so much.
    assert 0 < max(early) < 1.5e-3 < max(late) < 2.5e-3
    assert rows[-1]["synchronizeRealtime.missed"] < len(rows)


def test_the_script_of_the_documentation(omc: OpenModelica) -> None:
    text = (Path(__file__).parents[2] / "docs" / "modelica.md").read_text("utf-8")
    (commands,) = re.findall(r"```\n(loadModel.*?)```", text, re.DOTALL)
    assert "/home/me/models" in commands
    answer = omc.script(commands.replace("/home/me/models", str(omc.libraries)))
    assert "The simulation finished successfully" in answer, answer
    assert "Error" not in answer, answer


def test_the_block_of_ones_own_of_the_users_guide(omc: OpenModelica, troll: Daemon) -> None:
    guide = (omc.libraries / "EtherCAT" / "UsersGuide" / "OwnBlocks.mo").read_text("utf-8")
    (block,) = re.findall(r"<pre>\n(.*?)</pre>", guide, re.DOTALL)
    (omc.folder / "Own.mo").write_text(
        "package Own\n"
        + block.replace('\\"', '"')
        + "model Test\n"
        + "  inner EtherCAT.EtherCATMaster etherCATMaster(waitForBus = true);\n"
        + "  Voltage voltage;\n"
        + "  EtherCAT.Examples.Utilities.EL3008 raw;\n"
        + "end Test;\nend Own;\n"
    )
    answer = omc.run('loadFile("Own.mo");', 'buildModel(Own.Test, outputFormat = "csv");')
    assert not re.search(r"Error:|Warning:", answer), answer
    rows = simulate(omc.folder / "Own.Test", 0.5, bus=troll.bus)
    assert rows[-1]["voltage.valid"] == 1
    assert len(changes(rows, "voltage.v")) > 10
    for row in rows:
        assert row["voltage.v"] == pytest.approx(row["raw.y[1]"] * 10 / 32767)


def test_all_slaves(omc: OpenModelica, troll: Daemon) -> None:
    rows = simulate(omc.build("TrollPlant.Examples.AllSlaves"), 1)
    assert any(len(changes(rows, name)) > 10 for name in rows[0] if name.startswith("el3008."))
    assert rows[-1]["el1018.alState"] == AL_OP
    counters = ("etherCATMaster.workingCounter", "etherCATMaster.workingCounterExpected")
    whole = [row for row in rows if row[counters[0]] == row[counters[1]] > 0]
    assert len(whole) > len(rows) / 2  # a busy machine loses a frame now and then
    assert [row for row in rows if row["el1018.valid"]] == whole


def test_a_simulation_that_is_killed_leaves_safe_outputs(omc: OpenModelica, troll: Daemon) -> None:
    process = start(
        omc.build("EtherCAT.Examples.DigitalIO"), 60, bus=troll.bus, etherCATMaster__lease="2"
    )
    with troll.client() as client:
        output = client.signal(DIGITAL_OUTPUTS, 0x7000, 1)

        def is_on() -> bool:
            client.wait()
            client.sample()
            active = client.slaves()[DIGITAL_OUTPUTS].outputs == Outputs.ACTIVE
            return active and output.raw == 1

        until(is_on, process)
        process.send_signal(signal.SIGKILL)
        process.communicate()
        cycles = 0
        while client.slaves()[DIGITAL_OUTPUTS].outputs != Outputs.SAFE:
            client.wait()
            cycles += 1
            assert cycles < 5000, "the outputs are not safe long after the lease"
        client.sample()
        assert output.raw == 0
        assert client.output(f"{DIGITAL_OUTPUTS}/0x7000:01").reason is Reason.DIED


def test_a_lease_that_is_none_ends_the_simulation(omc: OpenModelica, troll: Daemon) -> None:
    program = omc.build("EtherCAT.Examples.TwoDomains")
    changed = {"etherCATMaster.waitForBus": "false", "etherCATMaster.lease": "-1"}
    with start(program, 0.1, bus=troll.bus, **changed) as process:
        log, _ = process.communicate()
    assert process.returncode != 0, log
    names(log, "EtherCAT: ", "lease", "negative")


def test_a_model_of_another_bus_fails_with_one_sentence(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    daemon = start_daemon(str(Path(__file__).parents[1] / "rigs" / "odd_names.py"))
    bus = sample_buses.troll()
    bus.name = daemon.bus
    generate(bus, "TrollPlant", tmp_path / "libraries")
    program = OpenModelica(tmp_path, tmp_path / "libraries").build("TrollPlant.Examples.AllSlaves")
    with start(program, 0.1) as process:
        log, _ = process.communicate()
    # Which slave comes first is omc's choice.
    names(log, f"'{daemon.bus}'", "generated for", "ecatctl generate TrollPlant DIR")


@contextmanager
def recorded_troll(folder: Path) -> Iterator[tuple[str, Path]]:
    """A daemon on the rig troll, whose simulator records the motor; yields bus and record."""
    bus, record = f"t{uuid.uuid4().hex[:10]}", folder / "record.csv"
    config = folder / "ecat.toml"
    config.write_text("[gateway]\nlisten = []\n")
    daemon = [sys.executable, "-m", "ecatd.service", "--interface", "ecat-master"]
    command = [sys.executable, "-m", "ecatsim", "run", "troll", "--trace", str(record), "--"]
    with subprocess.Popen(
        [*command, *daemon, "--bus", bus, "--config", str(config)],
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if "is in OP" in line:
                break
        try:
            yield bus, record
        finally:
            process.terminate()
            process.communicate()


def crossing(times: list[float], values: list[float], level: float) -> float:
    """When a curve rises through a level for the first time."""
    for i in range(1, len(values)):
        if values[i - 1] < level <= values[i]:
            part = (level - values[i - 1]) / (values[i] - values[i - 1])
            return times[i - 1] + part * (times[i] - times[i - 1])
    raise AssertionError(f"the curve does not reach {level}")


def at(times: list[float], values: list[float], time: float) -> float:
    """A curve at any time, by linear interpolation."""
    i = min(max(bisect.bisect(times, time), 1), len(times) - 1)
    part = (time - times[i - 1]) / (times[i] - times[i - 1])
    return values[i - 1] + part * (values[i] - values[i - 1])


def distance(times: list[float], values: list[float], time: float, value: float) -> float:
    """Of a value to a curve, within the 20 ms that a bus may slip on a busy machine."""
    near = [at(times, values, time + shift / 1000) for shift in range(-20, 21, 2)]
    return max(0.0, min(near) - value, value - max(near))


def test_figure_9_is_what_the_simulator_records(tmp_path: Path) -> None:
    with recorded_troll(tmp_path) as (bus, record):
        ctl = [sys.executable, "-m", "ecatd.cli", "--bus", bus]
        out = tmp_path / "libraries"
        subprocess.run([*ctl, "generate", "TrollPlant", str(out)], check=True)
        program = OpenModelica(tmp_path, out).build("TrollPlant.Examples.PointToPointMovement")
        model = simulate(program, 3)
    motor = read_csv(record)
    clock = [row["time_ns"] / 1e9 for row in motor]
    speed = [row["velocity_counts_per_s"] for row in motor]
    # Where the model was too slow for the bus, its time has slipped against the cycles.
    for row in model:
        row["bus"] = (row["etherCATMaster.cycle"] - model[0]["etherCATMaster.cycle"]) / 1000
    times, w_m = [row["bus"] for row in model], [row["w_m"] for row in model]
    top = max(speed)
    unit = top / max(w_m)  # increments/s, or rad/s of an encoder with 16 bits
    assert min(abs(unit - 1), abs(unit * 2 * math.pi / 65536 - 1)) < 0.01
    # Both curves begin to rise at the same moment, and stay together from there.
    shift = crossing(clock, speed, top / 2) - crossing(times, w_m, top / unit / 2)
    for variable, recorded, scale in (
        ("w_m", speed, unit),
        ("w_ref", [row["reference_counts_per_s"] for row in motor], unit),
    ):
        distances = sorted(
            distance(clock, recorded, row["bus"] + shift, row[variable] * scale) / top
            for row in model
            if row["time"] > 0.5
        )
        assert distances[int(0.95 * len(distances))] < 0.03, variable
    # The current of the motor accelerates, then holds against friction; its scale is the drive's.
    current = [row["current_A"] for row in motor]
    ratio = statistics.median(
        row["i_m"] / at(clock, current, row["bus"] + shift) for row in model if row["time"] > 2
    )
    ramp = [row for row in model if 1.1 < row["time"] < 1.4]
    assert statistics.mean(row["i_m"] for row in ramp) / ratio == pytest.approx(
        statistics.mean(at(clock, current, row["bus"] + shift) for row in ramp), rel=0.05
    )

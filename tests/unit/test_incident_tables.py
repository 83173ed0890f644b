"""Incidents and recordings as tables: for Modelica with a block, and as inputs of an FMU."""

import csv
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("mcap")
pytest.importorskip("fmpy")

import fmpy
import rumoca
from motor_fmu import make_fmu
from pymoca.parser import parse

import ecatdev.checks
from conftest import names
from ecatd.base.errors import EcatError, UsageError
from ecatd.cli.incident import incident
from ecatd.cli.main import make_parser
from ecatd.cli.recordings import FORMATS, Column, open_recording
from ecatd.config.meanings import give_meanings
from ecatd.config.profiles import load_profiles
from ecatd.description.bus import Bus
from ecatd.operations.traces import TraceSignal, column_type
from ecatd.recorder.incident import Incident, Row, Trigger, write
from ecatdev import sample_buses
from ecatdev.checks import check_syntax
from ecatgen.fmu import generate_fmu
from openmodelica import OpenModelica, needs_omc, simulate

BEGIN_NS = 1_764_000_000_000_000_000
ABSENT, MISSING = range(30, 40), range(60, 65)
"""Cycles in which slave 4 does not take part, and cycles that are missing."""
CYCLES = 100
FIRST = 2**31 - 50
"""Number of the first cycle; the connector `cycle` of a block begins again after some of them."""
LEVEL = "el3008.aiStandardChannel1Value"


def signals_of(bus: Bus) -> list[TraceSignal]:
    return [
        TraceSignal(
            name=f"{slave.position}/{pdo.name}/{entry.name}",
            slave=slave.position,
            address=entry.address,
            output=outputs,
            type=column_type(entry.data_type, entry.bit_length),
            scale=entry.scale,
            offset=entry.offset,
            unit=entry.unit,
        )
        for slave in bus.slaves
        for outputs in (True, False)
        for pdo, entry, _ in slave.entries(outputs=outputs)
    ]


def raw(cycle: int, signal: Mapping[str, Any]) -> float | None:
    if signal["slave"] == 4 and cycle in ABSENT:
        return None
    return cycle % 2 if signal["type"] == "uint8" else 100 * cycle


@pytest.fixture
def bus() -> Bus:
    return give_meanings(sample_buses.troll(), load_profiles())


def make(
    path: Path,
    bus: Bus,
    signals: Sequence[TraceSignal] = (),
    document: Any = None,
    trigger: Trigger | None = None,
    cause: str = "",
) -> Path:
    """An incident of 100 cycles of 1 ms, of which some are missing."""
    signals = [*signals] or signals_of(bus)
    rows = [
        Row(FIRST + n, BEGIN_NS + n * 1_000_000, 80.0, 0, [raw(n, item) for item in signals])
        for n in range(CYCLES)
        if n not in MISSING
    ]
    trigger = trigger or Trigger("fault", BEGIN_NS + 30_000_000, 'slave 4 "EL3008" </p> is lost')
    found = Incident(bus.name, [trigger], signals, rows, [], [], ["eth0"], [], 0)
    found.reading, found.cause = "Slave 4 was lost.\n", cause
    found.documents = {"bus": bus.to_dict() if document is None else document}
    write(path, found)
    return path


def export(path: Path, out: Path, *signals: str, force: bool = False) -> list[dict[str, float]]:
    """Exports a file without a daemon; returns the rows of a CSV file."""
    options = ["incident", "export", str(path), "-o", str(out), *["--force"] * force]
    for signal in signals:
        options += ["--signal", signal]
    incident(make_parser().parse_args(options))
    if out.suffix != ".csv":
        return []
    with out.open(newline="") as lines:
        found = csv.DictReader(lines)
        assert (found.fieldnames or [])[-1] == "unix_s"
        return [{name: float(v) for name, v in row.items()} for row in found]


def test_what_is_missing_is_held_and_not_valid(tmp_path: Path, bus: Bus) -> None:
    rows = export(make(tmp_path / "a.mcap", bus), tmp_path / "a.csv", "4/*", "2/*")
    by_time = {round(1000 * row["time"], 6): row for row in rows}
    assert len(rows) == CYCLES - len(MISSING) + 2
    (scale,) = {s["scale"] for s in signals_of(bus) if s["unit"] == "V"}
    assert by_time[29][LEVEL] == pytest.approx(2900 * scale)
    assert by_time[29]["unix_s"] == pytest.approx(BEGIN_NS / 1e9 + 0.029)
    for ms in (30, 39):
        assert by_time[ms][LEVEL] == pytest.approx(2900 * scale)
        assert (by_time[ms]["el3008.valid"], by_time[ms]["el1018.valid"]) == (0, 1)
    assert (by_time[40][LEVEL], by_time[40]["el3008.valid"]) == (pytest.approx(4000 * scale), 1)
    gap, end = by_time[60], by_time[100]
    for row, cycle, value in ((gap, 60, 5900), (end, 100, 9900)):
        assert row["cycle"] == (FIRST + cycle) % 2**31
        assert (row["el3008.valid"], row["el1018.valid"]) == (0, 0)
        assert row[LEVEL] == pytest.approx(value * scale)
    assert by_time[65]["el3008.valid"] == 1
    assert all(a["time"] < b["time"] for a, b in pairwise(rows))


def test_columns_with_paths_are_those_of_a_recording(tmp_path: Path, bus: Bus) -> None:
    path, out = make(tmp_path / "a.mcap", bus), tmp_path / "a.csv"
    options = ["incident", "export", str(path), "-o", str(out), "--paths", "--signal", "4/*"]
    incident(make_parser().parse_args(options))
    with out.open(newline="") as lines:
        head, *rows = csv.reader(lines)
    signals = [item for item in signals_of(bus) if item["slave"] == 4]
    own = [f"{it['name']} [{it['unit']}]" if it["unit"] else it["name"] for it in signals]
    assert head == ["time_s", "cycle", *own, "utc"]
    assert len(rows) == CYCLES - len(MISSING)
    assert rows[7][:2] == ["0.007000", str(FIRST + 7)]
    assert rows[7][-1] == "2025-11-24T16:00:00.007000Z"
    level = next(n for n, item in enumerate(signals, 2) if item["unit"] == "V")
    assert float(rows[29][level]) == pytest.approx(2900 * signals[level - 2]["scale"])
    assert {row[level] for row in rows[30:40]} == {""}
    again = export(out, tmp_path / "again.csv")  # a recording, as `ecatctl record` writes it
    assert again[7]["cycle"] == FIRST + 7
    with pytest.raises(UsageError, match="--paths"):
        incident(make_parser().parse_args([*options[:4], str(tmp_path / "x.mo"), "--paths"]))


def translated(folder: Path, *models: str) -> None:
    """Both front ends read the block and models of it."""
    assert list(check_syntax(folder)) == []
    stand_in = Path(ecatdev.checks.__file__).parent / "Modelica"
    shutil.copytree(stand_in, folder / "Modelica", dirs_exist_ok=True)
    for model in models:
        file = folder / f"{model}.mo"
        assert rumoca.Session(roots=[str(folder)]).load(str(file), model=model).outputs is not None
    shutil.rmtree(folder / "Modelica")


MODEL = """within ;
model Model "Yesterday's level in today's model"
  Yesterday yesterday(startTime = -yesterday.triggerTime) "Yesterday";
  Modelica.Blocks.Continuous.FirstOrder firstOrder(T = 0.01) "Lag";
  Integer channel = if yesterday.el1018Channel1Input then 1 else yesterday.goldGCONDriveStatusWord;
equation
  connect(yesterday.el3008AiStandardChannel1Value, firstOrder.u);
end Model;
"""


@pytest.fixture
def block(tmp_path: Path, bus: Bus) -> Path:
    """A folder with the block `Yesterday` and a model of it; it has been moved."""
    (tmp_path / "before").mkdir()
    export(make(tmp_path / "a.mcap", bus), tmp_path / "before" / "Yesterday.mo")
    (tmp_path / "before").rename(tmp_path / "library")
    (tmp_path / "library" / "Model.mo").write_text(MODEL)
    return tmp_path / "library"


def test_a_block_has_an_output_for_each_value(block: Path, bus: Bus) -> None:
    translated(block, "Yesterday", "Model")
    text = (block / "Yesterday.mo").read_text()
    found = parse(text).classes["Yesterday"].symbols
    kinds = {"el1018Channel1Input": "Boolean", "goldGCONDriveStatusWord": "Integer"}
    kinds |= {"el3008AiStandardChannel1Value": "Real", "el3008_2Valid": "Boolean"}
    kinds |= {"cycle": "Integer", "el2008Channel1Output": "Boolean"}
    for name, kind in kinds.items():
        assert str(found[name].type) == f"Modelica.Blocks.Interfaces.{kind}Output"
    names(text, 'quantity = "ElectricPotential", unit = "V"', "&lt;/p&gt; is lost")
    names(text, "triggerTime = 0.03\n", "duration = 0.1\n", "modelica://Yesterday/Yesterday.txt")
    table = (block / "Yesterday.txt").read_text()
    rows, columns = re.findall(r"^double recording\((\d+),(\d+)\)$", table, re.MULTILINE)[0]
    data = [line.split() for line in table.splitlines() if line[0].isdigit()]
    assert (len(data), {len(row) for row in data}) == (int(rows), {int(columns)})
    # What the block reads for an output is the column that the table describes with its name.
    heads = dict(re.findall(r"^# column (\d+): (\S+)", table, re.MULTILINE))
    outputs = re.findall(r"<td><code>(\w+)</code></td>.*?<td>(\d+)</td>", text)
    assert len(outputs) == int(columns) - 1 == len(signals_of(bus)) + 6
    for name, column in outputs:
        slave, _, member = heads[column].rstrip(":").partition(".")
        assert name == slave + member[:1].upper() + member[1:]


@needs_omc
@pytest.mark.long
@pytest.mark.timeout(300)
def test_openmodelica_reads_the_table(block: Path, bus: Bus) -> None:
    omc = OpenModelica(block, block)
    answer = omc.script(
        'loadModel(Modelica, {"4.0.0"});',
        'loadFile("Yesterday.mo");',
        'loadFile("Model.mo");',
        'buildModel(Model, outputFormat = "csv", startTime = -0.03);',
        "getErrorString();",
    )
    assert "Error:" not in answer, answer
    rows = simulate(block / "Model", 0.08, startTime="-0.03", stepSize="0.0005")
    (scale,) = {s["scale"] for s in signals_of(bus) if s["unit"] == "V"}
    level = "yesterday.el3008AiStandardChannel1Value"
    for at, value, valid in ((-0.0005, 2900, 1), (0.0055, 2900, 0), (0.0505, 8000, 1)):
        row = min(rows, key=lambda item: abs(item["time"] - at))
        assert (row[level], row["yesterday.el3008Valid"]) == (pytest.approx(value * scale), valid)


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_recording_of_each_kind(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"run{suffix}"
    columns = [Column("4/Channel 1/Value", "V", "float64"), Column("4/end", "", "int64")]
    with path.open("wb", buffering=0) as file:
        recording = open_recording(suffix, file, "ecat0", columns)
        for n, cells in enumerate([(0.5, 7), (1.5, None), (2.5, 9)]):
            recording.add(n * 0.002, 10 + 2 * n, cells, BEGIN_NS + n * 2_000_000)
        recording.end()
    rows = export(path, tmp_path / "again.csv")
    value, end = "slave4.channel1Value", "slave4.endEntry"
    assert [(row["time"], row["slave4.valid"], row[value], row[end]) for row in rows] == [
        (0, 1, 0.5, 7), (0.002, 0, 1.5, 7), (0.004, 1, 2.5, 9), (0.006, 0, 2.5, 9),
    ]  # fmt: skip
    (tmp_path / "m").mkdir()
    export(path, tmp_path / "m" / "Run.mo")
    translated(tmp_path / "m", "Run")
    names((tmp_path / "m" / "Run.mo").read_text(), "slave4Channel1Value(quantity =", "2025-11-24")


def test_a_file_needs_no_daemon(
    tmp_path: Path, bus: Bus, capsys: pytest.CaptureFixture[str]
) -> None:
    path = make(tmp_path / "a.mcap", bus)
    incident(make_parser().parse_args(["incident", "show", str(path)]))
    assert capsys.readouterr().out == "Slave 4 was lost.\n"
    with pytest.raises(UsageError, match="takes one NAME, not 2"):
        incident(make_parser().parse_args(["incident", "export", "a", "b", "-o", "c.csv"]))
    for suffix, head in (
        (".pcapng", b"\x0a\x0d\x0d\x0a"),
        (".json", b"[]"),
        (".mcap", b"\x89MCAP"),
    ):
        export(path, tmp_path / f"out{suffix}")
        assert (tmp_path / f"out{suffix}").read_bytes().startswith(head)
    with pytest.raises(UsageError, match=r"nosuch/b\.mcap is not a file"):
        export(tmp_path / "nosuch" / "b.mcap", tmp_path / "c.csv")


def test_files_and_folders_are_listed_and_shown_without_a_daemon(
    tmp_path: Path, bus: Bus, capsys: pytest.CaptureFixture[str]
) -> None:
    def said(*arguments: str) -> str:
        incident(make_parser().parse_args(["incident", *arguments]))
        return capsys.readouterr().out

    folder = tmp_path / "kept"
    folder.mkdir()
    asked = Trigger("request", BEGIN_NS + 40_000_000_000, "fred has asked for an incident")
    first = make(folder / "a.mcap", bus)
    last = make(folder / "b.mcap", bus, trigger=asked, cause="slave 4 (EL3008): too hot")
    other = make(tmp_path / "c.mcap", bus)
    (folder / "damaged.mcap").write_bytes(first.read_bytes()[:100])
    (folder / "notes.txt").touch()
    (tmp_path / "empty").mkdir()
    head, *lines = said("list", str(folder)).splitlines()
    names(head, "FILE", "TRIGGERED (UTC)", "LENGTH", "SIZE", "CAUSE")
    assert len(lines) == 2
    names(lines[0], str(first), "2025-11-24 16:00:00", "fault", "0.1 s", "slave 4", "is lost")
    names(lines[1], str(last), "16:00:40", "request", "fred has asked", "slave 4 (EL3008): too hot")
    listed = json.loads(said("--json", "list", str(other), str(folder)))["incidents"]
    assert [item["file"] for item in listed] == [str(other), str(first), str(last)]
    assert [item["cause"] for item in listed] == ["", "", "slave 4 (EL3008): too hot"]
    assert listed[0]["seconds"] == pytest.approx(0.099)
    assert said("show", str(folder)) == (
        f"{first}\nSlave 4 was lost.\n\n{last}\nSlave 4 was lost.\n"
    )
    shown = json.loads(said("--json", "show", str(other)))["incidents"]
    assert [(item["bus"], item["reading"]) for item in shown] == [(bus.name, "Slave 4 was lost.\n")]
    for name, why in (
        (folder / "damaged.mcap", "damaged.mcap: its head is damaged"),
        (tmp_path / "empty", "no incidents in"),
        (tmp_path / "nosuch", "neither a file nor a folder"),
    ):
        with pytest.raises(EcatError, match=why):
            said("list", str(name))


def test_yesterdays_values_are_inputs_of_an_fmu(tmp_path: Path, bus: Bus) -> None:
    """FMPy gives the voltage that was measured to a model, from a program and as a command."""
    path = make(tmp_path / "a.mcap", bus)
    # All names are those of the FMU of the bus, so its inputs can have yesterday's outputs.
    plant = generate_fmu(bus, "Plant", tmp_path, fmi=2).fmu
    known = {item.name for item in fmpy.read_model_description(str(plant)).modelVariables}
    assert {*export(path, tmp_path / "all.csv")[0]} - {"time", "unix_s"} <= known
    fmu = make_fmu(tmp_path, "2.0")
    rows = export(path, tmp_path / "a.csv", f"voltage={LEVEL}")
    assert [*rows[0]] == ["time", "cycle", "el3008.valid", "voltage", "unix_s"]
    given = fmpy.util.read_csv(tmp_path / "a.csv")
    result = fmpy.simulate_fmu(str(fmu), input=given, output_interval=0.001, stop_time=0.1)
    assert result["speed"][-1] > 0.5 * rows[-1]["voltage"] > 0
    done = subprocess.run(
        [
            *(sys.executable, "-m", "fmpy", "simulate", str(fmu), "--stop-time", "0.1"),
            *("--output-interval", "0.001", "--input-file", str(tmp_path / "a.csv")),
            *("--output-file", str(tmp_path / "out.csv")),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    with (tmp_path / "out.csv").open(newline="") as lines:
        *_, last = csv.DictReader(lines)
    assert float(last["speed"]) == pytest.approx(result["speed"][-1])


@pytest.mark.parametrize(
    ("out", "signals", "parts"),
    [
        ("a.csv", ["9/*"], ["9/*", "--signal"]),
        ("a.csv", ["u=2/*"], ["8 signals", "u can be one only"]),
        ("a.csv", ["u=2/*channel 1/*", "u=2/*channel 2/*"], ["'u'", "two columns"]),
        ("a.csv", ["2/*channel 1/*", "2/0x6000:01"], ["'el1018.channel1Input'", "two columns"]),
        ("Y.mo", ["model=2/0x6000:01"], ["'model'", "another one"]),
        ("Y.mo", ["a.b=2/0x6000:01"], ["'a.b'", "another one"]),
        ("y-1.mo", ["2/0x6000:01"], ["'y-1'", "Modelica"]),
        ("a.pcapng", ["2/0x6000:01"], ["--signal", ".csv"]),
    ],
)
def test_what_makes_no_table(
    tmp_path: Path, bus: Bus, out: str, signals: Sequence[str], parts: Sequence[str]
) -> None:
    path = make(tmp_path / "in.mcap", bus)
    with pytest.raises(UsageError) as caught:
        export(path, tmp_path / out, *signals)
    names(str(caught.value), *parts)
    assert [item.name for item in tmp_path.iterdir()] == ["in.mcap"]


def test_files_that_contradict_or_are_damaged(
    tmp_path: Path, bus: Bus, capsys: pytest.CaptureFixture[str]
) -> None:
    """What stands beside the values counts; a bus that makes no sense gives no names."""
    other = [{**s, "unit": "bar"} if s["unit"] == "V" else s for s in signals_of(bus)]
    signals = [TraceSignal(**item) for item in other]
    export(make(tmp_path / "unit.mcap", bus, signals), tmp_path / "Unit.mo", "4/*value")
    assert 'unit = "bar"' in (tmp_path / "Unit.mo").read_text()
    assert "ElectricPotential" not in (tmp_path / "Unit.mo").read_text()
    for number, document in enumerate(([], {"slaves": 7}, {**bus.to_dict(), "slaves": []})):
        path = make(tmp_path / f"{number}.mcap", bus, document=document)
        rows = export(path, tmp_path / "n.csv", "4/*channel 1/value", force=True)
        assert "slave4.aiStandardChannel1Value" in rows[0]
    names(capsys.readouterr().err, "warning: names come from the numbers of slaves")
    for text in ("", "a,b\n", "time_s,cycle,4/x\n", "time_s,cycle,4/x\n0,1,yes\n0.1,2\n"):
        (tmp_path / "bad.csv").write_text(text)
        with pytest.raises(EcatError):
            export(tmp_path / "bad.csv", tmp_path / "none.csv")


def test_no_name_of_a_slave_leaves_its_string(tmp_path: Path) -> None:
    hostile = '"; end Y; /* */ </html> \\ \n µ %name'
    bus = sample_buses.troll()
    for slave in bus.slaves:
        slave.name = hostile
    signals = [TraceSignal(**{**s, "unit": hostile, "name": f"{s['slave']}/{hostile}{n}"})
               for n, s in enumerate(signals_of(bus))]  # fmt: skip
    (tmp_path / "m").mkdir()
    export(make(tmp_path / "a.mcap", bus, signals), tmp_path / "m" / "Y.mo", "4/*", "0/*")
    translated(tmp_path / "m", "Y")

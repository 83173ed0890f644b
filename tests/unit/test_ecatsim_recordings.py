"""`ecatsim run --replay`: inputs have the values of a recording, each at its time."""

import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from conftest import names
from ecatd.base.errors import ConfigError, StateError, UsageError
from ecatd.cli.recordings import FORMATS, Cell, Column, open_recording
from ecatsim import replay
from ecatsim.replay import Replay
from ecatsim.rigs import library

HEAD = "time_s,cycle,2/Channel 1/Input (0x6000:01),4/Channel/Value (0x6000:11)"

BEGIN_NS = 1_764_000_000_123_456_789
"""Unix time of the first row."""


class Clock:
    """Stands for `time`."""

    now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(replay, "time", clock)
    return clock


def write(file: Path, rows: Sequence[tuple[float, int, Sequence[Cell]]]) -> Path:
    """Writes a recording as `ecatctl record` does."""
    columns = [Column(name, "", "int64") for name in HEAD.split(",")[2:]]
    with file.open("wb", buffering=0) as opened:
        recording = open_recording(file.suffix, opened, "ecat0", columns)
        for seconds, cycle, cells in rows:
            recording.add(seconds, cycle, cells, BEGIN_NS + round(1e9 * seconds))
        recording.end()
    return file


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize(("repeat", "at_5_ms"), [(False, (1, 12)), (True, (1, -5))])
def test_each_value_comes_at_its_time(
    tmp_path: Path, clock: Clock, repeat: bool, at_5_ms: tuple[int, int], suffix: str
) -> None:
    rows = [(0, 7, (1, -5)), (0.001, 8, (0, None)), (0.003, 10, (1, 12))]
    file = write(tmp_path / f"run{suffix}", rows)
    rig = library.make("troll")
    Replay(file, rig, repeat=repeat)
    digital, analog = rig.devices[2], rig.devices[4]
    # An empty cell keeps the value before, and a row stays until the next one comes.
    for ms, wanted in (
        (0.0, (1, -5)),
        (0.5, (1, -5)),
        (1.5, (0, -5)),
        (2.5, (0, -5)),
        (3.5, (1, 12)),
        (5.0, at_5_ms),  # repeated, the recording lasts 4.5 ms
    ):
        clock.now = 100.0 + 1e-3 * ms
        digital.give()
        analog.give()
        assert (digital[0x6000, 1], analog[0x6000, 0x11]) == wanted


def test_rows_have_the_time_of_the_clock_on_the_wall(tmp_path: Path) -> None:
    from mcap.reader import make_reader
    from pyarrow import parquet

    rows = [(0, 7, (1, -5)), (0.5, 8, (0, None))]
    head, first, second = write(tmp_path / "run.csv", rows).read_text().splitlines()
    assert head == f"{HEAD},utc"
    assert first == "0.000000,7,1,-5,2025-11-24T16:00:00.123456Z"
    assert second == "0.500000,8,0,,2025-11-24T16:00:00.623456Z"
    times = parquet.read_table(write(tmp_path / "run.parquet", rows))["utc"]
    assert [time.isoformat() for time in times.to_pylist()] == [
        "2025-11-24T16:00:00.123456+00:00",
        "2025-11-24T16:00:00.623456+00:00",
    ]
    with write(tmp_path / "run.mcap", rows).open("rb") as file:
        messages = [message for _, _, message in make_reader(file).iter_messages()]
    assert [message.log_time - BEGIN_NS for message in messages] == [0, 500_000_000]


@pytest.mark.parametrize(
    ("text", "tokens"),
    [
        ("", ("not a recording",)),
        (f"{HEAD}\n", ("no values",)),
        ("time_s,cycle,2/Channel 1/Input\n0,1,1\n", ("2/Channel 1/Input", "--raw")),
        ("time_s,cycle,99/X (0x6000:01)\n0,1,1\n", ("slave 99", "troll")),
        ("time_s,cycle,1/X (0x6000:01)\n0,1,1\n", ("slave 1 (EK1100)", "1/X (0x6000:01)")),
        ("time_s,cycle,3/X (0x7000:01)\n0,1,1\n", ("no column is an input",)),
        (f"{HEAD}\n0,1,1\n", (":2", "values")),
        (f"{HEAD}\n0,1,x,1\n", (":2", "values")),
        (f"{HEAD}\n0,1,1,99999\n", (":2", "values")),
        (f"{HEAD}\n0,1,1,1\n0,2,1,1\n", (":3", "ascend")),
    ],
)
def test_other_files_are_refused(tmp_path: Path, text: str, tokens: tuple[str, ...]) -> None:
    file = tmp_path / "run.csv"
    file.write_text(text)
    with pytest.raises(ConfigError) as caught:
        Replay(file, library.make("troll"))
    assert str(caught.value).startswith(str(file))
    for token in tokens:
        assert token in str(caught.value)


def test_a_file_that_is_missing() -> None:
    with pytest.raises(UsageError) as caught:
        Replay(Path("/nowhere.csv"), library.make("troll"))
    names(caught.value, "'/nowhere.csv'")


@pytest.mark.parametrize("suffix", FORMATS)
def test_damaged_files_are_refused(tmp_path: Path, suffix: str) -> None:
    file = write(tmp_path / f"run{suffix}", [(0.001 * n, n, (1, n)) for n in range(20)])
    data = file.read_bytes()
    for damaged in (b"", data[len(data) // 2 :], b"\xff" + data[1 : len(data) // 2]):
        file.write_bytes(damaged)
        with pytest.raises(ConfigError) as caught:
            Replay(file, library.make("troll"))
        assert str(caught.value).startswith(f"{file}:")


@pytest.mark.parametrize(
    ("suffix", "package", "extra"),
    [("mcap", "mcap", "record"), ("parquet", "pyarrow", "parquet")],
)
def test_a_library_that_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, package: str, extra: str
) -> None:
    file = write(tmp_path / f"run.{suffix}", [(0, 7, (1, -5))])
    for name in [name for name in sys.modules if name.partition(".")[0] == package]:
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(StateError) as caught:
        Replay(file, library.make("troll"))
    names(caught.value, str(file), package, f"ecatd[{extra}]", "CSV")

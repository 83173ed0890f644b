"""What is whole in a damaged recording or incident is read, and the damage is told."""

from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from conftest import names
from ecatd.base.incident_file import IncidentFile
from ecatd.base.mcap_file import DamagedError
from ecatd.base.recording_file import RecordingFile, recorded_rows
from ecatd.cli.incident import incident
from ecatd.cli.main import make_parser
from ecatd.cli.recordings import Column, open_recording
from ecatd.operations.traces import TraceSignal
from ecatd.recorder.incident import Incident, Row, Trigger, write
from ecatd.web.file_source import FileSource
from ecatd.web.incident import RecordedIncident

pytest.importorskip("mcap")

WRITER = """
import os, pathlib, random, sys
from ecatd.cli.recordings import Column, open_recording
file = open(sys.argv[1], "wb", buffering=0)
columns = [Column(f"4/Value {n} (0x6000:{n:02X})", "V", "float64") for n in range(1, 30)]
recording = open_recording(".mcap", file, "ecat0", columns)
for cycle in range(6000):
    recording.add(cycle / 1000, cycle, [random.random() for _ in columns], 10**18 + cycle * 10**6)
os.kill(os.getpid(), 9)
"""


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording whose writer was killed."""
    path = tmp_path_factory.mktemp("killed") / "k.mcap"
    done = subprocess.run([sys.executable, "-c", WRITER, str(path)], check=False)
    assert done.returncode == -signal.SIGKILL
    return path


def _cycles(path: Path) -> tuple[list[int], str]:
    found: list[int] = []
    try:
        for _, cycle, _ in RecordingFile(path).cycles():
            found.append(cycle)
    except DamagedError as error:
        return found, str(error)
    return found, ""


def test_a_recording_whose_writer_was_killed_is_read(killed: Path) -> None:
    found, said = _cycles(killed)
    assert len(found) > 1000
    assert found == [*range(len(found))]
    names(said, "ends in the middle", f"{len(found)} cycles", "2001-09-09")
    told: list[str] = []
    rows = [*recorded_rows(killed, told.append)]
    assert (len(rows), told) == (len(found) + 1, [said])
    source = FileSource(killed)
    names(source._contents.about, "ends in the middle")
    parts = source._parts([signal["name"] for signal in source._contents.signals])
    shown = 0
    with pytest.raises(Exception, match="ends in the middle"):
        for part in parts:
            shown += len(part.numbers)
    assert shown == len(found)


def test_flipped_bytes_cost_their_chunk_only(tmp_path: Path) -> None:
    path = tmp_path / "r.mcap"
    columns = [Column(f"4/Value {n} (0x6000:{n:02X})", "V", "float64") for n in range(1, 30)]
    with io.FileIO(path, "w") as file:
        recording = open_recording(".mcap", file, "ecat0", columns)
        for cycle in range(6000):
            cells = [int.from_bytes(os.urandom(4), "little") / 7 for _ in columns]
            recording.add(cycle / 1000, cycle, cells, 10**18 + cycle * 10**6)
        recording.end()
    whole, said = _cycles(path)
    assert (len(whole), said) == (6000, "")
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    found, said = _cycles(path)
    assert 1000 < len(found) < 6000
    assert found[0] == 0
    assert found[-1] == 5999
    names(said, "is damaged at byte", f"{len(found)} cycles")


def test_a_damaged_incident_is_shown_with_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "i.mcap"
    rows = [Row(n, 10**18 + n * 10**6, 80.0, 0, [n / 7]) for n in range(60000)]
    signal = TraceSignal(
        name="4/Value", slave=4, address="0x6000:11", output=False, type="float64",
        unit="V", scale=1.0, offset=0.0,
    )  # fmt: skip
    trigger = Trigger("request", 10**18, "somebody has asked")
    found = Incident("ecat0", [trigger], [signal], rows, [], [], ["eth0"], [], 0, "All is lost.\n")
    write(path, found)
    whole = path.read_bytes()
    data = bytearray(whole)
    data[IncidentFile(path)._file._chunks[0] + 400] ^= 0xFF
    path.write_bytes(data)
    damage = IncidentFile(path).damage()
    names(damage, "is damaged at byte")
    incident(make_parser().parse_args(["incident", "show", str(path)]))
    said = capsys.readouterr()
    assert said.out == "All is lost.\n"
    assert said.err == f"ecatctl: warning: {damage}\n"
    names(RecordedIncident(IncidentFile(path)).about, damage)
    out = tmp_path / "i.csv"
    incident(make_parser().parse_args(["incident", "export", str(path), "-o", str(out)]))
    assert f"ecatctl: warning: {damage}\n" in capsys.readouterr().err
    assert 1000 < len(out.read_text().splitlines()) < 60000
    # Half of a copy: the reading, which stands at the end, is missing.
    path.write_bytes(whole[: len(whole) // 2])
    incident(make_parser().parse_args(["incident", "show", str(path)]))
    said = capsys.readouterr()
    names(said.out, "has no reading.txt")
    names(said.err, "ends in the middle")


def test_what_is_no_file_of_this_kind_says_so(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    for data in (b"", b"time_s,cycle\n", bytes(5000)):
        path.write_bytes(data)
        for kind in (RecordingFile, IncidentFile):
            with pytest.raises(ValueError, match="no MCAP file"):
                kind(path)

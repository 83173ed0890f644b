"""Recordings and incidents that are none, are cut short or damaged, or are no files."""

import json
import os
from pathlib import Path

import pytest

from conftest import names
from ecatd.base.errors import ConfigError, UsageError
from ecatd.base.incident_file import FIELDS, SIGNALS, IncidentFile
from ecatd.base.recording_file import SCHEMA, recorded_rows
from ecatd.operations.incident_files import read_head
from ecatd.web.file_source import FileSource

writer = pytest.importorskip("mcap.writer", reason="needs the package mcap")
RAW = ("Exceeded", "Invalid", "Error", "(b'", "unpack", "opcode")
"""What no user should have to read."""


def recording(path: Path, data: bytes = b'{"cycle": 1, "values": {"0/a (0x6000:01)": 1}}') -> Path:
    with path.open("wb") as file:
        made = writer.Writer(file)
        made.start()
        schema = made.register_schema(SCHEMA, "jsonschema", b"{}")
        channel = made.register_channel("cycle", "json", schema)
        for number in range(1000):
            made.add_message(channel, number * 1_000_000, data, number * 1_000_000)
        made.finish()
    return path


def incident(path: Path, data: bytes) -> Path:
    signal = {"name": "0/a", "address": "0x6000:01", "type": "uint64", "unit": "", "slave": 0}
    signal |= {"field": "cycle", "raw": "cycle", "scale": 1.0, "offset": 0.0, "output": False}
    with path.open("wb") as file:
        made = writer.Writer(file)
        made.start()
        facts = {SIGNALS: json.dumps([signal]), FIELDS: json.dumps([["cycle", "uint64"]])}
        channel = made.register_channel("ecatd/ecat0/cycles", "protobuf", 0, facts)
        made.add_message(channel, 1, data, 1)
        made.finish()
    return path


def told(path: Path) -> list[str]:
    """What is said of a file by those who convert it."""
    said: list[str] = []
    try:
        list(recorded_rows(path, said.append))
    except (ConfigError, OSError) as error:
        said.append(str(error))
    return said


def test_what_is_wrong_with_a_recording_is_told_in_words(tmp_path: Path) -> None:
    whole = recording(tmp_path / "run.mcap").read_bytes()
    assert told(tmp_path / "run.mcap") == []
    FileSource(tmp_path / "run.mcap")
    middle = len(whole) // 4
    for content, *why in (
        (b"no recording", "is no MCAP file", "ecatctl record"),
        (b"", "is no MCAP file"),
        (whole[: len(whole) // 2], "ends in the middle"),
        (whole[:8], "ends in the middle"),
        (whole[:8] + b"\xff" * middle + whole[8 + middle :], "damaged"),
    ):
        path = tmp_path / "wrong.mcap"
        path.write_bytes(content)
        (text,) = told(path)
        names(text, "wrong.mcap", *why)
        assert not [raw for raw in RAW if raw in text], text
    for data in (b"no JSON", b"{}", b"[]"):
        (text,) = told(recording(tmp_path / "content.mcap", data))
        names(text, "content.mcap", "not a recording")
        assert not [raw for raw in RAW if raw in text], text


@pytest.mark.parametrize(("data", "why"), [(b"\x09", "too short"), (b"\x09" + bytes(9), "long")])
def test_a_damaged_cycle_of_an_incident_is_told_in_words(
    tmp_path: Path, data: bytes, why: str
) -> None:
    found = IncidentFile(incident(tmp_path / "incident.mcap", data))
    with pytest.raises(ValueError, match="is damaged") as told:
        list(found.cycles())
    names(str(told.value), "a cycle", why)


@pytest.mark.parametrize("name", ["pipe.mcap", "pipe.csv", "pipe.parquet"])
def test_a_pipe_or_a_folder_is_no_recording(tmp_path: Path, name: str) -> None:
    if name.endswith("parquet"):
        pytest.importorskip("pyarrow", reason="needs the package pyarrow")
    path = tmp_path / name
    os.mkfifo(path)
    names(*told(path), "not a regular file")
    if name.endswith("mcap"):
        with pytest.raises(UsageError, match="not a regular file"):
            FileSource(path)
    with pytest.raises(OSError, match="not a regular file"):
        read_head(path)
    path.unlink()
    path.mkdir()
    names(*told(path), "folder")

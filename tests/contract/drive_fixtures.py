"""Fixtures of the tests of EtherCAT.Drives.CiA402; a plugin of pytest, as two files need them."""

import ctypes
from collections.abc import Iterator
from pathlib import Path

import pytest
from drive_calls import ELMO, RIG, Play, Player, Record, build, records

from conftest import Daemon


@pytest.fixture(scope="module")
def record_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("record") / "drives.csv"


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory, record_file: Path) -> Iterator[Daemon]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DRIVES_RECORD", str(record_file))
        folder = tmp_path_factory.mktemp("drives")
        daemon = Daemon(folder, str(RIG), cycle_time_us=1000).wait_ready()
    yield daemon
    assert daemon.stop() == 0
    daemon.close()


@pytest.fixture(scope="module")
def calls(tmp_path_factory: pytest.TempPathFactory, compiler: str, drives: Daemon) -> ctypes.CDLL:
    folder = tmp_path_factory.mktemp("calls")
    drives.ctl("generate", "Plant", str(folder))
    return build(folder, compiler, folder)


@pytest.fixture(scope="module")
def play(calls: ctypes.CDLL, drives: Daemon) -> Play:
    """Starts to play a drive: `play(settings, slave, start_up)`."""
    return lambda drive, slave=ELMO, rows=(): Player(calls, drives.bus, slave, drive, rows)


@pytest.fixture
def record(record_file: Path) -> Record:
    """What the simulator has recorded of a drive since the test began."""
    start = record_file.stat().st_size if record_file.exists() else 0

    def read(slave: int) -> list[dict[str, float]]:
        return records(record_file, slave, start)

    return read

"""Fixtures of the tests of SDO blocks; a plugin of pytest, as several files need them."""

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from sdo_calls import RIG, Run, build, run

from conftest import Daemon


@pytest.fixture(scope="module")
def bus(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    """A daemon whose first slave has objects of all types, and whose third one does not answer."""
    daemon = Daemon(tmp_path_factory.mktemp("objects"), RIG, cycle_time_us=1000).wait_ready()
    yield daemon
    assert daemon.stop() == 0
    daemon.close()


@pytest.fixture
def call(tmp_path: Path, compiler: str, bus: Daemon) -> Run:
    """Runs statements in C against the library EtherCAT and the live bus."""

    def call_(statements: str, functions: str = "") -> "subprocess.CompletedProcess[str]":
        return run(build(tmp_path, compiler, statements, functions=functions), bus.bus)

    return call_

"""Models that OpenModelica simulates while there is no bus, wherever it is installed."""

import uuid
from collections.abc import Callable
from pathlib import Path

import pytest
from plant_calls import CONTINUE, MISSING, NOT_AVAILABLE, OP, OPERATIONAL, WAIT

from conftest import Daemon, names
from ecatdev import sample_buses
from ecatgen import generate
from openmodelica import OpenModelica, Row, needs_omc, read_csv, result_of, start, until

pytestmark = [needs_omc, pytest.mark.long, pytest.mark.bus, pytest.mark.timeout(900)]

DIGITAL_OUTPUTS = 3
STATES = ("connected", "state", "workingCounter", "workingCounterExpected")


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An example whose outputs are wired to its inputs, and which the bus paces."""
    folder = tmp_path_factory.mktemp("omc")
    generate(sample_buses.troll(), "TrollPlant", folder / "libraries")
    return OpenModelica(folder, folder / "libraries").build("EtherCAT.Examples.DigitalIO")


@pytest.fixture
def serve(start_daemon: Callable[..., Daemon]) -> Callable[[str], Daemon]:
    """Starts a daemon for a bus of this name."""

    def serve(name: str) -> Daemon:
        daemon = start_daemon("troll", "--bus", name)
        daemon.bus = name
        return daemon

    return serve


@pytest.fixture
def name() -> str:
    return f"t{uuid.uuid4().hex[:10]}"


def history(rows: list[Row]) -> list[tuple[float, ...]]:
    """What the model knew of the bus, and of a slave, without repetitions."""
    known = [
        (*(row[f"etherCATMaster.{state}"] for state in STATES), row["el1018.alState"])
        for row in rows
    ]
    return [after for before, after in zip([None, *known], known, strict=False) if before != after]


def writes(daemon: Daemon) -> Callable[[], bool]:
    """Whether the model writes its outputs."""

    def condition() -> bool:
        with daemon.client() as client:
            client.wait(1)
            client.sample()
            return client.output(client.signal(f"{DIGITAL_OUTPUTS}/0x7000:01")).owner is not None

    return condition


def test_a_model_begins_without_a_bus(
    program: Path, name: str, serve: Callable[[str], Daemon]
) -> None:
    with start(program, 20, bus=name, etherCATMaster__whenMissing=f"{CONTINUE}") as process:
        serve(name)
        log, _ = process.communicate()
    assert process.returncode == 0, log
    names(log, "not running", f"'{name}'", "goes on", "is there")
    rows = read_csv(result_of(program))
    assert history(rows)[0] == (0, MISSING, 0, 0, NOT_AVAILABLE)
    assert history(rows)[-1] == (1, OPERATIONAL, 8, 8, OP)
    assert not any(row["el1018.valid"] or row["el1018.y[1]"] for row in rows[:1])
    assert any(row["el1018.valid"] and row["el1018.y[1]"] for row in rows)
    assert all(row["el1018.valid"] for row in rows if row["etherCATMaster.state"] == OPERATIONAL)
    assert not any(row["el1018.valid"] for row in rows if not row["etherCATMaster.connected"])


@pytest.mark.parametrize("failed", [WAIT, CONTINUE])
def test_a_daemon_is_killed_and_comes_back(
    program: Path, name: str, serve: Callable[[str], Daemon], failed: int
) -> None:
    daemon = serve(name)
    # A model that goes on needs time enough for the second daemon to begin.
    stop_time = {WAIT: 8, CONTINUE: 30}[failed]
    with start(program, stop_time, bus=name, etherCATMaster__whenFailed=f"{failed}") as process:
        until(writes(daemon), process)
        daemon.kill_all()
        serve(name)
        log, _ = process.communicate()
    assert process.returncode == 0, log
    assert ("the model waits for it" in log) == (failed == WAIT)
    rows = read_csv(result_of(program))
    states = [state for _, state, *_ in history(rows)]
    assert states[-1] == OPERATIONAL
    assert (MISSING in states) == (failed == CONTINUE)
    assert any(row["el1018.y[1]"] for row in rows[-1000:])  # its outputs arrive again


def test_a_daemon_is_killed(program: Path, name: str, serve: Callable[[str], Daemon]) -> None:
    daemon = serve(name)
    with start(program, 60, bus=name) as process:
        until(writes(daemon), process)
        daemon.kill_all()
        log, _ = process.communicate()
    assert process.returncode != 0
    assert "EtherCAT: the " in log
    assert "has ended; start it again" in log or "stands still since" in log

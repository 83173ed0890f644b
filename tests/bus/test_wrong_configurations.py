"""Configurations that do not fit their bus: ecatd ends before any slave gets process data."""

from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon, names, one_line_error

pytestmark = pytest.mark.bus

RIG = str(Path(__file__).parents[1] / "rigs" / "states.py")
COPY = "[[copy]]\nslave = {}\nentry = '0x7000:01'\nfrom_slave = 1\nfrom_entry = '{}'\n"


@pytest.fixture
def states(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file with all states to which slaves were taken."""
    file = tmp_path / "states"
    monkeypatch.setenv("STATES", str(file))
    return file


def test_a_bus_that_fits_goes_to_op(start_daemon: Callable[..., Daemon], states: Path) -> None:
    daemon = start_daemon(RIG, config=COPY.format(2, "0x6000:01"))
    assert daemon.stop() == 0
    assert {"PREOP", "SAFEOP", "OP"} <= set(states.read_text().split())


@pytest.mark.parametrize(
    ("config", "tokens"),
    [
        (COPY.format(9, "0x6000:01"), ["slave 9", "3 slaves"]),
        pytest.param(
            COPY.format(2, "0x6FFF:01"),
            ["slave 1 (EL1008)", "0x6FFF:01", "ecatctl pdos 1"],
            marks=pytest.mark.long,
        ),
        pytest.param(
            "[[signal]]\nslave = 7\nentry = '0x7000:01'\n",
            ["slave 7", "3 slaves"],
            marks=pytest.mark.long,
        ),
        pytest.param(
            "[[signal]]\nslave = 2\nentry = '0x7FFF:01'\n",
            ["slave 2 (EL2008)", "0x7FFF:01"],
            marks=pytest.mark.long,
        ),
        pytest.param(
            "[[outputs.safe]]\nslave = 1\n",
            ["slave 1 (EL1008)", "no outputs"],
            marks=pytest.mark.long,
        ),
        ("[[outputs.safe]]\nslave = 2\nvalue = 'disable'\n", ["slave 2 (EL2008)", "controlword"]),
        pytest.param(
            "[[domain]]\n[[domain]]\nslaves = [5]\n",
            ["slave 5", "3 slaves"],
            marks=pytest.mark.long,
        ),
        pytest.param("[dc]\nenabled = true\nreference = 8\n", ["slave 8"], marks=pytest.mark.long),
        pytest.param(
            "[[slave]]\nposition = 1\n[[slave.startup]]\nobject = '0x2000:00'\nhex = '00'\n",
            ["ecat.toml:3", "slave[0].startup[0]", "slave 1 (EL1008)", "CoE", "remove"],
            marks=pytest.mark.long,
        ),
        pytest.param(
            "[[slave]]\nposition = 2\npdos = ['0x16FF']\n",
            ["ecat.toml:3", "slave[0].pdos", "slave 2 (EL2008)", "0x16FF", "0x1600"],
            marks=pytest.mark.long,
        ),
        (
            "[[domain]]\nslaves = [1]\n[[domain]]\ndivider = 200\nslaves = [2]\n",
            ["ecat.toml:4", "domain[1].divider", "slave 2 (EL2008)", "100 ms", "watchdog_ms"],
        ),
    ],
)
def test_no_slave_leaves_preop(
    start_daemon: Callable[..., Daemon], states: Path, config: str, tokens: list[str]
) -> None:
    status, log = start_daemon(RIG, config=config, ready=False).wait_end()
    # A slave that is not there may come later.
    assert status == (7 if "there is no slave" in log else 2), log
    names(one_line_error(log, "ecatd"), *tokens)
    assert set(states.read_text().split()) <= {"INIT", "PREOP"}

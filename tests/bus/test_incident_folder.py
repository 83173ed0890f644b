"""Where incidents are: a full disk, a storm of faults, limits, and what is not installed."""

import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from conftest import Daemon, names, one_line_error, wait_for
from ecatd.operations.incident_files import incidents
from ecatsim.control import Simulator

pytestmark = pytest.mark.bus
pytest.importorskip("mcap")

SETTINGS = """
[flight_recorder]
folder = "{folder}"
before_s = 0.2
after_s = 0.1
per_hour = 8
disk_mb = 1
lapses = false
"""


@pytest.fixture
def folder(small_disk: Path) -> Path:
    return small_disk / "incidents"


@pytest.fixture
def daemon(start_daemon: Callable[..., Daemon], folder: Path) -> Iterator[Daemon]:
    daemon = start_daemon("line:1", config=SETTINGS.format(folder=folder))
    wait_for(folder.is_dir, daemon)
    wait_for(lambda: daemon.ctl_json("stats")["cycles"] > 100, daemon)
    return daemon


def readings(daemon: Daemon) -> str:
    found = daemon.ctl_json("incident", "list")["incidents"]
    return "\n".join(daemon.ctl("incident", "show", item["name"]).stdout for item in found)


def test_the_disk_is_full_and_faults_do_not_end(daemon: Daemon, folder: Path) -> None:
    def cycles() -> int:
        return int(daemon.ctl_json("stats")["cycles"])

    (folder.parent / "full").write_bytes(bytes(90 << 10))
    with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        simulator.faults.drop(count=2)
        wait_for(lambda: "cannot write incidents" in daemon.log, daemon)
        names(daemon.log, str(folder), "No space left on device", "make room on its disk")
        assert [*folder.iterdir()] == []
        before = cycles()
        wait_for(lambda: cycles() > before + 10, daemon)  # the bus goes on

        resized = ["mount", "-o", "remount,size=20m", str(folder.parent)]
        subprocess.run(resized, check=True)
        # A busy machine has faults of its own, too.
        while "flight_recorder.per_hour" not in daemon.log:
            simulator.faults.drop(count=2)
            start = cycles()
            wait_for(lambda: cycles() > start + 100, daemon)  # noqa: B023
        names(daemon.log, "no incident is written about", "of this cause", "`ecatctl events`")
        # A cause that comes again and again leaves room for another one.
        simulator.faults.al_error(0, code=0x001B)
        wait_for(lambda: "recovery: slave 0" in readings(daemon), daemon)

    asked = daemon.ctl_json("incident", "record", "still works")
    assert len(incidents(folder, daemon.bus)) <= 9
    # Somebody's files fill the room that incidents may have: the oldest ones go.
    old = [folder / f"{daemon.bus}-200{n}0101T000000.000000Z.mcap" for n in (1, 2)]
    for path in old:
        path.write_bytes(bytes(600 << 10))
    (folder / "mine.mcap").write_bytes(bytes(600 << 10))
    daemon.ctl("incident", "record", "one more")
    wait_for(lambda: "the oldest were deleted" in daemon.log, daemon)
    names(daemon.log, "flight_recorder.disk_mb = 1", old[0].name)
    assert [path.exists() for path in (*old, folder / "mine.mcap")] == [False, True, True]
    assert (folder / asked["name"]).exists()


def test_a_folder_that_cannot_be_written_is_told_at_once(
    start_daemon: Callable[..., Daemon],
) -> None:
    daemon = start_daemon("line:1", config=SETTINGS.format(folder="/proc/none"))
    for _ in range(3):
        asked = daemon.ctl("incident", "record", check=False)
        assert asked.returncode == 7
        names(one_line_error(asked.stderr, "ecatctl"), "/proc/none", "flight_recorder.folder")
    with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        simulator.faults.al_error(0, code=0x001B)
        wait_for(lambda: daemon.ctl_json("events", "--kind", "recovery")["events"], daemon)
        before = daemon.ctl_json("stats")["cycles"]
        wait_for(lambda: daemon.ctl_json("stats")["cycles"] > before + 500, daemon)
    assert daemon.log.count("cannot write incidents") == 1


def test_the_package_that_writes_files_is_not_installed(
    start_daemon: Callable[..., Daemon], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The bus runs, and the log says what to install."""
    hide = "import sys; sys.modules['mcap'] = None"
    (tmp_path / "sitecustomize.py").write_text(hide)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    daemon = start_daemon("line:1", config=SETTINGS.format(folder=tmp_path / "x"))
    wait_for(lambda: "pip install 'ecatd[record]'" in daemon.log, daemon)
    names(daemon.log, "the flight recorder needs the package mcap", "no incidents")
    before = daemon.ctl_json("stats")["cycles"]
    wait_for(lambda: daemon.ctl_json("stats")["cycles"] > before + 10, daemon)
    assert not (tmp_path / "x").exists()

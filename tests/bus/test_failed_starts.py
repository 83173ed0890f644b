"""A start that fails again and again is tried less and less often, until one succeeds.

The service manager is this test: it starts ecatd again each time, and reads what it is told.
"""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from conftest import PATIENCE, Daemon, names, run_module, stop_process
from ecatd.base.failure_record import read_record
from ecatd.base.log import Log
from ecatd.service.failed_starts import FailedStarts

pytestmark = pytest.mark.bus

BUS = f"tfailed{os.getpid()}"
NOBODY = ("--interface", "eth77")


class Manager:
    """A service manager with one service.

    Attributes:
        told: What the service has told it last.
        log: What the service has written to the log last.
        folder: Where its files are.
    """

    def __init__(self, folder: Path) -> None:
        self.told: list[str] = []
        self.log = ""
        self.folder = folder
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(folder / "notify"))
        self._socket.settimeout(PATIENCE)

    def close(self) -> None:
        self._socket.close()

    def run(self, *options: str, until: str = "", number: signal.Signals = signal.SIGHUP) -> int:
        """Starts the service; returns its exit status.

        Args:
            options: Its options.
            until: It gets a signal when it has told something with this; empty: it gets none.
            number: The signal.
        """
        env = {
            **os.environ,
            "ECATD_RUNTIME_DIR": str(self.folder / "run"),
            "NOTIFY_SOCKET": str(self.folder / "notify"),
        }
        command = [sys.executable, "-m", "ecatd.service", "--bus", BUS, *options]
        self.told = []
        with subprocess.Popen(command, env=env, stderr=subprocess.PIPE, text=True) as service:
            try:
                while until and not any(until in line for line in self.told):
                    self.told += self._read(PATIENCE)
                if until:
                    service.send_signal(number)
                _, self.log = service.communicate(timeout=PATIENCE)
            finally:
                service.kill()
        with suppress(BlockingIOError):
            while True:
                self.told += self._read(0)
        return service.returncode

    def _read(self, patience: float) -> list[str]:
        self._socket.settimeout(patience)
        return self._socket.recv(4096).decode().splitlines()

    def fail_at_once(self) -> None:
        """A first start, which fails; the service does not wait."""
        assert self.run(*NOBODY) == 3
        assert not any("next try" in text for text in (*self.told, self.log))

    def fail_and_wait(self, number: signal.Signals = signal.SIGHUP) -> int:
        """A further start, which fails; while the service waits, it gets a signal."""
        return self.run(*NOBODY, until="next try", number=number)

    @property
    def next_s(self) -> int:
        """The seconds until the next try, as the log says."""
        (text,) = re.findall(r"next try in (\d+) s", self.log)
        return int(text)

    def ctl(self, command: str) -> str:
        """What a command of `ecatctl` says meanwhile."""
        env = {**os.environ, "ECATD_RUNTIME_DIR": str(self.folder / "run")}
        done = run_module("ecatd.cli", "--bus", BUS, command, env=env)
        assert done.returncode != 0
        return done.stdout + done.stderr


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[Manager]:
    found = Manager(tmp_path)
    yield found
    found.close()


@pytest.mark.long
def test_r46_the_pause_grows_until_somebody_stops_the_service(manager: Manager) -> None:
    manager.fail_at_once()  # `systemctl start` returns, and says so
    for next_s in (4, 8, 16, 30, 30):
        assert manager.fail_and_wait() == 3, "SIGHUP ends the wait"
        assert manager.next_s == next_s
        status = next(line for line in manager.told if "next try" in line)
        names(status, "eth77", BUS)
        assert re.search(r"next try at \d\d:\d\d:\d\d$", status)
        names(manager.log, "eth77", "next try", f"{next_s} s", status.rpartition(" ")[2])
        *_, extended = [line for line in manager.told if line.startswith("EXTEND_TIMEOUT_USEC=")]
        assert int(extended.partition("=")[2]) > next_s * 1_000_000
    assert manager.fail_and_wait(signal.SIGTERM) == 0
    manager.fail_at_once()  # it is counted from the beginning
    assert manager.fail_and_wait() == 3
    assert manager.next_s == 4


def test_r46_a_start_that_succeeds_ends_the_counting(manager: Manager) -> None:
    manager.fail_at_once()
    assert manager.fail_and_wait() == 3
    assert manager.run("--simulate", "troll", until="READY=1", number=signal.SIGTERM) == 0
    manager.fail_at_once()


def test_r46_ecatctl_says_why_and_when_the_next_try_is(manager: Manager) -> None:
    manager.fail_at_once()
    assert manager.fail_and_wait() == 3
    file = manager.folder / f"run/{BUS}/failed_starts"
    assert file.stat().st_mode & 0o777 == 0o640
    at = time.strftime("%H:%M:%S", time.localtime(json.loads(file.read_text())["next_time"]))
    for command in ("check", "slaves", "doctor"):
        names(manager.ctl(command), "failed 2 times", "'eth77'", at, f"ecatd@{BUS}")
    assert manager.fail_and_wait(signal.SIGTERM) == 0
    assert "eth77" not in manager.ctl("check")


@pytest.mark.long
def test_a_start_may_take_longer_than_systemd_gives_it(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    """A drive answers late, many times. The bus server says that it works, unless it hangs."""
    rig = tmp_path / "rig.toml"
    rig.write_text(
        '[[slave]]\ndevice = "CiA402"\n'
        '[[fault]]\nkind = "mailbox"\nslave = 0\nmode = "slow"\ndelay_s = 3.0\n'
    )
    config = "[[slave]]\nposition = 0\nmailbox_timeout_ms = 9000\n"
    daemon = start_daemon(str(rig), config=f"{config}[gateway]\nlisten = []\n", ready=False)
    more = [daemon.told() for _ in range(3)]
    for lines in more:
        assert lines == ["EXTEND_TIMEOUT_USEC=60000000"], daemon.log
    hung = daemon.child_pid("ecatd.server")
    stop_process(hung)
    assert [] in [daemon.told(6) for _ in range(3)], "nobody works on the start"
    os.kill(hung, signal.SIGCONT)
    assert daemon.told() == more[0]
    assert daemon.stop() == 0


def test_damage_to_the_record_does_no_harm(tmp_path: Path) -> None:
    starts, file = FailedStarts(tmp_path, Log("ecatd")), tmp_path / "failed_starts"
    whole = {"starts": 99, "next_time": 1e9, "reason": "no carrier"}
    damaged = ({"starts": -7}, {"starts": "many"}, {"next_time": 1e300}, {"next_time": None})
    texts = [json.dumps(whole | damage) for damage in damaged]
    for text in (*texts, "", "[]", "7", "\0\xff", "9" * 5000, "[" * 100000):
        file.write_text(text)
        assert starts.note("no slaves") == 2
    file.write_text(json.dumps(whole))
    assert starts.note("no slaves") == 30
    found = read_record(tmp_path)
    assert found
    assert (found.starts, found.reason) == (100, "no slaves")
    file.unlink()
    file.mkdir()
    assert starts.note("no slaves") == 2
    starts.forget()
    assert FailedStarts(tmp_path / "gone", Log("ecatd")).note("no slaves") == 2


def test_a_start_that_somebody_asked_for_is_the_first_one(tmp_path: Path) -> None:
    """systemd keeps the count if the service is stopped between two tries."""
    starts = FailedStarts(tmp_path, Log("ecatd"), iter((0, 1, 2, 0, 1)).__next__)
    assert [starts.note("no slaves") for _ in range(5)] == [2, 4, 8, 2, 4]


def test_nobody_waits_without_a_service_manager(tmp_path: Path) -> None:
    env = {**os.environ, "ECATD_RUNTIME_DIR": str(tmp_path)}
    for _ in range(3):
        command = [sys.executable, "-m", "ecatd.service", "--bus", BUS, *NOBODY]
        done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
        assert (done.returncode, "next try" in done.stderr) == (3, False)
    assert not (tmp_path / BUS).exists()


def test_an_error_flag_that_only_an_acknowledgement_clears(
    start_daemon: Callable[..., Daemon],
) -> None:
    """SOEM sets the flag, and the chips have no code with which they say that it is an error."""
    daemon = start_daemon(str(Path(__file__).parents[1] / "rigs" / "keeps_error.py"))
    assert {row["text"] for row in daemon.slave_rows("state")} == {"OP"}

"""A start that fails again and again is tried less and less often, until one succeeds.

The service manager is this test: it starts ecatd again each time, and reads what it is told.
"""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from conftest import PATIENCE, names
from ecatd.log import Log
from ecatd.service.failed_starts import FailedStarts

pytestmark = pytest.mark.bus

BUS = f"tfailed{os.getpid()}"
NOBODY = ("--interface", "eth77")


class Manager:
    """A service manager with one service.

    Attributes:
        told: What the service has told it last.
        log: What the service has written to the log last.
    """

    def __init__(self, folder: Path) -> None:
        self.told: list[str] = []
        self.log = ""
        self._folder = folder
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
            "ECATD_RUNTIME_DIR": str(self._folder / "run"),
            "NOTIFY_SOCKET": str(self._folder / "notify"),
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
        """The seconds until the next try, as it was told."""
        (text,) = [line for line in self.told if "next try in " in line]
        return int(text.rpartition("next try in ")[2].removesuffix(" s"))


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[Manager]:
    found = Manager(tmp_path)
    yield found
    found.close()


def test_the_pause_grows_until_somebody_stops_the_service(manager: Manager) -> None:
    manager.fail_at_once()  # `systemctl start` returns, and says so
    for next_s in (4, 8, 16, 30, 30):
        assert manager.fail_and_wait() == 3, "SIGHUP ends the wait"
        assert manager.next_s == next_s
        status = next(line for line in manager.told if "next try" in line)
        names(status, "eth77", BUS)
        names(manager.log, "eth77", "next try", f"{next_s} s")
        (extended,) = [line for line in manager.told if line.startswith("EXTEND_TIMEOUT_USEC=")]
        assert int(extended.partition("=")[2]) > next_s * 1_000_000
    assert manager.fail_and_wait(signal.SIGTERM) == 0
    manager.fail_at_once()  # it is counted from the beginning
    assert manager.fail_and_wait() == 3
    assert manager.next_s == 4


def test_a_start_that_succeeds_ends_the_counting(manager: Manager) -> None:
    manager.fail_at_once()
    assert manager.fail_and_wait() == 3
    assert manager.run("--simulate", "troll", until="READY=1", number=signal.SIGTERM) == 0
    manager.fail_at_once()


def test_damage_to_the_count_does_no_harm(tmp_path: Path) -> None:
    starts, file = FailedStarts(tmp_path, Log("ecatd")), tmp_path / "failed_starts"
    for text, next_s in (("-7", 2), ("many", 2), ("\0\xff", 2), ("9" * 5000, 2), ("99", 30)):
        file.write_text(text)
        assert starts.note() == next_s
    file.unlink()
    file.mkdir()
    assert starts.note() == 2
    starts.forget()
    assert FailedStarts(tmp_path / "gone", Log("ecatd")).note() == 2


def test_a_start_that_somebody_asked_for_is_the_first_one(tmp_path: Path) -> None:
    """systemd keeps the count if the service is stopped between two tries."""
    starts = FailedStarts(tmp_path, Log("ecatd"), iter((0, 1, 2, 0, 1)).__next__)
    assert [starts.note() for _ in range(5)] == [2, 4, 8, 2, 4]


def test_nobody_waits_without_a_service_manager(tmp_path: Path) -> None:
    env = {**os.environ, "ECATD_RUNTIME_DIR": str(tmp_path)}
    for _ in range(3):
        command = [sys.executable, "-m", "ecatd.service", "--bus", BUS, *NOBODY]
        done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
        assert (done.returncode, "next try" in done.stderr) == (3, False)
    assert not (tmp_path / BUS).exists()

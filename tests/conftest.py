"""Fixtures: a real daemon on a real simulated segment, and the command line that talks to it."""

import contextlib
import itertools
import json
import os
import re
import select
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import time
import uuid
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

import guard
import launcher
from ecatd.base.errors import UnreachableError
from ecatd.client import Client, Signal, Summary
from ecatd.shm.files import make_folder

# A shell that starts the tests in the background has them ignore SIGINT, and so do their programs.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
# So does `nohup` with SIGHUP.
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

PATIENCE = 120.0
"""Seconds after which what a test waits for will not come. No machine is so busy that they pass
without need: pytest ends a test that hangs, after the `timeout` in pyproject.toml."""

PYTHON = shlex.quote(sys.executable)
"""This Python, for the script of a shell."""

# How long examples take is up to the machine, and no behaviour.
settings.register_profile("ecatd", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("ecatd")

SERVICE = "ecatd.service"
CYCLE_TIME_US = 8000
"""Cycle time of the daemons that tests start, if neither test nor configuration says another.
Cycles cost processor time, and most tests are not about how many there are in a second."""

SHM = make_folder(print)
"""The shared memory of the daemons that tests start."""


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> Iterator[None]:
    """Names the test for `guard.py` in the environment of all that it starts, and in its diary."""
    os.environ[guard.RUNNING] = item.nodeid
    guard.note("begin", item.nodeid)
    try:
        return (yield)
    finally:
        guard.note("end", item.nodeid)


class PatientClient(Client):
    """A client that goes on where a busy machine exchanges nothing for a second.

    Then the cycle stands still: a client hears of it at once, whatever its time-out is.
    """

    def wait(self, cycles: int = 1, timeout: float = PATIENCE, domain: int | None = None) -> None:
        _while_it_stands_still(lambda: Client.wait(self, cycles, timeout, domain))

    def sample(self, domain: int | None = None) -> None:
        _while_it_stands_still(lambda: Client.sample(self, domain))

    def summarize(
        self, signals: Sequence[str | Signal], cycles: int, timeout: float = PATIENCE
    ) -> list[Summary]:
        return super().summarize(signals, cycles, timeout)

    async def next_cycle(self, cycles: int = 1, timeout: float = PATIENCE) -> int:
        return await super().next_cycle(cycles, timeout)

    def cycles(self, every: int = 1, timeout: float = PATIENCE) -> AsyncIterator[int]:
        return super().cycles(every, timeout)


def _while_it_stands_still(call: Callable[[], None]) -> None:
    """Calls again until the cycle goes on, or the daemon has ended."""
    end = time.monotonic() + PATIENCE
    while True:
        try:
            return call()
        except UnreachableError as error:
            if "stands still" not in str(error) or time.monotonic() > end:
                raise
        time.sleep(0.01)


class Daemon:
    """An `ecatd` that the test started.

    Attributes:
        bus: Its name, unique to the test.
        config_file: Its configuration.
        env: Environment with which its clients find it.
    """

    def __init__(
        self,
        folder: Path,
        rig: str,
        *options: str,
        config: str | None = None,
        preexec: Callable[[], None] | None = None,
        cycle_time_us: int = CYCLE_TIME_US,
    ) -> None:
        if "cycle_time_us" not in (config or "") and "--cycle-time-us" not in options:
            options = (*options, "--cycle-time-us", str(cycle_time_us))
        self.bus = f"t{uuid.uuid4().hex[:8]}"
        self.env = {**os.environ, "ECATD_RUNTIME_DIR": str(folder / "r"), "ECATD_BUS": self.bus}
        self.config_file = file = folder / "ecat.toml"
        file.write_text(
            _for_a_busy_machine("[gateway]\nlisten = []\n" if config is None else config)
        )
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        address = str(folder / "notify")
        Path(address).unlink(missing_ok=True)
        self._socket.bind(address)
        self._status: list[str] = []
        self._log = folder / "ecatd.base.log"
        arguments = [
            *(("--simulate", rig) if rig else ()),
            *("--bus", self.bus),
            *("--config", str(file)),
            *options,
        ]
        env = {**self.env, "NOTIFY_SOCKET": address}
        self.process: subprocess.Popen[bytes] | launcher.Process
        with self._log.open("w") as log:
            if preexec is None and launcher.can_run(env):
                streams = [0, 1, log.fileno()]
                self.process = launcher.Process(SERVICE, *arguments, env=env, streams=streams)
            else:
                command = [sys.executable, "-m", SERVICE, *arguments]
                self.process = subprocess.Popen(command, env=env, stderr=log, preexec_fn=preexec)

    @property
    def log(self) -> str:
        """What it has written to stderr."""
        return self._log.read_text()

    def wait_ready(self) -> "Daemon":
        """Waits until it says READY=1, as systemd does."""
        self._socket.settimeout(0.2)
        while True:
            try:
                if "READY=1" in self._notified():
                    return self
            except TimeoutError:
                assert self.process.poll() is None, f"ecatd has ended:\n{self.log}"

    def _notified(self) -> list[str]:
        lines = self._socket.recv(4096).decode().splitlines()
        self._status = [line for line in lines if line.startswith("STATUS=")] or self._status
        return lines

    def told(self, seconds: float = PATIENCE) -> list[str]:
        """What it tells systemd next; empty if it tells nothing for so long."""
        self._socket.settimeout(seconds)
        try:
            return self._notified()
        except TimeoutError:
            return []

    @property
    def status(self) -> str:
        """The last STATUS that it has told systemd."""
        self._socket.settimeout(0)
        with contextlib.suppress(BlockingIOError):
            while True:
                self._notified()
        return self._status[-1]

    def wait_end(self) -> tuple[int, str]:
        """Waits until it ends by itself; exit status and log."""
        status = self.process.wait(PATIENCE)
        return status, self.log

    def stop(self) -> int:
        """Ends it as systemd does; returns the exit status."""
        self.process.terminate()
        return self.process.wait(PATIENCE)

    def kill_all(self) -> None:
        """Kills every process of it at once, as a power cut would; waits until all have ended."""
        with contextlib.ExitStack() as stack:
            ends = []
            for pid in (*children(self.process.pid), self.process.pid):
                with contextlib.suppress(ProcessLookupError):
                    ends.append(os.pidfd_open(pid))
                    stack.callback(os.close, ends[-1])
            for end in ends:
                with contextlib.suppress(ProcessLookupError):
                    signal.pidfd_send_signal(end, signal.SIGKILL)
            for end in ends:
                assert select.select([end], [], [], PATIENCE)[0], "a killed process has not ended"
        self.process.wait()

    def child_pid(self, module: str) -> int:
        """The child that runs a module: `ecatd.server`, `ecatd.gateway` or `ecatsim`."""
        for pid in children(self.process.pid):
            with contextlib.suppress(OSError):  # it has just ended
                if module in Path(f"/proc/{pid}/cmdline").read_text().split("\0"):
                    return pid
        raise AssertionError(f"there is no {module}")

    def ctl(self, *arguments: str, check: bool = True) -> subprocess.CompletedProcess[str]:
        """Runs `ecatctl`."""
        result = run_module("ecatd.cli", *arguments, env=self.env)
        if check:
            assert result.returncode == 0, result.stderr
        return result

    def ctl_json(self, *arguments: str) -> dict[str, Any]:
        """Runs `ecatctl … --json` and returns the document."""
        found = self.ctl(*arguments, "--json", check=False)
        document = json.loads(found.stdout)
        # Also without a slave that answers there is a document, and the status says so.
        assert found.returncode in (0, 3), found
        assert "error" not in document, found
        assert document["schema"] == 1
        return document

    def slave_rows(self, command: str = "slaves") -> list[dict[str, Any]]:
        """The rows of `ecatctl slaves` or `ecatctl state`.

        Asks again while no slave answers. That is so, too, when the simulated segment gets no
        processor for as long as the master waits for an answer.
        """
        deadline = time.monotonic() + PATIENCE
        while True:
            found = self.ctl(command, "--json", check=False)  # the status says if nobody answers
            rows: list[dict[str, Any]] = json.loads(found.stdout)["slaves"]
            if any("no answer" not in row.values() for row in rows) or time.monotonic() > deadline:
                return rows

    def client(self) -> Client:
        """A connection to its shared memory."""
        return PatientClient(self.bus)

    def close(self) -> None:
        """Ends it if it still runs; one that does not end is killed, and the test fails."""
        try:
            if self.process.poll() is None:
                self.stop()
        finally:
            if self.process.poll() is None:
                self.kill_all()
            self._socket.close()
            for leftover in SHM.glob(f"{self.bus}*"):  # of a bus server that was killed
                leftover.unlink()


def _for_a_busy_machine(config: str) -> str:
    """Lets clients ask for leases that a busy machine does not end; half a second is too short.

    A simulator that gets no processor for a moment makes no bus unwell.
    """
    if "[outputs]" not in config:
        config += "\n[outputs]\nlease_max_ms = 60000\n"
    return config if "[health]" in config else f"{config}\n[health]\nlost = 1.0\nlate = 1.0\n"


def wait_for(condition: Callable[[], bool], daemon: Daemon, seconds: float = PATIENCE) -> None:
    """Waits until something has come about; shows the log of the daemon if it does not."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert daemon.process.poll() is None, f"ecatd has ended:\n{daemon.log}"
        assert time.monotonic() < deadline, f"it does not come about:\n{daemon.log}"
        time.sleep(0.02)


def wait_for_end(client: Client) -> None:
    """Waits until the daemon of a client has ended. While it dies, its cycle only stands still."""
    while True:
        try:
            client.wait()
        except UnreachableError as error:
            if "has ended" in str(error):
                return


def stop_process(pid: int) -> None:
    """Stops a process as SIGSTOP does, and waits until none of its threads runs any more."""
    os.kill(pid, signal.SIGSTOP)
    tasks = [*Path(f"/proc/{pid}/task").iterdir()]
    while any((task / "stat").read_text().rsplit(")", 1)[1].split()[0] != "T" for task in tasks):
        time.sleep(0.001)


def free_port() -> int:
    """A port of this machine that nobody uses at the moment, and no other test either."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def children(pid: int) -> list[int]:
    """The processes that a process has started."""
    found = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):  # a thread that ends
            found += [int(child) for child in (task / "children").read_text().split()]
    return found


def run_module(
    module: str, *arguments: str, env: dict[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Runs one of our commands to its end."""
    command = [sys.executable, "-m", module, *arguments]
    env = dict(os.environ) if env is None else env
    if not launcher.can_run(env):
        return subprocess.run(command, env=env, text=True, capture_output=True, check=False)
    return subprocess.CompletedProcess(command, *launcher.run(module, *arguments, env=env))


@contextlib.contextmanager
def _starter(base: Path, cycle_time_us: int) -> Iterator[Callable[..., Daemon]]:
    with contextlib.ExitStack() as stack:
        numbers = itertools.count()

        def start(
            rig: str,
            *options: str,
            ready: bool = True,
            config: str | None = None,
            preexec: Callable[[], None] | None = None,
        ) -> Daemon:
            folder = base / f"d{next(numbers)}"
            folder.mkdir()
            daemon = Daemon(
                *(folder, rig, *options),
                config=config,
                preexec=preexec,
                cycle_time_us=cycle_time_us,
            )
            stack.callback(daemon.close)
            return daemon.wait_ready() if ready else daemon

        yield start


@pytest.fixture(scope="module")
def cycle_time_us(request: pytest.FixtureRequest) -> int:
    """Cycle time of the daemons that the next three start: `CYCLE_TIME_US` of the file of tests.

    The models in `contract` sample every millisecond, and so does their bus.
    """
    usual = 1000 if request.path.parent.name == "contract" else CYCLE_TIME_US
    return getattr(request.module, "CYCLE_TIME_US", usual)


@pytest.fixture
def start_daemon(tmp_path: Path, cycle_time_us: int) -> Iterator[Callable[..., Daemon]]:
    """Starts daemons, which are ended after the test; `start_daemon("troll")`."""
    with _starter(tmp_path, cycle_time_us) as start:
        yield start


@pytest.fixture(scope="module")
def start_shared(
    tmp_path_factory: pytest.TempPathFactory, cycle_time_us: int
) -> Iterator[Callable[..., Daemon]]:
    """The same for a file of tests, which leave a daemon as they found it."""
    with _starter(tmp_path_factory.mktemp("shared"), cycle_time_us) as start:
        yield start


@pytest.fixture(scope="module")
def troll(tmp_path_factory: pytest.TempPathFactory, cycle_time_us: int) -> Iterator[Daemon]:
    """A daemon on the rig `troll`, for tests that leave it as they found it."""
    daemon = Daemon(tmp_path_factory.mktemp("troll"), "troll", cycle_time_us=cycle_time_us)
    try:
        yield daemon.wait_ready()
        assert daemon.stop() == 0
        assert not list(SHM.glob(f"{daemon.bus}*"))
    finally:
        daemon.close()


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system with room for 100 KiB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mounted = ["mount", "-t", "tmpfs", "-o", "size=100k", "tmpfs", str(folder)]
    if subprocess.run(mounted, check=False, capture_output=True).returncode:
        pytest.skip("only root mounts a file system")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


@pytest.fixture(scope="session")
def compiler() -> str:
    """The C compiler."""
    found = shutil.which("gcc")
    assert found, "gcc is needed to test what C users get"
    return found


def one_line_error(text: str, program: str) -> str:
    """The one line that a program says when it fails; fails on a traceback or on silence."""
    lines = [line for line in text.strip().splitlines() if line.startswith(f"{program}:")]
    assert lines, text
    assert "Traceback" not in text
    return re.sub(r"^\w+: ", "", lines[-1])


def names(text: object, *tokens: object) -> None:
    """Asserts that a message names all of these, in any order and wording.

    Each must be there as a whole: "1" is not in "0x1", "10", "-1" or "1.5", nor "[a]" in "[[a]]".
    Nor is a number found in a place, as "x.toml:1: list[1]" is one.
    """
    missing = [token for token in tokens if not re.search(_whole(str(token)), str(text))]
    assert not missing, f"{missing} should be in: {text}"


def naming(*tokens: object) -> str:
    """The same as a pattern, for `pytest.raises(…, match=naming("slave 2", "0x6060:00"))`."""
    return r"(?s)\A" + "".join(f"(?=.*{_whole(str(token))})" for token in tokens)


def names_at(text: object, message: str) -> None:
    """The same, behind a place: `names_at(error.value, "x.toml:2: count: 70000 | 1 | 65535")`."""
    place, _, tokens = message.rpartition(": ")
    text = without_notes(text)
    assert text.startswith(f"{place}: "), text
    names(text.removeprefix(f"{place}: "), *tokens.split(" | "))


def without_notes(text: object) -> str:
    """A message without the name or position of a slave behind the key of its table."""
    return re.sub(r"(\bslave\[\d+\][^ :]*) \([^()]*\)(?=:)", r"\1", str(text), count=1)


def _whole(token: str) -> str:
    before, after = re.escape(token[0]), re.escape(token[-1])
    if re.match(r"\w", token):
        before = r"[\w.:[-]" if token[0].isdigit() else r"[\w.-]"
    if re.search(r"\w\Z", token):
        after = r"\w|[.]\d"
    return f"(?<!{before}){re.escape(token)}(?!{after})"

"""A gateway that is a service of its own, run as `ecatd-gateway@.service` does.

The test takes the part of systemd: it starts, kills and restarts the gateway.
"""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from conftest import (
    PATIENCE,
    Daemon,
    names,
    naming,
    one_line_error,
    run_module,
    stop_process,
    wait_for,
)
from ecatd.base.paths import control_socket, zenoh_socket

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

CONFIG = "[gateway]\nlisten = []\npublish_hz = 5\n"


@pytest.fixture
def daemon(start_daemon: Callable[..., Daemon]) -> Daemon:
    return start_daemon("line:2", "--no-gateway", config=CONFIG)


@pytest.fixture(scope="module")
def shared(start_shared: Callable[..., Daemon]) -> Daemon:
    """The same for the tests whose gateways only come and go."""
    return start_shared("line:2", "--no-gateway", config=CONFIG)


class Alone:
    """The gateway, and what it tells the service manager."""

    def __init__(self, daemon: Daemon, folder: Path) -> None:
        self._notify = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._notify.settimeout(PATIENCE)
        address = folder / "manager"
        address.unlink(missing_ok=True)
        self._notify.bind(str(address))
        self.process = subprocess.Popen(
            [sys.executable, "-m", "ecatd.service", "--only-gateway", "--bus", daemon.bus],
            env={**daemon.env, "NOTIFY_SOCKET": str(address)},
            stderr=subprocess.PIPE,
            text=True,
        )

    def wait_for(self, word: str) -> None:
        while word not in self._notify.recv(4096).decode().splitlines():
            pass

    def wait_end(self) -> tuple[int, str]:
        said = self.process.communicate(timeout=PATIENCE)[1]
        return self.process.returncode, said

    def close(self) -> None:
        self.process.kill()
        self.process.communicate()
        self._notify.close()


@contextmanager
def gateway_of(daemon: Daemon, folder: Path) -> Iterator[Alone]:
    alone = Alone(daemon, folder)
    try:
        alone.wait_for("READY=1")
        yield alone
    finally:
        alone.close()


def cycles(daemon: Daemon) -> int:
    return int(daemon.ctl_json("stats")["cycles"])


def test_a_bus_without_its_gateway(daemon: Daemon) -> None:
    """The bus does not need it, and no other process starts one."""
    with pytest.raises(AssertionError, match=naming("ecatd.gateway")):
        daemon.child_pid("ecatd.gateway")
    with daemon.client() as client:
        client.wait(5)
    assert daemon.stop() == 0


def test_it_serves_and_says_so_to_the_service_manager(shared: Daemon, tmp_path: Path) -> None:
    with gateway_of(shared, tmp_path) as gateway:
        assert len(shared.slave_rows()) == 2
        for _ in range(2):
            gateway.wait_for("WATCHDOG=1")
        gateway.process.terminate()
        assert gateway.wait_end() == (0, "")
    run = Path(shared.env["ECATD_RUNTIME_DIR"])
    assert not list(zenoh_socket(run, shared.bus).parent.iterdir())
    assert control_socket(run, shared.bus).exists()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_r18_it_dies_or_hangs_and_the_bus_goes_on(
    shared: Daemon, tmp_path: Path, number: int
) -> None:
    server, said = shared.child_pid("ecatd.server"), len(shared.log)
    with gateway_of(shared, tmp_path) as first:
        if number == signal.SIGSTOP:
            stop_process(first.process.pid)  # and then systemd kills it
        else:
            first.process.kill()
        before = cycles(shared)
        wait_for(lambda: cycles(shared) > before, shared)
    with gateway_of(shared, tmp_path):
        assert len(shared.slave_rows()) == 2
    assert shared.child_pid("ecatd.server") == server
    assert "gateway" not in shared.log[said:]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGQUIT])
def test_signals_that_end_it(shared: Daemon, tmp_path: Path, number: int) -> None:
    said = len(shared.log)
    with gateway_of(shared, tmp_path) as gateway:
        gateway.process.send_signal(number)
        assert gateway.wait_end() == (0, "")
    with gateway_of(shared, tmp_path):  # systemd starts another one
        assert len(shared.slave_rows()) == 2
    assert "gateway" not in shared.log[said:]


@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGPIPE])
def test_signals_that_end_nothing(shared: Daemon, tmp_path: Path, number: int) -> None:
    with gateway_of(shared, tmp_path) as gateway:
        gateway.process.send_signal(number)
        assert len(shared.slave_rows()) == 2
        gateway.wait_for("WATCHDOG=1")
        assert gateway.process.poll() is None


def test_a_command_waits_for_a_gateway_that_starts(daemon: Daemon, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "ecatd.cli", "--timeout", "60", "slaves"]
    with (
        subprocess.Popen(command, env=daemon.env, stdout=subprocess.DEVNULL) as early,
        gateway_of(daemon, tmp_path),
    ):
        assert early.wait(PATIENCE) == 0


def test_a_command_does_not_wait_for_ever(daemon: Daemon) -> None:
    found = daemon.ctl("slaves", "--timeout", "0.1", check=False)
    assert found.returncode == 3
    names(one_line_error(found.stderr, "ecatctl"), "gateway", daemon.bus, "does not answer")


def test_it_leaves_the_processor_of_the_engine(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    every = os.sched_getaffinity(0)
    if len(every) < 2:
        pytest.skip("there is one processor only")
    cpu = max(every)
    daemon = start_daemon("line:1", "--no-gateway", config=f"{CONFIG}[realtime]\ncpu = {cpu}\n")
    with gateway_of(daemon, tmp_path) as gateway:
        tasks = [int(task.name) for task in Path(f"/proc/{gateway.process.pid}/task").iterdir()]
        assert len(tasks) > 1
        assert all(os.sched_getaffinity(task) == every - {cpu} for task in tasks)


def test_it_takes_levels_of_the_log_that_change(shared: Daemon, tmp_path: Path) -> None:
    with gateway_of(shared, tmp_path) as gateway:
        shared.ctl("log-level", "gateway", "debug")
        shared.slave_rows("state")
        shared.ctl("log-level", "gateway", "info")
        gateway.process.terminate()
        status, said = gateway.wait_end()
    assert status == 0
    names(said, "ro/state", "answered")


def test_it_ends_to_take_other_settings(daemon: Daemon, tmp_path: Path) -> None:
    with gateway_of(daemon, tmp_path) as gateway:
        daemon.config_file.write_text('[log]\nmailbox = "debug"\n' + CONFIG)
        daemon.process.send_signal(signal.SIGHUP)
        wait_for(lambda: "changed: log.mailbox" in daemon.log, daemon)
        shown = {row["key"]: row["value"] for row in daemon.ctl_json("config", "show")["keys"]}
        assert (shown["log.mailbox"], shown["gateway.publish_hz"]) == ("debug", 5)
        assert gateway.process.poll() is None
        daemon.config_file.write_text(CONFIG.replace("5", "7"))
        daemon.process.send_signal(signal.SIGHUP)
        assert gateway.wait_end()[0] == 0
    with gateway_of(daemon, tmp_path):
        shown = {row["key"]: row["value"] for row in daemon.ctl_json("config", "show")["keys"]}
        assert shown["gateway.publish_hz"] == 7


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_it_ends_with_the_bus(daemon: Daemon, tmp_path: Path, number: int) -> None:
    with gateway_of(daemon, tmp_path) as gateway:
        os.kill(daemon.child_pid("ecatd.server"), number)
        assert gateway.wait_end() == (0, "")
        daemon.wait_end()
    late = run_module("ecatd.service", "--only-gateway", "--bus", daemon.bus, env=daemon.env)
    assert late.returncode == 3
    names(one_line_error(late.stderr, "ecatd"), "no bus server", "control")


@pytest.mark.parametrize(
    ("options", "what"),
    [
        (["--config", "x.toml"], "--config"),
        (["--no-gateway"], "--no-gateway"),
        (["--cycle-time-us", "500"], "--cycle-time-us"),
        (["--verbose"], "--verbose"),
        (["--simulate", "troll"], "--simulate"),
        (["--bus", "a/b"], "'a/b'"),
    ],
)
def test_it_takes_the_bus_and_nothing_else(options: list[str], what: str) -> None:
    found = run_module("ecatd.service", "--only-gateway", *options)
    assert found.returncode == 2
    names(found.stderr, what)
    assert "Traceback" not in found.stderr

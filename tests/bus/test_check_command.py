"""`ecatctl check`: whether the bus is well, in one line and by the exit status."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from conftest import Daemon, names, stop_process, wait_for
from ecatd.base.errors import NoAnswerError, UnreachableError
from ecatd.base.paths import zenoh_socket
from ecatsim.control import Simulator

pytestmark = pytest.mark.bus

WELL, DEGRADED, DOWN, DENIED = range(4)
CONFIG = """
[gateway]
listen = []
[recovery]
slaves = "none"
[[slave]]
position = 1
name = "lamps"
watchdog_ms = 5000
"""


def check(daemon: Daemon, *options: str) -> tuple[int, str]:
    """Exit status, and the line."""
    done = daemon.ctl("check", *options, check=False)
    assert done.stderr == ""
    (line,) = done.stdout.splitlines()
    return done.returncode, line


def document(daemon: Daemon) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(daemon.ctl("check", "--json", check=False).stdout)
    return found


def started(start: Callable[..., Daemon], folder: Path) -> Daemon:
    rig = folder / "rig.toml"
    rig.write_text("".join(f'[[slave]]\ndevice = "{kind}"\n' for kind in ("EK1100", "EL2008")))
    return start(str(rig), config=CONFIG)


@pytest.fixture
def daemon(start_daemon: Callable[..., Daemon], tmp_path: Path) -> Daemon:
    return started(start_daemon, tmp_path)


@pytest.fixture(scope="module")
def shared(start_shared: Callable[..., Daemon], tmp_path_factory: pytest.TempPathFactory) -> Daemon:
    return started(start_shared, tmp_path_factory.mktemp("check"))


def test_slaves_leave_op_and_come_back(shared: Daemon) -> None:
    status, line = check(shared)
    assert status == WELL
    assert line == f"well: bus {shared.bus}, 2 of 2 slaves in OP"
    with Simulator(str(shared.child_pid("ecatsim"))) as simulator:
        simulator.faults.al_error(1, code=0x001D)
        wait_for(lambda: check(shared)[0] == DEGRADED, shared)
    status, line = check(shared)
    assert line.startswith(f"degraded: bus {shared.bus}, 1 of 2 slaves in OP; ")
    names(line, "slave 1 (lamps (EL2008))", "SAFEOP", "0x001D")
    found = document(shared)
    assert (found["status"], found["slaves"], found["in_op"]) == ("degraded", 2, 1)
    assert len(found["problems"]) == 1
    shared.ctl("state", "0", "SAFEOP", "--yes")
    status, line = check(shared)
    assert (status, line.partition(":")[0]) == (DOWN, "down")
    shared.ctl("state", "OP")
    assert check(shared)[0] == WELL


WITHOUT_A_SLAVE = """
[gateway]
listen = []
[expected]
policy = "tolerant"
[[slave]]
position = 0
vendor = 2
product = 0x044C2C52
[[slave]]
position = 1
name = "lamps"
vendor = 2
product = 0x07D83052
"""
"""A configuration for a rig of which only the first slave is there."""


def test_a_slave_that_was_missing_at_the_start(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    """The bus has no place for it, since nothing says what process data it has."""
    rig = tmp_path / "rig.toml"
    rig.write_text('[[slave]]\ndevice = "EK1100"\n')
    daemon = start_daemon(str(rig), config=WITHOUT_A_SLAVE)
    status, line = check(daemon)
    assert status == DEGRADED
    assert line.startswith(f"degraded: bus {daemon.bus}, 1 of 2 slaves in OP; ")
    names(line, "lamps")
    wait_for(lambda: "1 of 2 slaves in OP" in daemon.status, daemon)
    (row,) = json.loads(daemon.ctl("buses", "--json").stdout)["buses"]
    assert (row["slaves"], row["in_op"], len(row["problems"])) == (2, 1, 1)
    for command in ("state", "slaves"):
        names(daemon.ctl(command).stdout.splitlines()[-1], "not as configured", "lamps")
        (text,) = json.loads(daemon.ctl(command, "--json").stdout)["differences"]
        names(text, "lamps")


def test_a_gateway_that_does_not_answer(shared: Daemon) -> None:
    gateway = shared.child_pid("ecatd.gateway")
    stop_process(gateway)
    try:
        status, line = check(shared, "--timeout", "1")
    finally:
        os.kill(gateway, signal.SIGCONT)
    assert (status, line.partition(":")[0]) == (DEGRADED, "degraded")
    names(line, "gateway")


def test_the_exchange_stands_still(daemon: Daemon) -> None:
    server = daemon.child_pid("ecatd.server")
    stop_process(server)
    try:
        wait_for(lambda: check(daemon, "--timeout", "1")[0] == DOWN, daemon)
        names(check(daemon, "--timeout", "1")[1], "no cycle")
        os.kill(server, signal.SIGCONT)  # else it is killed, since it hangs
        wait_for(lambda: check(daemon)[0] != DOWN, daemon)
        stop_process(server)
        done = daemon.ctl("stats", check=False)
        while done.returncode == 0:
            done = daemon.ctl("stats", check=False)
        assert done.returncode == NoAnswerError.exit_code
        names(done.stdout, "NO CYCLE")
        names(done.stderr, "no cycle", daemon.bus)
    finally:
        with suppress(ProcessLookupError):  # it was killed, since it hung
            os.kill(server, signal.SIGCONT)


@pytest.mark.long
def test_no_slave_answers(daemon: Daemon) -> None:
    """Commands print what they know, and say by their exit status that nobody answers."""
    with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        simulator.faults.power_off(0)
    wait_for(lambda: check(daemon)[0] == DOWN, daemon)
    for command in ("slaves", "state", "info", "stats"):
        done = daemon.ctl(command, "--json", check=False)
        assert done.returncode == UnreachableError.exit_code, command
        assert json.loads(done.stdout)["bus"] == daemon.bus
        names(done.stderr, "no slave answers", "cable")
        assert daemon.ctl(command, check=False).returncode == UnreachableError.exit_code


def test_a_user_without_rights(shared: Daemon) -> None:
    socket = zenoh_socket(Path(shared.env["ECATD_RUNTIME_DIR"]), shared.bus)
    rights = socket.stat().st_mode
    socket.chmod(0o400)
    # In a user namespace, this process has no rights of root.
    command = ["unshare", "--user", "--map-user=1000", sys.executable, "-m", "ecatd.cli", "check"]
    done = subprocess.run(command, env=shared.env, capture_output=True, text=True, check=False)
    socket.chmod(rights)
    assert (done.returncode, done.stdout.partition(":")[0]) == (DENIED, "denied"), done
    names(done.stdout, shared.bus, "group 'ecat'")


def test_no_daemon(shared: Daemon) -> None:
    """The last one: it ends the daemon."""
    assert shared.stop() == 0
    status, line = check(shared, "--timeout", "1")
    assert (status, line.partition(":")[0]) == (DOWN, "down")
    names(line, shared.bus)
    assert document(shared)["status"] == "down"

"""The levels of the log: one part of a running daemon tells details, and the others do not."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

import pytest
from following import following

from conftest import Daemon, names, wait_for
from ecatd.base.errors import EcatError
from ecatd.base.log_levels import PARTS

pytestmark = pytest.mark.bus

CONFIG = """
[gateway]
listen = []
[outputs]
lease_max_ms = 60000
[log]
level = "warning"
outputs = "info"
"""
STARTUP = """
[[slave]]
position = 0
[[slave.startup]]
object = "0x6065:00"
type = "uint32"
value = 1234
"""


@pytest.fixture(scope="module")
def running(start_shared: Callable[..., Daemon]) -> Daemon:
    return start_shared("troll", config=CONFIG)


@pytest.fixture
def daemon(running: Daemon) -> Daemon:
    """A daemon with the levels of its configuration; other tests have written into its log."""
    running.process.send_signal(signal.SIGHUP)

    def as_configured() -> bool:
        found = json.loads(running.ctl("log-level", "--json", check=False).stdout)
        return "levels" in found and found["levels"] == found["configured"]

    wait_for(as_configured, running)
    return running


def set_level(daemon: Daemon, part: str, level: str) -> dict[str, str]:
    """Changes a level; returns all that are in force then."""
    found: dict[str, str] = daemon.ctl_json("log-level", part, level)["levels"]
    return found


def in_order(text: str, tokens: Sequence[str]) -> None:
    at = [text.find(token) for token in tokens]
    assert min(at) >= 0, text
    assert all(first < second for first, second in pairwise(at)), text


def details(log: str) -> list[str]:
    """The parts whose details are in the log."""
    begin = "ecatd: debug: "
    lines = [line for line in log.splitlines() if line.startswith(begin)]
    return sorted({line.removeprefix(begin).partition(":")[0] for line in lines})


def test_one_part_tells_details_until_the_configuration_is_read_again(daemon: Daemon) -> None:
    configured = {**dict.fromkeys(PARTS, "warning"), "outputs": "info"}
    shown = daemon.ctl_json("log-level")
    assert shown["levels"] == shown["configured"] == configured
    assert set_level(daemon, "mailbox", "debug") == {**configured, "mailbox": "debug"}
    uid = os.getuid()
    (line,) = [text for text in daemon.log.splitlines() if "log level" in text]
    assert line.startswith("ecatd: notice: ")
    names(line, "mailbox", "warning", "debug", "pid", f"uid {uid}")
    daemon.ctl("sdo-read", "0", "0x1018", "1")
    wait_for(lambda: "debug: mailbox: slave 0, 0x1018:01: upload of 4 bytes" in daemon.log, daemon)
    assert details(daemon.log) == ["mailbox"]
    daemon.process.send_signal(signal.SIGHUP)
    wait_for(lambda: daemon.ctl_json("log-level")["levels"] == configured, daemon)
    assert daemon.ctl_json("config", "show")["keys"]
    before = len(daemon.log)
    daemon.ctl("sdo-read", "0", "0x1018", "1")
    assert details(daemon.log[before:]) == []


def test_all_parts_of_all_processes_change(daemon: Daemon) -> None:
    begin = len(daemon.log)
    set_level(daemon, "dc", "error")
    assert set_level(daemon, "all", "debug") == dict.fromkeys(PARTS, "debug")
    changed = next(line for line in daemon.log.splitlines()[::-1] if "all parts" in line)
    names(changed, "warning (outputs info, dc error)", "debug")

    def gateway_tells(before: int) -> bool:
        answered = daemon.ctl("info", check=False).returncode == 0
        return answered and "gateway" in details(daemon.log[before:])

    wait_for(lambda: gateway_tells(begin), daemon)
    # The service has the level as well, and a gateway that starts anew.
    os.kill(daemon.child_pid("ecatd.gateway"), signal.SIGKILL)
    wait_for(lambda: "debug: service: the gateway (process " in daemon.log, daemon)
    before = len(daemon.log)
    wait_for(lambda: gateway_tells(before), daemon)


@pytest.mark.parametrize("host", ["cell4", pytest.param("", marks=pytest.mark.long)])
def test_the_log_is_followed_over_a_restart(start_daemon: Callable[..., Daemon], host: str) -> None:
    """Also if the keys of the bus begin with the name of its machine."""
    config = CONFIG.replace("listen = []", f"listen = []\nhost = '{host}'")
    daemon = start_daemon("troll", config=config)
    with following("log", env=daemon.env) as log:

        def heard(level: str) -> bool:
            # Until it listens, it does not hear of this.
            daemon.ctl("log-level", "dc", level, check=False)
            return f"to {level} by" in str(log.documents)

        wait_for(lambda: heard("debug"), daemon)
        os.kill(daemon.child_pid("ecatd.gateway"), signal.SIGKILL)
        wait_for(lambda: "waiting for it" in log.said, daemon)
        wait_for(lambda: heard("info"), daemon)
        line = next(item for item in log.documents if "to debug by" in item["text"])
    assert (line["bus"], line["level"], line["part"]) == (daemon.bus, "notice", "service")
    assert line["sequence"] >= 1


def test_the_log_as_text(daemon: Daemon, tmp_path: Path) -> None:
    told = tmp_path / "told"
    command = [sys.executable, "-m", "ecatd.cli", "log"]
    with (
        told.open("w") as output,
        subprocess.Popen(command, env=daemon.env, stdout=output) as process,
    ):

        def heard() -> bool:
            set_level(daemon, "dc", "debug")
            return "log level of dc changed" in told.read_text()

        wait_for(heard, daemon)
        process.kill()
    names(told.read_text().splitlines()[0], "notice", "service", "to debug")


def test_what_slaves_are_told_and_answer(start_daemon: Callable[..., Daemon]) -> None:
    config = CONFIG + 'start = "debug"\nslaves = "debug"\n' + STARTUP
    daemon = start_daemon("troll", config=config)
    in_order(
        daemon.log, ["INIT is requested", "0x6065:00 = 1234 (PS)", "slaves 0-7: OP is reached"]
    )
    assert details(daemon.log) == ["slaves", "start"]
    before = len(daemon.log)
    daemon.ctl("state", "3", "SAFEOP", "--yes")
    wanted = ["slave 3 (EL2008): a client wants SAFEOP", "slave 3: SAFEOP is requested"]
    wait_for(lambda: "slave 3: SAFEOP is reached" in daemon.log, daemon)
    in_order(daemon.log[before:], [*wanted, "slave 3: SAFEOP is reached"])


def test_a_refused_claim(daemon: Daemon) -> None:
    before = len(daemon.log)
    set_level(daemon, "outputs", "debug")
    with daemon.client() as first, daemon.client() as second:
        with first.claim(3, lease=30.0):
            with pytest.raises(EcatError):
                second.claim(3, lease=30.0)
            wait_for(lambda: "is refused outputs of slave 3 (EL2008)" in daemon.log, daemon)
        assert daemon.ctl_json("stats")["conflicts"] == 1
        (event,) = daemon.ctl_json("events", "3", "--kind", "conflict")["events"]
        assert (event["slave"], event["entry"], event["pid"]) == (3, "0x7000:01", os.getpid())
        assert event["owner"].endswith(f"(pid {os.getpid()})")
        names(event["text"], event["owner"], event["entry"], "EL2008")
        with first.claim(3, lease=30.0):
            for _ in range(50):
                with pytest.raises(EcatError):
                    second.claim(3, lease=30.0)
        assert daemon.ctl_json("stats")["conflicts"] == 51

        def told() -> int:
            found = daemon.ctl_json("events", "--kind", "conflict")["events"]
            assert len(found) < 40, "a flood is one event with a count"
            return sum(event.get("times", 1) for event in found)

        wait_for(lambda: told() == 51, daemon)
    assert "too often" not in daemon.log
    assert details(daemon.log[before:]) == ["outputs"]


@pytest.mark.parametrize(
    ("wrong", "named"),
    [(("sdo", "debug"), ("sdo", "mailbox")), (("mailbox", "loud"), ("loud", "warning"))],
)
def test_wrong_words_are_refused(
    troll: Daemon, wrong: tuple[str, str], named: tuple[str, ...]
) -> None:
    found = troll.ctl("log-level", *wrong, check=False)
    assert found.returncode == 2
    names(found.stderr, *named)

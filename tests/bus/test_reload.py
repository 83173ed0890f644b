"""SIGHUP: what can change in the configuration is used at once, the rest is named."""

import os
import signal
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon, children, names, stop_process, wait_for

CONFIG = """
cycle_time_us = 1000
[gateway]
listen = []
publish_hz = 5
[recovery]
slaves = "none"
[outputs]
lease_max_ms = 60000
"""


def reload(daemon: Daemon, text: str, said: str) -> str:
    """Sends SIGHUP with another configuration; returns what is logged because of that."""
    daemon.config_file.write_text(text)
    before = len(daemon.log)
    daemon.process.send_signal(signal.SIGHUP)
    wait_for(lambda: said in daemon.log[before:], daemon)
    return daemon.log[before:]


def in_force(daemon: Daemon) -> dict[str, object]:
    """The keys that the daemon uses; the gateway begins anew with each change."""
    wait_for(lambda: daemon.ctl("config", "show", check=False).returncode == 0, daemon)
    return {row["key"]: row["value"] for row in daemon.ctl_json("config", "show")["keys"]}


def test_what_can_change_is_used_at_once(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll", config=CONFIG)
    with daemon.client() as client:
        server = daemon.child_pid("ecatd.bus")
        changed = CONFIG.replace("60000", "50000").replace("publish_hz = 5", "publish_hz = 7")
        changed = changed.replace('"none"', '"all"\nretry_s = 1.0').replace("= 1000", "= 2000")
        log = reload(daemon, changed, "configuration read again; changed")
        names(log, "outputs.lease_max_ms", "gateway.publish_hz", "recovery.slaves")
        names(log, "restart", "cycle_time_us")
        now = in_force(daemon)
        assert (now["outputs.lease_max_ms"], now["gateway.publish_hz"]) == (50000, 7)
        assert (now["recovery.slaves"], now["cycle_time_us"]) == ("all", 1000)
        assert daemon.ctl_json("shm")["lease_max_us"] == 50_000_000
        # Recovery does what it was told: this slave was left alone before.
        daemon.ctl("state", "PREOP", "-p", "3")
        daemon.ctl("state", "OP", "-p", "3")
        assert daemon.child_pid("ecatd.bus") == server
        client.wait(5)  # the same bus: no client has noticed anything
        client.sample()


def test_the_log_level_changes_without_a_restart_of_anything(
    start_daemon: Callable[..., Daemon],
) -> None:
    daemon = start_daemon("troll", config=CONFIG)
    pids = [daemon.child_pid(module) for module in ("ecatd.bus", "ecatd.gateway")]
    reload(daemon, CONFIG + '[log]\nslaves = "debug"\n', "changed: log.slaves")
    assert in_force(daemon)["log.slaves"] == "debug"
    daemon.ctl("state", "SAFEOP", "-p", "3")
    wait_for(lambda: "ecatd: debug: slaves: " in daemon.log, daemon)
    assert [daemon.child_pid(module) for module in ("ecatd.bus", "ecatd.gateway")] == pids


def test_a_wrong_configuration_changes_nothing(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll", config=CONFIG)
    log = reload(
        daemon, CONFIG.replace("lease_max_ms = 60000", "lease_max_ms = -1"), "stays as it was"
    )
    names(log, "outputs.lease_max_ms", "-1")
    assert in_force(daemon)["outputs.lease_max_ms"] == 60000
    other = CONFIG.replace("60000", "50000")
    log = reload(daemon, f"profiles = ['nowhere']\n{other}", "stays as it was")
    names(log, "profiles", "nowhere", "no folder")
    assert in_force(daemon)["outputs.lease_max_ms"] == 60000
    slower = f"state_timeout_s = 20.0\n{CONFIG}"
    names(reload(daemon, slower, "configuration read again"), "nothing can change")
    names(reload(daemon, CONFIG, "configuration read again"), "nothing has changed")
    daemon.config_file.unlink()
    reload(daemon_without_file(daemon), CONFIG, "configuration read again")
    assert daemon.stop() == 0


@pytest.mark.long
def test_the_gateway_may_have_ended_already(start_daemon: Callable[..., Daemon]) -> None:
    """It dies while the daemon does not look, and the daemon finds out together with the signal."""
    daemon = start_daemon("troll", config=CONFIG)
    server = daemon.child_pid("ecatd.bus")
    for hertz in (6, 7, 8):
        wait_for(lambda: daemon.ctl("info", check=False).returncode == 0, daemon)
        gateway = daemon.child_pid("ecatd.gateway")
        stop_process(daemon.process.pid)
        try:
            daemon.config_file.write_text(CONFIG.replace("publish_hz = 5", f"publish_hz = {hertz}"))
            os.kill(gateway, signal.SIGKILL)
            daemon.process.send_signal(signal.SIGHUP)
        finally:
            daemon.process.send_signal(signal.SIGCONT)
        wait_for(lambda wanted=hertz: in_force(daemon)["gateway.publish_hz"] == wanted, daemon)  # type: ignore[misc]
    assert daemon.child_pid("ecatd.bus") == server
    assert daemon.stop() == 0


def daemon_without_file(daemon: Daemon) -> Daemon:
    """The file is gone for a moment: the daemon goes on with what it has."""
    daemon.process.send_signal(signal.SIGHUP)
    wait_for(lambda: "cannot be read" in daemon.log, daemon)
    return daemon


def test_a_sighup_while_a_process_starts_ends_none(start_daemon: Callable[..., Daemon]) -> None:
    """`systemctl kill -s HUP` reaches all processes, however young they are."""
    daemon = start_daemon("line:1", config=CONFIG, ready=False)
    heard: set[int] = set()
    ready = threading.Thread(target=daemon.wait_ready, daemon=True)
    ready.start()
    while ready.is_alive():
        assert daemon.process.poll() is None, daemon.log
        pids = [daemon.process.pid, *children(daemon.process.pid)]
        for pid in filter(hears_sighup, pids):
            os.kill(pid, signal.SIGHUP)
            heard.add(pid)
    assert heard == set(pids)
    assert len(pids) == 4, "service, simulator, bus server and gateway"
    daemon.ctl("slaves")


def hears_sighup(pid: int) -> bool:
    """Whether a process does not leave SIGHUP to the system, as Python does when it begins."""
    lines = dict(line.split(":\t") for line in Path(f"/proc/{pid}/status").read_text().splitlines())
    masks = [int(lines[key], 16) for key in ("SigBlk", "SigIgn", "SigCgt")]
    return any(mask >> (signal.SIGHUP - 1) & 1 for mask in masks)

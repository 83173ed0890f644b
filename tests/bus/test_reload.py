"""SIGHUP: what can change in the configuration is used at once, the rest is named."""

import math
import os
import signal
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon, children, names, naming, stop_process, wait_for
from ecatd import Client
from ecatd.base.errors import LeaseError
from ecatd.client.signals import Signal
from ecatd.shm import contract as shm
from ecatsim.control import Simulator

CONFIG = """
cycle_time_us = 1000
[gateway]
listen = []
publish_hz = 5
[recovery]
slaves = "none"
[health]
lost = 1.0
late = 1.0
[outputs]
lease_max_ms = 60000
"""

TORQUE = """
[[signal]]
slave = 0
entry = "0x6071:00"
name = "torque"
unit = "%"
scale = 0.1
minimum = -20
maximum = 20
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


@pytest.fixture(scope="module")
def running(start_shared: Callable[..., Daemon]) -> Daemon:
    return start_shared("troll", config=CONFIG)


@pytest.fixture
def daemon(running: Daemon) -> Daemon:
    """A daemon with the configuration above; the last test that uses it ends it."""
    reload(running, CONFIG, "configuration read again")
    wait_for(lambda: running.ctl("info", check=False).returncode == 0, running)
    return running


def test_what_can_change_is_used_at_once(daemon: Daemon) -> None:
    with daemon.client() as client:
        server = daemon.child_pid("ecatd.server")
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
        daemon.ctl("state", "3", "PREOP", "--yes")
        daemon.ctl("state", "3", "OP")
        assert daemon.child_pid("ecatd.server") == server
        client.wait(5)  # the same bus: no client has noticed anything
        client.sample()


def test_the_log_level_changes_without_a_restart_of_anything(daemon: Daemon) -> None:
    pids = [daemon.child_pid(module) for module in ("ecatd.server", "ecatd.gateway")]
    reload(daemon, CONFIG + '[log]\nslaves = "debug"\n', "changed: log.slaves")
    assert in_force(daemon)["log.slaves"] == "debug"
    daemon.ctl("state", "3", "SAFEOP", "--yes")
    wait_for(lambda: "ecatd: debug: slaves: " in daemon.log, daemon)
    assert [daemon.child_pid(module) for module in ("ecatd.server", "ecatd.gateway")] == pids


def test_a_wrong_configuration_changes_nothing(daemon: Daemon) -> None:
    log = reload(
        daemon, CONFIG.replace("lease_max_ms = 60000", "lease_max_ms = -1"), "stays as it was"
    )
    names(log, "outputs.lease_max_ms", "-1")
    assert in_force(daemon)["outputs.lease_max_ms"] == 60000
    other = CONFIG.replace("60000", "50000")
    log = reload(daemon, f"profiles = ['nowhere']\n{other}", "stays as it was")
    names(log, "profiles", "nowhere", "not a folder")
    assert in_force(daemon)["outputs.lease_max_ms"] == 60000
    slower = f"state_timeout_s = 20.0\n{CONFIG}"
    names(reload(daemon, slower, "configuration read again"), "nothing can change")
    names(reload(daemon, CONFIG, "configuration read again"), "nothing has changed")
    daemon.config_file.unlink()
    reload(daemon_without_file(daemon), CONFIG, "configuration read again")
    assert daemon.stop() == 0


def sends(daemon: Daemon, client: Client, output: Signal, raw: int) -> None:
    """Commits what is staged, and waits until an output has a value."""
    client.commit()

    def is_sent() -> bool:
        client.wait()
        client.sample()
        return bool(output.raw == raw)

    wait_for(is_sent, daemon)


def limits(daemon: Daemon) -> tuple[float, float]:
    """The raw limits of the torque for a client that connects now."""
    with daemon.client() as client:
        torque = client.signal(0, 0x6071)
        return torque.minimum, torque.maximum


@pytest.fixture(scope="module")
def limited(start_shared: Callable[..., Daemon]) -> Daemon:
    return start_shared("troll", config=CONFIG + TORQUE)


def test_limits_change_while_a_client_owns_the_output(limited: Daemon) -> None:
    daemon = limited
    with daemon.client() as client:
        torque = client.signal(0, 0x6071)
        claim = client.claim(0, lease=30)
        torque.value = 18
        sends(daemon, client, torque, 180)

        narrower = CONFIG + TORQUE.replace("maximum = 20", "maximum = 10")
        log = reload(daemon, narrower, "configuration read again; changed")
        names(log, "signal[0 0x6071:00].maximum", "beyond its new limits", "0x6071:00 of slave 0")
        sends(daemon, client, torque, 100)
        assert limits(daemon) == (-200, 100)
        # The client goes on with its own, older rule, and the engine keeps to the new one.
        torque.value = 15
        client.commit()
        for _ in range(20):
            client.wait()
            client.sample()
            assert torque.raw == 100
        wait_for(lambda: "declared range, -20 to 10 %" in daemon.log, daemon)
        torque.value = 5
        sends(daemon, client, torque, 50)

        wider = CONFIG + TORQUE.replace("maximum = 20", "maximum = 40")
        reload(daemon, wider, "signal[0 0x6071:00].maximum")
        torque.value = 30
        sends(daemon, client, torque, 200)
        claim.release()
        with daemon.client() as other:
            output = other.signal(0, 0x6071)
            other.claim(0, lease=30)
            output.value = 30
            sends(daemon, other, output, 300)
        without = TORQUE.replace("minimum = -20", "").replace("maximum = 20", "")
        reload(daemon, CONFIG + without, "signal[0 0x6071:00].m")
        assert limits(daemon) == (-math.inf, math.inf)


def test_limits_that_do_not_fit_change_nothing(limited: Daemon) -> None:
    """Nothing of the file is used, also what could be."""
    daemon = limited
    reload(daemon, CONFIG + TORQUE, "configuration read again")
    other = CONFIG.replace("60000", "50000")
    safe = '[[outputs.safe]]\nslave = 0\nentry = "0x6071:00"\nvalue = 60\n'
    wrong = [
        (TORQUE.replace("minimum = -20", "minimum = 5"), "signal[0].minimum", "[[outputs.safe]]"),
        (safe + TORQUE.replace("minimum = -20", "minimum = 5"), "signal[0].minimum", "restart"),
        (
            TORQUE + "[[signal]]\nslave = 99\nentry = '0x1:0'\nminimum = 1\n",
            "signal[1].slave",
            "99",
        ),
        (
            TORQUE + "[[signal]]\nslave = 0\nentry = '0x6041:00'\nminimum = 1\n",
            "signal[1].minimum",
            "input",
        ),
    ]
    for tables, key, token in wrong:
        log = reload(daemon, other + tables, "stays as it was")
        name = key.rpartition(".")[2]
        lines = (other + tables).splitlines()
        line = max(n for n, text in enumerate(lines, 1) if text.startswith(f"{name} ="))
        names(log, f"{daemon.config_file}:{line}: {key}", token)
        assert limits(daemon) == (-200, 200)
    now = in_force(daemon)
    assert (now["outputs.lease_max_ms"], now["signal[0].minimum"]) == (60000, -20)
    # In another unit a limit is another one.
    changed = TORQUE.replace("scale = 0.1", "scale = 0.2").replace("= 20", "= 10")
    log = reload(daemon, CONFIG + changed, "configuration read again")
    names(log, "nothing can change", "restart", "signal[0 0x6071:00].scale")
    names(log, "signal[0 0x6071:00].maximum")
    assert limits(daemon) == (-200, 200)


def test_a_limit_of_working_counters_counts_at_once(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll", config=CONFIG)
    with (
        daemon.client() as client,
        Simulator(str(daemon.child_pid("ecatsim"))) as simulator,
    ):
        client.claim(0, lease=30)
        torque = client.signal(0, 0x6071)
        torque.raw = 100
        sends(daemon, client, torque, 100)
        simulator.faults.power_off(5)

        def is_wrong() -> bool:
            client.sample()
            return client.domain().wkc_state != shm.WkcState.COMPLETE

        wait_for(is_wrong, daemon)
        torque.raw = 110
        sends(daemon, client, torque, 110)
        changed = CONFIG + "wkc_limit = 5\n[mailbox]\nshare = 0.05\n"
        log = reload(daemon, changed, "configuration read again; changed")
        names(log, "outputs.wkc_limit", "mailbox.share")
        with pytest.raises(LeaseError, match=naming("take part")):
            while True:  # until enough cycles in a row are wrong
                client.wait()
                client.sample()
                torque.raw = 120
                client.commit()
    wait_for(lambda: "wrong working counters in a row" in daemon.log, daemon)
    assert daemon.ctl("sdo-read", "0", "0x1018", "1").returncode == 0
    assert in_force(daemon)["mailbox.share"] == 0.05


@pytest.mark.long
def test_the_gateway_may_have_ended_already(start_daemon: Callable[..., Daemon]) -> None:
    """It dies while the daemon does not look, and the daemon finds out together with the signal."""
    daemon = start_daemon("troll", config=CONFIG)
    server = daemon.child_pid("ecatd.server")
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
    assert daemon.child_pid("ecatd.server") == server
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

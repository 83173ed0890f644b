"""Addresses of `gateway.listen` that do not exist, or do not exist yet."""

import ctypes
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from conftest import Daemon, names, wait_for

pytestmark = [
    pytest.mark.bus,
    pytest.mark.skipif(os.geteuid() != 0, reason="only root may enter a network namespace"),
]

PORT = 7447
LATE = "192.0.2.7"  # for documentation (RFC 5737)
BOUND = f"tcp/127.0.0.1:{PORT + 1}#iface=late0"
NEW_NETWORK = 0x40000000  # CLONE_NEWNET
CONFIG = f"""
[gateway]
listen = ["tcp/{LATE}:{PORT}", "tcp/127.0.0.1:{PORT}", "tcp/nowhere.invalid:1",
  "tcp/a..b:1", "{BOUND}"]
anonymous_reading = true
"""


def own_network() -> None:
    assert ctypes.CDLL(None).unshare(NEW_NETWORK) == 0
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)


def inside(daemon: Daemon, *command: str) -> str:
    """Runs a command in the network namespace of a daemon; its stdout."""
    enter = ("nsenter", f"--net=/proc/{daemon.process.pid}/ns/net", "--")
    return subprocess.run(
        [*enter, *command], env=daemon.env, check=True, capture_output=True, text=True
    ).stdout


def slaves(daemon: Daemon, address: str) -> int:
    """The number of slaves, asked over the network."""
    command = (sys.executable, "-m", "ecatd.cli", "--connect", f"tcp/{address}:{PORT}")
    return len(json.loads(inside(daemon, *command, "slaves", "--json"))["slaves"])


def test_an_address_that_comes_later_costs_nothing(tmp_path: Path) -> None:
    daemon = Daemon(tmp_path, "line:1", config=CONFIG, preexec=own_network).wait_ready()
    try:
        (told,) = (line for line in daemon.log.splitlines() if LATE in line)
        names(told, "not listening", "the address", "tried again")
        names(daemon.log, "'nowhere.invalid:1' is not an address", "'a..b:1' is not an address")
        assert len(daemon.slave_rows()) == 1
        assert slaves(daemon, "127.0.0.1") == 1
        inside(daemon, "ip", "address", "add", f"{LATE}/32", "dev", "lo")
        wait_for(lambda: f"ecatd: listening on tcp/{LATE}" in daemon.log, daemon)
        assert slaves(daemon, LATE) == 1
        names(daemon.log, f"not listening on {BOUND}", "no interface 'late0'")
        inside(daemon, *["ip", "link", "add", "late0", "type", "veth", "peer", "name", "late1"])
        wait_for(lambda: f"ecatd: listening on {BOUND}" in daemon.log, daemon)
        assert daemon.stop() == 0
        assert "does not end" not in daemon.log
    finally:
        daemon.close()

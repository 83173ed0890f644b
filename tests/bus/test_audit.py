"""The audit file: each change that somebody asks for, with who, what, and the values."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon, names, run_module, wait_for

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]


def reload(daemon: Daemon, file: Path) -> None:
    daemon.config_file.write_text(f'audit_file = "{file}"\n[gateway]\nlisten = []\n')
    before = daemon.log.count("configuration read again")
    daemon.process.send_signal(1)
    wait_for(lambda: daemon.log.count("configuration read again") > before, daemon)


def test_each_change_is_in_the_file(start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    file, rotated = tmp_path / "audit", tmp_path / "audit.1"
    config = f'audit_file = "{file}"\n[gateway]\nlisten = []\n'
    daemon = start_daemon("troll", config=config)
    before = daemon.ctl_json("sdo-read", "0", "0x6083", "0")["value"]
    daemon.ctl("sdo-write", "0", "0x6083", "0", "1234")
    daemon.ctl("state", "SAFEOP", "--yes", "-p", "4")
    daemon.ctl("sdo-write", "0", "0x1018", "1", "7", check=False)  # is refused: no change
    daemon.ctl("sdo-read", "0", "0x6083", "0")
    first, second = file.read_text().splitlines()
    names(first, daemon.bus, "slave 0", "0x6083:00", before, "1234", "pid", "uid")
    names(second, daemon.bus, "slave 4", "SAFEOP")
    assert re.match(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}[+-]\d{4} ", first)
    assert file.stat().st_mode & 0o007 == 0
    file.rename(rotated)
    daemon.ctl("state", "OP", "-p", "4")
    (third,) = file.read_text().splitlines()
    names(third, "slave 4", "OP")
    # A file that cannot be written is an error of its own, told once; changes go on.
    reload(daemon, tmp_path)
    for level in ("debug", "info"):
        daemon.ctl("log-level", "dc", level)
    assert daemon.log.count("audit_file") == 1 + daemon.log.count("changed: audit_file")
    names(daemon.log, str(tmp_path), "Is a directory")
    reload(daemon, file)
    daemon.ctl("log-level", "dc", "debug")
    assert len(file.read_text().splitlines()) == 2
    assert len(rotated.read_text().splitlines()) == 2


def test_a_folder_that_does_not_exist(start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    missing = tmp_path / "nowhere"
    config = f'audit_file = "{missing / "audit"}"\n[gateway]\nlisten = []\n'
    daemon = start_daemon("troll", config=config)
    file = str(daemon.config_file)
    (line,) = [line for line in daemon.log.splitlines() if "audit_file" in line]
    names(line, "warning", f"{file}:1: audit_file", missing, "make it")
    (warning,) = daemon.ctl_json("config", "check", file)["warnings"]
    assert warning in line
    alone = run_module("ecatd.service", "--check-config", "--config", file)
    assert (alone.returncode, warning in alone.stderr) == (0, True)
    missing.mkdir()
    assert daemon.ctl_json("config", "check", file)["warnings"] == []
    daemon.ctl("log-level", "dc", "debug")
    assert (missing / "audit").exists()

"""The log: what the journal gets, and that every event has an explanation for `journalctl -x`."""

import os
import re
import shutil
import socket
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from time import sleep

import pytest

from ecatd.base.log import STORM_MAX, Log, message_id
from ecatd.base.log_levels import PARTS
from ecatd.base.sanitized_output import write_no_more

ROOT = Path(__file__).parents[2]
CATALOG = ROOT / "systemd" / "ecatd.catalog"


@pytest.fixture
def journal(tmp_path: Path) -> socket.socket:
    receiver = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    receiver.bind(str(tmp_path / "journal"))
    return receiver


def test_fields_of_the_journal(journal: socket.socket) -> None:
    with journal:
        Log("ecatd", bus="press", journal=Path(journal.getsockname())).of("slaves").warning(
            "slaves 3 and 4: no answer", "slaves", [3, 4]
        )
        assert journal.recv(4096).decode().splitlines() == [
            "MESSAGE=slaves 3 and 4: no answer",
            "PRIORITY=4",
            "SYSLOG_IDENTIFIER=ecatd",
            "ECAT_BUS=press",
            "ECAT_PART=slaves",
            "ECAT_EVENT=slaves",
            f"MESSAGE_ID={message_id('slaves')}",
            "ECAT_SLAVE=3",
            "ECAT_SLAVE=4",
        ]


def test_several_lines_are_one_message(journal: socket.socket) -> None:
    with journal:
        Log("ecatd", journal=Path(journal.getsockname())).info("one\ntwo")
        assert journal.recv(4096).startswith(b"MESSAGE\n\x07\0\0\0\0\0\0\0one\ntwo\nPRIORITY=6\n")


def test_without_the_journal_nothing_is_lost(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Log("ecatd", journal=tmp_path / "gone").error("no carrier", "link")
    assert capsys.readouterr().err == "<3>no carrier\n"


def test_a_full_disk_or_a_closed_pipe_ends_no_bus(monkeypatch: pytest.MonkeyPatch) -> None:
    read, write = os.pipe()
    os.close(read)
    with Path("/dev/full").open("w") as full, os.fdopen(write, "w") as closed:
        for stderr in (full, closed):
            monkeypatch.setattr(sys, "stderr", stderr)
            Log("ecatd").warning("no carrier")
            write_no_more(stderr)


def test_a_level_leaves_out_what_is_less_important(capsys: pytest.CaptureFixture[str]) -> None:
    log = Log("ecatd", {"level": "warning"})
    log.info("not this")
    log.levels = {"level": "info"}
    log.info("but this")
    assert capsys.readouterr().err == "ecatd: but this\n"


def test_each_part_has_its_level(capsys: pytest.CaptureFixture[str]) -> None:
    log = Log("ecatd", {"level": "warning", "mailbox": "debug", "gateway": "error"})
    logs = {part: log.of(part) for part in PARTS}
    for part, each in logs.items():
        each.debug(f"detail of {part}")
        each.warning(f"warning of {part}")
        each.notice(f"notice of {part}")
    lines = capsys.readouterr().err.splitlines()
    assert [line for line in lines if "detail" in line] == [
        "ecatd: debug: mailbox: detail of mailbox"
    ]
    warned = {line.rpartition(" ")[2] for line in lines if "warning of" in line}
    assert warned == set(PARTS) - {"gateway"}
    assert sum("notice of" in line for line in lines) == len(PARTS)
    log.levels = {"level": "debug", "mailbox": "info"}
    logs["mailbox"].debug("not this")
    logs["dc"].debug("but this")
    assert capsys.readouterr().err == "ecatd: debug: dc: but this\n"


@pytest.mark.parametrize(("more", "level"), [(1, "debug"), (500, "debug"), (5, "warning")])
def test_r47_a_storm_of_messages_is_counted(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, more: int, level: str
) -> None:
    """However fast they come: each is either written or counted. Other parts are not concerned."""
    monkeypatch.setattr("ecatd.base.log.STORM_S", 0.05)
    monkeypatch.setattr("ecatd.base.log.time.monotonic", lambda: 7.0)  # all come at the same time
    log = Log("ecatd", {"level": "debug"})
    storm = log.of("mailbox")
    with ThreadPoolExecutor(4) as threads:
        for number in range(STORM_MAX + more):
            threads.submit(getattr(storm, level), f"detail {number}")
    log.of("gateway").debug("a detail")
    lines: list[str] = []

    def told() -> int:
        lines.extend(capsys.readouterr().err.splitlines())
        counted = [int(n) for line in lines for n in re.findall(r"(\d+) more messages", line)]
        return sum("detail " in line for line in lines) + sum(counted)

    while told() < STORM_MAX + more:
        sleep(0.01)
    assert any(f"more messages of level {level}" in line for line in lines)
    assert "ecatd: debug: gateway: a detail" in lines
    storm.debug("again")
    assert "mailbox: again" in capsys.readouterr().err


@pytest.mark.skipif(shutil.which("journalctl") is None, reason="there is no systemd")
def test_journalctl_takes_the_catalog(tmp_path: Path) -> None:
    folder = tmp_path / "usr" / "lib" / "systemd" / "catalog"
    folder.mkdir(parents=True)
    shutil.copy(CATALOG, folder)
    command = ["journalctl", f"--root={tmp_path}", "--update-catalog"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert not done.stderr

"""`ecatctl capture`: frames of both directions and of all threads, as tshark reads them."""

import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon, names, one_line_error, wait_for

pytestmark = [
    pytest.mark.bus,
    pytest.mark.skipif(not shutil.which("tshark"), reason="tshark is not installed"),
]

IN, OUT = "0x00000001", "0x00000002"
MAILBOX = "ecat_mailbox.coe"


def tshark(file: Path, *arguments: str) -> list[str]:
    """What tshark prints about a file."""
    done = subprocess.run(
        ["tshark", "-r", file, *arguments], capture_output=True, text=True, check=True
    )
    return done.stdout.splitlines()


def test_the_last_frames(troll: Daemon, tmp_path: Path) -> None:
    file = tmp_path / "last.pcapng"
    troll.ctl("sdo-read", "0", "0x1018", "1")
    found = troll.ctl_json("capture", "-o", str(file))
    rows = [
        line.split("\t")
        for line in tshark(
            *(file, "-T", "fields", "-e", "frame.time_epoch", "-e", "frame.packet_flags"),
            *("-e", "ecat.cmd", "-e", "frame.interface_name"),
        )
    ]
    assert len(rows) == found["frames"] > 100
    assert found["bytes_missing"] == 0
    times = [float(row[0]) for row in rows]
    assert times == sorted(times)
    assert {row[1] for row in rows} == {IN, OUT}
    assert {row[3] for row in rows} == {troll.ctl_json("info")["interface"]}
    assert tshark(file, "-Y", MAILBOX)  # the SDO went by the relay, in between
    assert tshark(file, "-Y", "_ws.malformed || _ws.short") == []
    shorter = troll.ctl_json("capture", "-o", str(tmp_path / "short"), "--last", "0.01")
    assert 0 < shorter["seconds"] <= 0.01


def test_frames_as_they_come(troll: Daemon, tmp_path: Path) -> None:
    file = tmp_path / "follow.pcapng"
    found = troll.ctl_json("capture", "-o", str(file), "--follow", "--duration", "1")
    indices = tshark(file, "-T", "fields", "-e", "ecat.idx", "-Y", f"frame.packet_flags == {OUT}")
    assert found["seconds"] > 1
    assert len(indices) * 2 <= found["frames"] + 10  # all came back, but for the last ones
    cyclic = [int(line.split(",")[0], 16) for line in indices]
    cyclic = [index for index in cyclic if index >= 0x80]
    if not found["bytes_missing"]:
        steps = {(two - one) % 0x80 for one, two in itertools.pairwise(cyclic)}
        assert steps == {1}


def test_a_full_disk_leaves_a_whole_file(troll: Daemon, small_disk: Path) -> None:
    file = small_disk / "run.pcapng"
    full = troll.ctl("capture", "--follow", "-o", str(file), check=False)
    assert full.returncode == 7
    count = len(tshark(file))  # fails if the last block is cut
    assert count > 0
    names(one_line_error(full.stderr, "ecatctl"), str(file), f"{count} frames")
    (small_disk / "rest").write_bytes(bytes(os.statvfs(small_disk).f_bavail << 12))
    file = small_disk / "other.pcapng"
    full = troll.ctl("capture", "-o", str(file), check=False)
    assert full.returncode == 7
    names(one_line_error(full.stderr, "ecatctl"), str(file), "nothing")
    assert not file.exists()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_leaves_a_whole_file(
    troll: Daemon, tmp_path: Path, number: signal.Signals
) -> None:
    file = tmp_path / "ended.pcapng"
    command = [sys.executable, "-m", "ecatd.cli", "capture", "--follow", "-o", str(file), "--json"]
    with subprocess.Popen(command, env=troll.env, stdout=subprocess.PIPE, text=True) as process:
        wait_for(lambda: file.exists() and file.stat().st_size > 0, troll)
        before = file.stat().st_size
        wait_for(lambda: file.stat().st_size > before, troll)
        troll.ctl("sdo-read", "0", "0x1018", "1")
        process.send_signal(number)
        told = json.loads(process.communicate()[0])
    assert process.returncode == 0
    assert len(tshark(file)) == told["frames"]
    assert tshark(file, "-Y", MAILBOX)  # also what came just before the signal


def test_wrong_use_is_refused(troll: Daemon, tmp_path: Path) -> None:
    where = str(tmp_path / "none" / "x")
    for arguments, status, words in (
        (("-o", where), 7, (where, "No such file")),
        (("-o", "x", "--duration", "1"), 2, ("--follow",)),
        (("-o", "-", "--json"), 2, ("--output",)),
    ):
        refused = troll.ctl("capture", *arguments, check=False)
        assert refused.returncode == status
        names(one_line_error(refused.stderr, "ecatctl"), *words)


def test_without_memory(start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    daemon = start_daemon("troll", config="[flight_recorder]\nmemory_mb = 0\n")
    refused = daemon.ctl("capture", "-o", str(tmp_path / "x"), check=False)
    assert refused.returncode == 7
    names(one_line_error(refused.stderr, "ecatctl"), "flight_recorder.memory_mb")
    assert not (tmp_path / "x").exists()

"""`ecatctl read`, `write` and `record`: values of the process image by names."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from datetime import datetime
from itertools import pairwise
from pathlib import Path

import pytest

from conftest import CYCLE_TIME_US, Daemon, names, one_line_error, wait_for

pytestmark = pytest.mark.bus
OUTPUT, WIRED = "3/0x7000:01", "2/0x6000:01"
"""An output of the rig, and the input that it is wired to."""
LONG = f"{9 * CYCLE_TIME_US // 1000} s"
"""How long 9000 cycles last."""


@pytest.fixture(scope="module")
def bus(start_shared: Callable[..., Daemon]) -> Daemon:
    return start_shared("troll")


def value(bus: Daemon, name: str) -> float:
    (row,) = bus.ctl_json("read", name)["values"]
    return float(row["value"])


def test_values_are_read_by_patterns(bus: Daemon) -> None:
    everything = bus.ctl_json("read")["values"]
    assert len(everything) == 156
    of_slave = bus.ctl_json("read", "4/*")["values"]
    addresses = [row["address"] for row in everything if row["slave"] == 4]
    assert [row["address"] for row in of_slave] == addresses

    def inputs() -> set[tuple[int, str, str]]:
        rows = bus.ctl_json("read", "el3008/*value")["values"]
        return {(row["slave"], row["unit"], row["validity"]) for row in rows}

    wait_for(lambda: inputs() == {(4, "V", "valid"), (5, "V", "valid")}, bus)
    both = bus.ctl_json("read", "0x6041:00", "0/0x6040:00")["values"]
    assert [(row["output"], row["name"]) for row in both] == [
        (True, "Control word"),
        (False, "Status word"),
    ]
    names(bus.ctl("read", "4/0x6000:11").stdout, "4 EL3008", "0x6000:11", "Value", "in", "V")


@pytest.mark.parametrize(
    ("arguments", "status", "tokens"),
    [
        (("read", "nosuch"), 7, ("'nosuch'", "ecatctl read")),
        (("read", "9/*"), 7, ("'9/*'",)),
        (("read", "--connect", "tcp/127.0.0.1:1"), 2, ("--connect",)),
        (("write", f"{OUTPUT}=1"), 2, ("3/Channel 1/Output", "EL2008", "safe", "--yes")),
        (("write", OUTPUT, "--yes"), 2, (f"'{OUTPUT}'",)),
        (("write", f"{OUTPUT}=on", "--yes"), 2, (f"'{OUTPUT}=on'",)),
        (("write", f"{WIRED}=1", "--yes"), 7, ("slave 2 (EL1018)", "output")),
        (("write", f"{OUTPUT}=7", "--yes"), 2, ("0x7000:01", "7")),
        (("write", f"{OUTPUT}=0.5", "--yes"), 2, ("0.5", "whole")),
        (("write", f"{OUTPUT}=0", f"{OUTPUT}=1", "--yes"), 2, ("twice",)),
        (("record", "-o", "run.csv", "--every", "9000", "--for", "1"), 2, (LONG, "--for")),
        (("record", "-o", "run.txt"), 2, ("run.txt", ".csv")),
        (("record", "-o", "/nowhere/run.csv", "--for", "1"), 7, ("/nowhere/run.csv",)),
    ],
)
def test_wrong_arguments(
    bus: Daemon, arguments: tuple[str, ...], status: int, tokens: tuple[str, ...]
) -> None:
    wrong = bus.ctl(*arguments, check=False)
    assert wrong.returncode == status, wrong.stderr
    names(one_line_error(wrong.stderr, "ecatctl"), *tokens)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_outputs_are_held_and_given_back(bus: Daemon, number: int) -> None:
    command = [sys.executable, "-m", "ecatd.cli", "write", f"{OUTPUT}=1", "--yes"]
    with subprocess.Popen(command, env=bus.env, stdout=subprocess.PIPE, text=True) as process:
        try:
            wait_for(lambda: value(bus, WIRED) == 1, bus)
            second = bus.ctl("write", f"{OUTPUT}=0", "--yes", check=False)
            assert second.returncode == 7
            names(one_line_error(second.stderr, "ecatctl"), "slave 3 (EL2008)")
            process.send_signal(number)
            text, _ = process.communicate()
        finally:
            process.kill()
    assert process.returncode == 0
    assert "safe" in text
    wait_for(lambda: value(bus, WIRED) == 0, bus)
    done = bus.ctl_json("write", f"{OUTPUT}=1", "--yes", "--for", "0.2")
    assert [row["value"] for row in done["written"]] == [1.0]


def test_outputs_are_held_from_another_machine(bus: Daemon) -> None:
    """By the socket of this machine, as by an encrypted address (test_remote_users.py)."""
    socket = f"{bus.env['ECATD_RUNTIME_DIR']}/{bus.bus}/gateway/zenoh"
    far = ("--connect", f"unixsock-stream/{socket}", "--yes")
    command = [sys.executable, "-m", "ecatd.cli", "write", "el2008/Output=1", *far]
    wrong = bus.ctl("write", "el2008/Output=1", *far, check=False)
    names(one_line_error(wrong.stderr, "ecatctl"), "several", "3/0x7000:01", "3/0x7010:01")
    command[4] = "el2008/7000:01=1"
    with subprocess.Popen(command, env=bus.env, stdout=subprocess.PIPE, text=True) as process:
        try:
            wait_for(lambda: value(bus, WIRED) == 1, bus)
            second = bus.ctl("write", f"{OUTPUT}=0", "--yes", check=False)
            names(one_line_error(second.stderr, "ecatctl"), "slave 3 (EL2008)", "hand:")
            process.send_signal(signal.SIGINT)
            text, _ = process.communicate()
        finally:
            process.kill()
    assert (process.returncode, "safe" in text) == (0, True)
    wait_for(lambda: value(bus, WIRED) == 0, bus)


def test_outputs_that_do_not_reach_a_slave(bus: Daemon) -> None:
    bus.ctl("state", "3", "SAFEOP", "--yes")
    refused = bus.ctl("write", f"{OUTPUT}=1", "--yes", check=False)
    bus.ctl("state", "3", "OP")
    assert refused.returncode == 7
    names(one_line_error(refused.stderr, "ecatctl"), "slave 3 (EL2008)", "SAFEOP")


def test_a_write_that_was_stopped_says_that_it_lost_its_outputs(bus: Daemon) -> None:
    command = [sys.executable, "-m", "ecatd.cli", "write", "el2008/0X7000:01=1", "--yes"]
    with subprocess.Popen(command, env=bus.env, stderr=subprocess.PIPE, text=True) as process:
        try:
            wait_for(lambda: value(bus, WIRED) == 1, bus)
            process.send_signal(signal.SIGSTOP)
            wait_for(lambda: value(bus, WIRED) == 0, bus)
            process.send_signal(signal.SIGCONT)
            _, text = process.communicate()
        finally:
            process.kill()
    assert process.returncode == 7
    names(text, "3/Channel 1/Output", "lost")


def test_whole_numbers_keep_their_digits(bus: Daemon, tmp_path: Path) -> None:
    file, target = tmp_path / "target.csv", "0/0x607A:00"
    command = [sys.executable, "-m", "ecatd.cli", "write", f"{target}=1234567891", "--yes"]
    with subprocess.Popen(command, env=bus.env) as process:
        try:
            wait_for(lambda: value(bus, target) == 1234567891, bus)
            bus.ctl("record", "-o", str(file), target, "--for", "0.01")
        finally:
            process.terminate()
    cells = {row.split(",")[2] for row in file.read_text().splitlines()[1:]}
    assert cells - {""} == {"1234567891"}  # empty: a late frame


def test_cycles_are_recorded(bus: Daemon, tmp_path: Path) -> None:
    file, begun = tmp_path / "run.csv", time.time()
    told = bus.ctl_json("record", "-o", str(file), "4/*Value", "--every", "2", "--for", "0.5")
    with file.open(newline="") as opened:
        head, *rows = csv.reader(opened)
    assert (head[:2], head[-1]) == (["time_s", "cycle"], "utc")
    assert len(head) == 11
    assert head[2].endswith("Value [V]")
    assert len(rows) == told["cycles"] > 0
    cycles = [int(row[1]) for row in rows]
    assert all(later - earlier >= 2 for earlier, later in pairwise(cycles))
    for row, cycle in zip(rows, cycles, strict=True):
        assert float(row[0]) == pytest.approx(CYCLE_TIME_US / 1e6 * (cycle - cycles[0]))
    times = [datetime.fromisoformat(row[-1]) for row in rows]
    assert begun - 1 <= times[0].timestamp() <= times[-1].timestamp() <= time.time()
    assert all(-10 <= float(cell) <= 10 for row in rows for cell in row[2:-1] if cell)


def test_a_recording_goes_through_a_pipe(bus: Daemon) -> None:
    options = ("4/*Value", "--every", "2", "--for", "0.5")
    found = bus.ctl("record", "-o", "/dev/stdout", *options)
    head, *rows = csv.reader(found.stdout.splitlines())
    assert (head[:2], head[-1]) == (["time_s", "cycle"], "utc")
    names(found.stderr, f"/dev/stdout: {len(rows)} cycles", "8 values")
    full = bus.ctl("record", "-o", "/dev/full", *options, check=False)
    assert full.returncode == 7
    names(one_line_error(full.stderr, "ecatctl"), "/dev/full", "No space left on device")
    dash = bus.ctl("record", "-o", "-", *options, check=False)
    assert dash.returncode == 2
    names(one_line_error(dash.stderr, "ecatctl"), "/dev/stdout")


def test_a_file_that_would_be_lost_is_kept(bus: Daemon, tmp_path: Path) -> None:
    there, link = tmp_path / "there.csv", tmp_path / "link.csv"
    there.write_text("mine")
    link.symlink_to("nosuch.csv")
    for path, why in ((there, "it exists already"), (link, "it is a link to nosuch.csv")):
        found = bus.ctl("record", "-o", str(path), "--for", "0.1", check=False)
        assert found.returncode == 7
        names(one_line_error(found.stderr, "ecatctl"), str(path), why, "--force")
    assert there.read_text() == "mine"
    none = bus.ctl("incident", "show", "last", check=False)
    assert none.returncode == 7
    names(one_line_error(none.stderr, "ecatctl"), "flight_recorder.folder")


def test_recordings_in_other_formats_have_the_same_values(bus: Daemon, tmp_path: Path) -> None:
    from mcap.reader import make_reader
    from pyarrow import parquet

    table, messages = tmp_path / "run.parquet", tmp_path / "run.mcap"
    told = bus.ctl_json("record", "-o", str(table), "4/*Value", "2/*", "--for", "0.3")
    found = parquet.read_table(table)
    assert found.num_rows == told["cycles"] > 0
    assert found.schema.field(2).metadata is not None
    names_ = [name for name in found.column_names if name.startswith("4/")]
    assert len(names_) == 8
    assert found.schema.field(names_[0]).metadata[b"unit"] == b"V"
    assert all(-10 <= value <= 10 for value in found[names_[0]].to_pylist() if value is not None)
    bus.ctl("record", "-o", str(messages), "4/*Value", "--for", "0.3")
    with messages.open("rb") as file:
        rows = [
            (channel.topic, json.loads(message.data), message.log_time)
            for _, channel, message in make_reader(file).iter_messages()
        ]
    assert {topic for topic, _, _ in rows} == {f"/{bus.bus}"}
    cycles = [content["cycle"] for _, content, _ in rows]
    assert cycles == sorted(cycles)
    assert all(set(content["values"]) == set(names_) for _, content, _ in rows)
    assert [at for _, _, at in rows] == sorted(at for _, _, at in rows)


@pytest.mark.parametrize("suffix", ["csv", "mcap", "parquet"])
def test_a_recording_is_whole_on_a_full_disk(bus: Daemon, small_disk: Path, suffix: str) -> None:
    from mcap.reader import make_reader
    from pyarrow import parquet

    file = small_disk / f"run.{suffix}"
    full = bus.ctl("record", "-o", str(file), "4/*Value", check=False)
    assert full.returncode == 7
    message = one_line_error(full.stderr, "ecatctl")
    match suffix:
        case "csv":
            with file.open(newline="") as opened:
                head, *rows = csv.reader(opened)
            assert {len(row) for row in rows} == {len(head)}
            count = len(rows)
        case "mcap":
            with file.open("rb") as opened_bytes:
                count = len([*make_reader(opened_bytes).iter_messages()])
        case _:
            count = parquet.read_table(file).num_rows
    assert count > 0
    names(message, str(file), f"{count} cycles")
    (small_disk / "rest").write_bytes(bytes(os.statvfs(small_disk).f_bavail << 12))
    file = small_disk / f"other.{suffix}"
    full = bus.ctl("record", "-o", str(file), "4/*Value", check=False)
    assert full.returncode == 7
    names(one_line_error(full.stderr, "ecatctl"), str(file), "nothing")
    assert not file.exists()


SLOW = ("--cycle-time-us", "20000")
"""A cycle that a process seldom misses on a busy machine."""


@pytest.mark.long
def test_a_replay_has_the_recorded_values_within_a_cycle(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    begin = time.monotonic()
    bus = start_daemon("troll", *SLOW)
    record(bus, tmp_path / "first.csv", 0.05)
    # A replay begins with the bus, so it is longer than it takes until values are recorded.
    seconds = 2 * (time.monotonic() - begin) + 4
    run = record(bus, tmp_path / "run.csv", seconds)
    assert bus.stop() == 0
    # A cycle that the simulator or the master misses is late for more than a cycle: once more then.
    while (compared := replayed(start_daemon, tmp_path, run, seconds)) < WANTED:
        assert time.monotonic() - begin < TRIED, f"only {compared} values are at their place"


@pytest.mark.long
def test_recordings_that_cannot_be_replayed(
    bus: Daemon, start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    physical = tmp_path / "physical.csv"
    bus.ctl("record", "-o", str(physical), "4/*Value", "--for", "0.05")
    wrong = start_daemon("troll", "--replay", str(physical), ready=False)
    status, log = wrong.wait_end()
    assert status == 2
    names(log, f"{physical}:1", "--raw")
    without = start_daemon("", "--replay", str(physical), "--interface", "nowhere", ready=False)
    status, log = without.wait_end()
    assert status == 2
    names(log, "--replay", "--simulate")


WANTED, TRIED = 1000, 400.0
"""How many values are compared at least, and seconds for which it is tried."""
Rows = dict[int, list[str]]
"""The fields of a recording by the number of the cycle, which begins at 0."""


def record(daemon: Daemon, file: Path, seconds: float) -> Rows:
    daemon.ctl(
        "record", "-o", str(file), "4/*", "2/*", "--raw", "--force", "--for", f"{seconds:.2f}"
    )
    _, *rows = (line.split(",") for line in file.read_text().splitlines())
    return {int(row[1]) - int(rows[0][1]): row[2:-1] for row in rows}


def replayed(start: Callable[..., Daemon], folder: Path, run: Rows, seconds: float) -> int:
    """Records a replay; returns how many values that change are there, or 0 if one is not.

    The second recording begins later, but then each value must be as much later as all others, or
    a cycle more or less. After the end the last values stay.
    """
    daemon = start("troll", "--replay", str(folder / "run.csv"), *SLOW)
    again = record(daemon, folder / "again.csv", seconds)
    assert daemon.stop() == 0
    end = max(run)
    series: list[list[str]] = []
    for cycle in range(end + 1):  # an empty field keeps the value before, as a missed cycle does
        before = series[-1] if series else run[0]
        fields = run.get(cycle, before)
        series.append([field or old for field, old in zip(fields, before, strict=True)])
    columns = [*zip(*series, strict=True)]

    def fits(later: int) -> bool:
        return all(
            field in ("", *column[max(0, at - 1) : at + 2])
            for at, fields in ((min(cycle + later, end), again[cycle]) for cycle in again)
            for field, column in zip(fields, columns, strict=True)
        )

    later = next((later for later in range(end) if fits(later)), end)
    changing = [len({*column}) > 2 for column in columns]
    return sum(
        bool(field) and changes
        for cycle, fields in again.items()
        if cycle + later < end
        for field, changes in zip(fields, changing, strict=True)
    )

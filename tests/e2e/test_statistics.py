"""`ecatctl stats` and `ecatctl info` beside a live daemon, and when parts of it are gone."""

import contextlib
import fcntl
import json
import os
import pty
import re
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from conftest import CYCLE_TIME_US, Daemon, names, one_line_error, run_module
from ecatd.client.remote import Remote
from ecatd.shm.statistics import read

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged, pytest.mark.long]

COUNTED = ("cycles", "frames", "lost", "late", "wkc_bad", "missed")
PORT = 17463
DOMAINS = """
[gateway]
listen = ["tcp/127.0.0.1:{port}"]
[[domain]]
name = "fast"
slaves = [0, "2-3"]
[[domain]]
name = "slow"
divider = 10
slaves = ["4-7"]
"""


@pytest.fixture(scope="module")
def rates(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    """A daemon with two domains that other hosts may ask, too."""
    folder = tmp_path_factory.mktemp("rates")
    daemon = Daemon(folder, "troll", config=DOMAINS.format(port=PORT)).wait_ready()
    yield daemon
    daemon.close()


@contextlib.contextmanager
def watching(daemon: Daemon, *options: str) -> Iterator[subprocess.Popen[str]]:
    """`ecatctl stats --watch` that writes JSON into a pipe."""
    process = subprocess.Popen(
        [sys.executable, "-m", "ecatd.cli", "stats", "--json", "--watch", *options],
        env=daemon.env,
        text=True,
        stdout=subprocess.PIPE,
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()


def next_document(process: subprocess.Popen[str]) -> dict[str, Any]:
    assert process.stdout is not None
    document: dict[str, Any] = json.loads(process.stdout.readline())
    assert document["schema"] == 1
    return document


def complete_stats(daemon: Daemon) -> dict[str, Any]:
    """Statistics while all slaves answer; a busy machine may just have lost a frame."""
    while True:
        document = daemon.ctl_json("stats")
        states = {domain["wkc_state"] for domain in document["domains"]}
        if states == {"complete"} and document["slaves"]["found"] == document["slaves"]["expected"]:
            return document


def test_stats_since_the_start(rates: Daemon) -> None:
    first = rates.ctl_json("stats")
    second = complete_stats(rates)
    assert second["cycles"] > first["cycles"]
    assert second["seconds"] > first["seconds"]
    assert second["exchange"]["count"] >= first["cycles"]
    for name in ("wakeup", "exchange", "cycle"):
        row = second[name]
        order = [row[key] for key in ("min", "p50", "p90", "p99", "p999", "p9999", "max")]
        assert order == sorted(order)
        assert 0 < row["min"] <= row["mean"] <= row["max"]
    assert second["slaves"] == {"expected": 8, "found": 8, "al_status": 8}
    for name in ("wakeup", "exchange", "cycle"):
        first, *_ = second["worst"][name]  # it is counted an instant later than the others
        took = first["duration" if name == "cycle" else name]
        assert took == second[name]["max"] or took <= rates.ctl_json("stats")[name]["max"]
        assert 0 < first["cycle"] <= second["cycle_number"] + 1
    text = rates.ctl("stats").stdout
    assert re.search(r"longest exchange: [0-9.]+ µs in cycle \d+, at 20", text)
    assert f"bus {rates.bus}: running for 0:00:" in text
    assert "8 of 8 slaves" in text
    assert "SINCE START, µs" in text
    assert "P99.99" in text
    assert max(len(line) for line in text.splitlines()) <= 80


def test_every_domain_has_its_row(rates: Daemon) -> None:
    document = complete_stats(rates)
    fast, slow = document["domains"]
    assert (fast["name"], fast["divider"], slow["name"], slow["divider"]) == ("fast", 1, "slow", 10)
    assert fast["wkc_state"] == slow["wkc_state"] == "complete"
    assert (fast["wkc"], slow["wkc"]) == (fast["wkc_expected"], slow["wkc_expected"])
    # A missed cycle costs `fast` an exchange; `slow` makes up for it.
    assert fast["exchanges"] + document["missed"] > 9 * slow["exchanges"] > 0
    rows = rates.ctl("stats").stdout.split("DOMAINS, SINCE START")[1].splitlines()
    assert [row.split()[:3] for row in rows[2:4]] == [["0", "fast", "1"], ["1", "slow", "10"]]


def test_the_same_comes_over_zenoh(rates: Daemon) -> None:
    connect = ("--connect", f"tcp/127.0.0.1:{PORT}")
    far = rates.ctl_json("stats", *connect)
    near = rates.ctl_json("stats")
    assert far.keys() == near.keys()
    assert far["instance"] == near["instance"]
    assert far["cycles"] <= near["cycles"]
    first, second = (
        json.loads(line)
        for line in rates.ctl(
            "stats", "--json", "--watch", "1", "--count", "2", *connect
        ).stdout.splitlines()
    )
    assert second["interval"]["cycles"] == second["cycles"] - first["cycles"] > 0
    document = rates.ctl_json("stats", "--histogram", "cycle", *connect)
    assert sum(count for _low, _high, count in document["buckets"]) == document["count"]
    with Remote(rates.bus, connect[1]) as remote:
        assert 0 < remote.stats().cycle_number <= read(rates.bus).cycle_number
    assert "8 found, 8 expected" in rates.ctl("info", *connect).stdout


def test_watch_prints_a_document_a_line(rates: Daemon) -> None:
    lines = rates.ctl("stats", "--watch", "0.5", "--count", "3", "--json").stdout.splitlines()
    first, second, third = (json.loads(line) for line in lines)
    assert first["interval"] is None
    for before, now in ((first, second), (second, third)):
        interval = now["interval"]
        assert interval["seconds"] == pytest.approx(
            (now["read_us"] - before["read_us"]) * 1e-6, abs=1e-6
        )
        for name in COUNTED:
            assert interval[name] == now[name] - before[name]
        assert interval["exchange"]["count"] == (
            now["exchange"]["count"] - before["exchange"]["count"]
        )
        assert [domain["exchanges"] for domain in interval["domains"]] == [
            late["exchanges"] - early["exchanges"]
            for early, late in zip(before["domains"], now["domains"], strict=True)
        ]
    assert second["interval"]["cycles"] > 0


def test_histograms(rates: Daemon) -> None:
    document = rates.ctl_json("stats", "--histogram", "exchange")
    assert (document["bus"], document["histogram"]) == (rates.bus, "exchange")
    bounds = [edge for low, high, _count in document["buckets"] for edge in (low, high)]
    assert bounds == sorted(bounds)
    assert bounds[0] <= document["min"] <= document["max"] <= bounds[-1]
    text = rates.ctl("stats", "--histogram", "exchange").stdout
    assert f"bus {rates.bus}: exchange, " in text
    assert "####" in text
    assert "100.0000 %" in text.splitlines()[-1]
    two = rates.ctl("stats", "--histogram", "wakeup", "--watch", "0.1", "--count", "2").stdout
    assert len(re.findall(r"LAST [\d.]+ s, µs", two)) == 1
    (last,) = (
        json.loads(line)["interval"]
        for line in rates.ctl(
            *("stats", "--histogram", "wakeup", "--watch", "0.5", "--count", "2", "--json")
        ).stdout.splitlines()[1:]
    )
    assert sum(count for _low, _high, count in last["buckets"]) == last["count"] > 0


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        ("--count 2", "--count | --watch"),
        ("--watch 0.001", "'0.001' | short"),
        ("--watch x", "'x' | time"),
        ("--watch --count 0", "--count | '0' | 1"),
        ("--histogram none", "--histogram | 'none'"),
    ],
)
def test_wrong_usage(arguments: str, what: str) -> None:
    result = run_module("ecatd.cli", "stats", *arguments.split())
    assert result.returncode == 2
    names(result.stderr, *what.split(" | "))
    assert "Traceback" not in result.stderr


def test_without_a_daemon_there_is_nothing_to_watch(tmp_path: Path) -> None:
    env = {**os.environ, "ECATD_RUNTIME_DIR": str(tmp_path)}
    for command in (["stats"], ["stats", "--watch"], ["info"]):
        result = run_module("ecatd.cli", *command, "--bus", "nobody", env=env)
        assert result.returncode == 3
        said = one_line_error(result.stderr, "ecatctl")
        names(said, "not running", "'nobody'", "systemctl start ecatd")
        wrong = run_module("ecatd.cli", *command, "--bus", "../x", env=env)
        assert wrong.returncode == 2


def test_without_a_gateway_statistics_are_there(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    service, gateway = daemon.process.pid, daemon.child_pid("ecatd.gateway")
    os.kill(service, signal.SIGSTOP)  # so that it does not start the gateway again
    try:
        os.kill(gateway, signal.SIGKILL)
        result = daemon.ctl("slaves", check=False)
        assert result.returncode == 3
        said = f"the gateway of bus '{daemon.bus}' does not answer; ecatd starts it again by itself"
        assert one_line_error(result.stderr, "ecatctl").startswith(said)
        document = daemon.ctl_json("stats")
        assert document["slaves"]["found"] == 8
        text = daemon.ctl("info").stdout
        names(text, "first, up", "unknown")
        assert "wire time   unknown without an answer\n" in text
        assert f"no answer   {said}" in text
        names(text, "from shared memory")
        assert "SCHED_FIFO" in text
        facts = daemon.ctl_json("info")
        assert facts["interface"] is None
        assert facts["gateway"]["error"].startswith(said)
        assert facts["slaves"]["found"] == 8
    finally:
        os.kill(service, signal.SIGCONT)


def test_watch_outlives_the_daemon(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    with watching(daemon, "0.5") as process:
        first = next_document(process)
        assert next_document(process)["interval"]["cycles"] > 0
        daemon.kill_all()
        while "error" not in (gone := next_document(process)):
            pass
        assert gone["error"]["name"] == "unreachable"
        names(gone["error"]["message"], "not running", f"'{daemon.bus}'")
        start_daemon("troll", "--bus", daemon.bus)
        while "error" in (back := next_document(process)):
            pass
        assert back["instance"] != first["instance"]
        assert back["interval"] is None  # nothing is taken from a run that is over
        assert next_document(process)["interval"]["cycles"] > 0


def drawn_screens(output: str) -> list[list[str]]:
    """The lines of every drawing, without the signs that steer the terminal."""
    return [
        re.sub(r"\033\[[?0-9]*[a-zA-Z]", "", text).replace("\r", "").split("\n")[:-1]
        for text in output.split("\033[H")[1:]
    ]


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, -15)])
def test_watch_redraws_in_place_and_gives_the_cursor_back(
    rates: Daemon, number: signal.Signals, status: int
) -> None:
    main, child = pty.openpty()
    fcntl.ioctl(child, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    env = {name: value for name, value in rates.env.items() if name not in ("COLUMNS", "LINES")}
    process = subprocess.Popen(
        [sys.executable, "-m", "ecatd.cli", "stats", "--watch", "0.1"],
        env=env,
        stdin=child,
        stdout=child,
        stderr=subprocess.PIPE,
    )
    output = b""
    deadline = time.monotonic() + 120
    while output.count(b"\033[H") < 4 and time.monotonic() < deadline:
        output += os.read(main, 65536)
    process.send_signal(number)
    _nothing, errors = process.communicate()
    os.set_blocking(main, False)
    with contextlib.suppress(OSError):  # there is no more, or nobody has the other end open
        while more := os.read(main, 65536):
            output += more
    os.close(main)
    os.close(child)
    assert (process.returncode, errors) == (status, b"")
    text = output.decode()
    assert text.startswith("\033[?25l\033[2J\033[H")  # no cursor while it draws
    assert text.endswith("\033[?25h")
    assert text.count("\033[2J") == 1  # the screen is cleared once, then written over
    first, *others = drawn_screens(text)
    assert "LAST " not in "\n".join(first)
    assert re.search(r"LAST [\d.]+ s", "\n".join(others[0]))
    for lines in (first, *others):
        assert max(len(line) for line in lines) <= 80
        assert len(lines) < 24  # the line below is the cursor's
        assert lines[0].startswith(f"bus {rates.bus}: running for ")
    assert "more lines: enlarge the window)" in others[0][-1]


def test_info_tells_real_time_and_its_price(rates: Daemon) -> None:
    document = rates.ctl_json("info")
    assert (document["interface"], document["cycle_time_us"]) == ("ecat-master", CYCLE_TIME_US)
    assert document["gateway"] == {"error": None}
    rows = {row["setting"]: row for row in document["settings"]}
    assert list(rows) == [
        *("scheduling", "affinity", "memory", "timer_slack", "dma_latency", "busy_receive")
    ]
    scheduling, busy = rows["scheduling"], rows["busy_receive"]
    assert (scheduling["wanted"], scheduling["value"]) == (True, 80)
    if scheduling["granted"]:
        assert (scheduling["error"], scheduling["how"]) == (0, "")
    else:
        assert scheduling["reason"] == "Operation not permitted"
        assert "CAP_SYS_NICE" in scheduling["how"]
    assert (busy["wanted"], busy["granted"]) == (False, False)
    text = rates.ctl("info").stdout
    assert "slaves      8 found, 8 expected" in text
    assert "REAL TIME" in text
    granted = "yes" if scheduling["granted"] else "REFUSED"
    assert re.search(rf"SCHED_FIFO +priority 80 +{granted} ", text)
    assert max(len(line) for line in text.splitlines()) <= 80


def test_what_was_refused_is_told(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll", config="[gateway]\nlisten = []\n[realtime]\ncpu = 1000\n")
    (row,) = (row for row in daemon.ctl_json("info")["settings"] if row["setting"] == "affinity")
    assert (row["wanted"], row["granted"], row["value"]) == (True, False, 1000)
    assert row["reason"] == "Invalid argument"
    text = daemon.ctl("info").stdout
    assert re.search(r"CPU +1000 +REFUSED  may move between CPUs", text)
    (told,) = (line for line in text.splitlines() if "refused" in line and "CPU" in line)
    names(told, "Invalid argument", "realtime.cpu")
    assert "not granted (see ecatctl info)" in daemon.ctl("stats").stdout

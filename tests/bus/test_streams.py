"""Streams of values over Zenoh: minimum, mean and maximum, so that no peak is lost."""

import asyncio
import itertools
import json
import os
import re
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh
from following import following

from conftest import PATIENCE, Daemon, names, naming, one_line_error, stop_process, wait_for
from ecatd.base.errors import NoAnswerError, StateError, UnreachableError, UsageError
from ecatd.base.timeouts import Timeout
from ecatd.client.remote import Remote
from ecatd.gateway.sessions import Sessions
from ecatd.gateway.streams import Streams
from ecatd.operations.encoding import pack, unpack
from ecatd.operations.streams import OpenStream
from ecatd.operations.zenoh_keys import session_config

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

CYCLE_TIME_US = 1000
"""The rates of these tests are those of 1000 cycles a second."""

WIRED = "3/0x7000:01", "2/0x6000:01"
"""An output of the rig, and the input that it is wired to."""


@pytest.fixture(scope="module")
def bus(start_shared: Callable[..., Daemon]) -> Daemon:
    return start_shared("troll")


@pytest.fixture
def remote(bus: Daemon, monkeypatch: pytest.MonkeyPatch) -> Iterator[Remote]:
    monkeypatch.setenv("ECATD_RUNTIME_DIR", bus.env["ECATD_RUNTIME_DIR"])
    with Remote(bus.bus, timeout=20) as remote:
        yield remote


def test_a_peak_of_a_few_cycles_is_seen(bus: Daemon, remote: Remote) -> None:
    with (
        remote.stream("2/Channel 1/Input", 4) as stream,
        bus.client() as client,
        client.claim(WIRED[0], lease=60),
    ):
        (signal,) = stream.signals
        assert (signal["slave"], signal["address"]) == (2, "0x6000:01")
        assert (stream.rate, stream.cycles) == (4, 250)
        rows = iter(stream)
        output = client.signal(WIRED[0])
        while True:  # a busy machine may keep the output from its slave
            next(rows)
            output.value = 1
            client.commit()
            client.wait(20)
            client.sample()
            output.value = 0
            client.commit()
            found = [next(rows)["values"][0] for _ in range(2)]
            if any(maximum == 1 for _, _, maximum, _ in found):
                break
        low, mean, high, count = next(row for row in found if row[2] == 1)
        assert low <= mean <= high
        assert 0 < count <= 260


def test_no_cycle_is_missed_while_a_row_is_published(
    bus: Daemon, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Publishing takes a third of the time between two rows here, on a large bus a few cycles."""

    def slow(message: dict[str, Any]) -> bytes:
        time.sleep(0.02)
        return pack(message)

    monkeypatch.setattr("ecatd.gateway.streams.pack", slow)
    listen = {"listen/endpoints": [f"unixsock-stream/{tmp_path / 'here'}"]}
    with zenoh.open(session_config("peer", listen)) as session:
        streams = Streams(Sessions([session]), bus.bus, bus.bus)
        stream = asyncio.run(streams.open(OpenStream("2/*", 20)))
        try:
            with session.declare_subscriber(stream["key"]) as rows:
                cycles = (unpack(bytes(row.payload))["cycle"] for row in rows)
                # A busy machine may keep the thread from a cycle, but not each time.
                pairs = itertools.islice(itertools.pairwise(cycles), 200)
                steps = (after - before for before, after in pairs)
                assert stream["cycles"] == 50
                assert 50 in steps
        finally:
            streams.close()


def test_readers_of_the_same_share_a_stream(remote: Remote) -> None:
    first, second = (remote.request(OpenStream("4/*", 5)) for _ in "12")
    assert first == second
    assert len(first["signals"]) == len({item["name"] for item in first["signals"]}) > 8
    other = remote.request(OpenStream("4/*", 10))
    assert other["key"] != first["key"]


def test_wrong_streams(remote: Remote) -> None:
    for pattern, rate, kind, word in (
        ("99/*", 10, StateError, "99/*"),
        ("*", 0, UsageError, "hz=0"),
        ("*", 1000, UsageError, "hz=1000"),
    ):
        with pytest.raises(kind, match=word.replace("*", r"\*")):
            remote.stream(pattern, rate)


@pytest.mark.long
def test_there_are_so_many_streams_at_a_time(bus: Daemon, remote: Remote) -> None:
    open_ = []
    with pytest.raises(StateError, match="streams"):
        for number in range(20):
            open_.append(remote.stream("2/*", 1 + number / 10))
    assert len(open_) >= 10
    for stream in open_:
        stream.__exit__(None, None, None)
    wait_for(lambda: bus.ctl("watch", "3/*", "--count", "1", check=False).returncode == 0, bus)


@pytest.mark.long
def test_who_waits_for_the_first_row_outlives_the_gateway(
    start_daemon: Callable[..., Daemon],
) -> None:
    log = '[gateway]\nlisten = []\n[log]\ngateway = "debug"\n'
    daemon = start_daemon("troll", config=log)
    with following("watch", "2/*", "--hz", "0.1", env=daemon.env) as watch:
        wait_for(lambda: re.search("ro/stream.*answered", daemon.log) is not None, daemon)
        time.sleep(0.5)  # the answer is on its way
        os.kill(daemon.child_pid("ecatd.gateway"), signal.SIGKILL)
        wait_for(lambda: "waiting for it" in watch.said, daemon)
        wait_for(lambda: len(watch.documents) > 0, daemon)


def test_watch_shows_rows(bus: Daemon) -> None:
    text = bus.ctl("watch", "4/*Value", "--hz", "10", "--count", "2").stdout
    names(text, "MINIMUM", "MAXIMUM", "V", "of 100 cycles")
    lines = bus.ctl("watch", "4/*Value", "--hz", "10", "--count", "2", "--json").stdout
    rows = [json.loads(line) for line in lines.splitlines()]
    assert len(rows) == 2
    assert rows[0]["cycle"] < rows[1]["cycle"]
    for value in rows[1]["values"]:
        if value["count"]:
            assert -10 <= value["minimum"] <= value["mean"] <= value["maximum"] <= 10
    wrong = bus.ctl("watch", "nothing/*", check=False)
    assert wrong.returncode == 7
    names(one_line_error(wrong.stderr, "ecatctl"), "'nothing/*'")


@pytest.mark.long
def test_a_stream_ends_with_its_daemon(
    start_daemon: Callable[..., Daemon], monkeypatch: pytest.MonkeyPatch
) -> None:
    daemon = start_daemon("troll")
    monkeypatch.setenv("ECATD_RUNTIME_DIR", daemon.env["ECATD_RUNTIME_DIR"])
    with Remote(daemon.bus, timeout=20) as remote, remote.stream("2/*", 20) as stream:
        next(iter(stream))
        gateway = daemon.child_pid("ecatd.gateway")
        stop_process(gateway)
        stream._patience = Timeout(0.5)
        with pytest.raises(NoAnswerError, match=naming("0.5 s")):
            for _ in stream:
                pass
        stream._patience = Timeout(PATIENCE)
        os.kill(gateway, signal.SIGCONT)
        daemon.stop()
        with pytest.raises(UnreachableError, match="ended"):
            for _ in stream:
                pass


@pytest.mark.long
def test_watch_outlives_the_gateway(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    with following("watch", "2/*", "--hz", "10", env=daemon.env) as watch:
        wait_for(lambda: len(watch.documents) > 1, daemon)
        os.kill(daemon.child_pid("ecatd.gateway"), signal.SIGKILL)
        wait_for(lambda: "waiting for it" in watch.said, daemon)
        shown = len(watch.documents)
        wait_for(lambda: len(watch.documents) > shown, daemon)
        names(watch.said, "ecatctl", "gateway", "connection")


def test_a_summary_of_cycles_in_this_process(bus: Daemon) -> None:
    with bus.client() as client:
        found = client.summarize(["4/0x6000:11", "2/0x6000:01"], 50)
        assert all(0 < row.cycles <= 60 for row in found)
        assert -10 <= found[0].minimum <= found[0].mean <= found[0].maximum <= 10
        assert found[0].minimum <= found[0].last <= found[0].maximum
        assert client.summarize([], 1) == []

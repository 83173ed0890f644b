"""What pages of `ecatctl web` get of traces, compared with what a client records meanwhile."""

import json
import random
import socket
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import pytest
from test_traces import remote
from test_web import HAS_PAGE, Page, Web, serving
from websockets.sync.client import connect

from conftest import PATIENCE, Daemon
from ecatd.operations.traces import TYPES

pytestmark = [
    pytest.mark.bus,
    pytest.mark.skipif(not HAS_PAGE, reason="the page was not built: there is no Node.js"),
]
CYCLE_TIME_US = 1000
RIG = "line:12"
Stretch = tuple[int, int, float, float]
"""First and last cycle, least and greatest value."""


class Recording:
    """What a page has got, as the scope keeps it.

    Args:
        names: The signals that are looked at.

    Attributes:
        kinds: The kinds of batches, in order, each once in a row.
        stretches: For each signal, its stretches of cycles.
    """

    def __init__(self, names: list[str]) -> None:
        self.kinds: list[str] = []
        self.stretches: dict[str, list[Stretch]] = {name: [] for name in names}

    def take(self, data: bytes) -> dict[str, Any]:
        """Takes a batch; returns its header."""
        (length,) = struct.unpack_from("<I", data)
        header: dict[str, Any] = json.loads(data[4 : 4 + length])
        if [header["kind"]] != self.kinds[-1:]:
            self.kinds.append(header["kind"])

        def values(letter: str, at: int) -> tuple[Any, ...]:
            return struct.unpack_from(f"<{header['count']}{letter}", data, at)

        first = values("d", header["cycles"])
        last = values("d", header.get("last_cycles", header["cycles"]))
        for column in header["columns"]:
            if column["name"] not in self.stretches:
                continue
            if "at" in column:
                low = high = values(TYPES[column["type"]], column["at"])
            else:
                low, high = (values("d", column[name]) for name in ("min", "max"))
            places = zip(map(int, first), map(int, last), low, high, strict=True)
            self.stretches[column["name"]] += places
        return header

    def compare(self, name: str, recorded: dict[int, float]) -> list[Stretch]:
        """Compares a signal with a recording: each cycle once, and no peak is lost."""
        stretches = sorted(self.stretches[name])
        for (_, last, *_), (first, *_) in pairwise(stretches):
            assert last < first
            assert recorded.keys().isdisjoint(range(last + 1, first))  # ecatd left them out
        same = 0
        for first, last, least, greatest in stretches:
            values = [recorded[cycle] for cycle in range(first, last + 1) if cycle in recorded]
            if len(values) == last + 1 - first:
                assert (least, greatest) == (min(values), max(values))
                same += len(values)
        assert same > 500
        return stretches


@contextmanager
def recording(daemon: Daemon, patterns: list[str]) -> Iterator[dict[str, dict[int, float]]]:
    """Records entries, by name and cycle, while their outputs have peaks of one cycle."""
    found: dict[str, dict[int, float]] = {pattern: {} for pattern in patterns}
    ends = threading.Event()

    def record() -> None:
        with remote(daemon) as session, session.trace(patterns) as trace:
            for batch in trace:
                for signal, column in zip(trace.signals, batch.columns, strict=True):
                    name = f"{signal['slave']}/{signal['address']}"
                    found[name] |= zip(batch.cycles, column, strict=True)
                if ends.is_set():
                    return

    def write() -> None:
        chance = random.Random(1)
        with daemon.client() as client:
            client.sample()
            outputs = [signal for signal in client.signals() if signal.output][: len(patterns)]
            client.claim(outputs, lease=30)
            while not ends.is_set():
                client.wait()
                client.sample()
                for output in outputs:
                    output.raw = chance.randrange(256) if chance.random() < 0.01 else 100
                client.commit()

    threads = [threading.Thread(target=work) for work in (record, write)]
    for thread in threads:
        thread.start()
    try:
        yield found
    finally:
        ends.set()
        for thread in threads:
            thread.join()


@pytest.fixture(scope="module")
def line(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    config = "[gateway]\nlisten = []\n[flight_recorder]\nmemory_mb = 32\n"
    folder = tmp_path_factory.mktemp("line")
    daemon = Daemon(folder, RIG, config=config, cycle_time_us=CYCLE_TIME_US)
    try:
        yield daemon.wait_ready()
        assert daemon.stop() == 0
    finally:
        daemon.close()


def test_signals_begin_with_their_last_seconds(line: Daemon) -> None:
    with serving(line) as web, web.open() as page:
        signals = page.of_type("signals")["signals"]
        one, two, other = [signal["name"] for signal in signals if signal["output"]][:3]
        with recording(line, [one, two, other]) as recorded:
            time.sleep(1.5)
            got = Recording([one, two, other])

            def until(kind: str, name: str) -> int:
                while True:
                    data = page.ws.recv(PATIENCE)
                    if isinstance(data, bytes):
                        header = got.take(data)
                        names = {column["name"] for column in header["columns"]}
                        if header["kind"] == kind and name in names:
                            return int(got.stretches[name][-1][1])

            page.say(type="trace", signals=[one], history=[one], generation=1)
            live = until("raw", one)
            # A panel wants another signal, without its history; then the scope wants it.
            page.say(type="trace", signals=[one, other], history=[one], generation=2)
            until("raw", other)
            assert got.stretches[other][0][0] > live
            added = until("raw", one)
            page.say(type="trace", signals=[one, two], history=[one, two], generation=3)
            end = until("raw", two)
            while min(len(values) and max(values) for values in recorded.values()) <= end:
                time.sleep(0.05)
        first = got.compare(one, recorded[one])[0][0]
        assert got.compare(two, recorded[two])[0][0] < added - 1000
        assert first < live - 1000


def test_a_socket_that_is_not_read_loses_no_peak_and_returns_to_raw(line: Daemon) -> None:
    with serving(line) as web, slow_page(web) as page:
        signals = page.of_type("signals")["signals"]
        names = [signal["name"] for signal in signals][:200]
        watched = names[:3]
        with recording(line, watched) as recorded:
            page.say(type="trace", signals=names, generation=1)
            time.sleep(4)
            got, ends = Recording(watched), 0
            while "minmax" not in got.kinds or got.kinds[-1] != "raw" or ends < 5:
                data = page.ws.recv(PATIENCE)
                if isinstance(data, bytes):
                    got.take(data)
                    ends += "minmax" in got.kinds
            end = got.stretches[watched[0]][-1][1]
            while min(len(values) and max(values) for values in recorded.values()) <= end:
                time.sleep(0.05)
        for name in watched:
            stretches = got.compare(name, recorded[name])
            assert any(last > first for first, last, *_ in stretches)
            assert len({value for *_, value in stretches}) > 5  # there were peaks


def slow_page(web: Web) -> Page:
    """A page whose computer takes little at a time."""
    name, _, port = web.host.partition(":")
    taking = socket.socket()
    taking.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 65536)
    taking.connect((name, int(port)))
    headers = {"Cookie": web.cookie, "Origin": f"http://{web.host}"}
    return Page(
        connect(
            f"ws://{web.host}/socket",
            sock=taking,
            additional_headers=headers,
            max_size=None,
            max_queue=1,
            ping_interval=None,
            compression=None,
        )
    )

"""CAN behind a terminal at 1 kHz: what frames cost, how late they are, and whether all come.

A program sends and a node sends, each 2000 extended frames a second at 1 Mbit/s. Both number their
frames, so each side knows what it has missed. Turns with this traffic and without it alternate.
"""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Any

from ecatd import Client
from ecatd.base.errors import BusyError, NoAnswerError
from ecatd.client.can import CanFrame, frame
from ecatd.shm.contract import CanKind

from .. import histogram
from ..bench import Bench
from ..health import Health, Interval
from ..histogram import Buckets
from ..masters.daemon import Daemon
from ..segment.peers import ecatsim

SETTINGS = {
    "quick": {"turns": 1, "seconds": 2.0, "long": 5.0},
    "full": {"turns": 10, "seconds": 20.0, "long": 600.0},
}
RATE = 2000
"""Frames a second, each way."""
_RIG = """
name = "can"
[[slave]]
device = "EK1100"
[[slave]]
device = "EL6751CAN"
parameters = {{ kept = 20000 }}
[[slave]]
device = "EL2008"
[[can]]
bit_rate = 1000
terminals = [1]
[[can.node]]
name = "node"
traffic = [{traffic}]
checks = [{{ id = {ours}, extended = true }}]
"""
_CONFIGURATION = f"""
[[slave]]
position = 1
[slave.can]
bit_rate = 1000
frames_per_second = {2 * RATE}
"""
_OURS, _THEIRS = 0x1000_0000, 0x1800_0000


def measure(
    bench: Bench, *, turns: int = 3, seconds: float = 10.0, long: float = 60.0
) -> dict[str, Any]:
    """Runs the whole benchmark and returns its results.

    Args:
        bench: Folder and processors for the measurement.
        turns: Turns with traffic, and as many without.
        seconds: Length of each.
        long: Length of one run in which every frame is followed.
    """
    with bench.awake():
        sums: dict[bool, dict[str, Buckets]] = {}
        counts: dict[bool, dict[str, int]] = {}
        for number in range(turns):
            for busy in (False, True):
                bench.say(f"turn {number + 1} of {turns}, {'with' if busy else 'without'} frames")
                with _machine(bench, busy=busy) as daemon:
                    found = _turn(daemon, seconds, busy=busy)
                for name, buckets in found.buckets.items():
                    into = sums.setdefault(busy, {})
                    into[name] = into[name] + buckets if name in into else buckets
                for name, value in found.counts.items():
                    into_counts = counts.setdefault(busy, {})
                    into_counts[name] = into_counts.get(name, 0) + value
        bench.say(f"{long:g} s in which every frame is followed")
        with _machine(bench, busy=True) as daemon:
            followed = _follow(daemon, long)
            followed["node"] = _node(bench)
        return {
            "processors": bench.processors.to_json(),
            "rate": RATE,
            "turns": turns,
            "seconds": seconds,
            "quiet": _summary(sums[False], counts[False]),
            "busy": _summary(sums[True], counts[True]),
            "followed": followed,
        }


def _summary(buckets: dict[str, Buckets], counts: dict[str, int]) -> dict[str, Any]:
    return {
        **counts,
        **{
            name: {q: histogram.quantile(item, float(q)) for q in ("0.5", "0.99")}
            for name, item in buckets.items()
            if name in ("exchange", "cycle")
        },
    }


@contextlib.contextmanager
def _machine(bench: Bench, *, busy: bool) -> Iterator[Daemon]:
    traffic = f"{{ id = {_THEIRS}, extended = true, rate = {RATE} }}" if busy else ""
    rig = bench.folder / "can.toml"
    rig.write_text(_RIG.format(traffic=traffic, ours=_OURS))
    with (
        ecatsim(rig, bench.processors, "--name", f"{bench.bus}-rig"),
        Daemon(bench, more=_CONFIGURATION) as daemon,
    ):
        yield daemon


def _node(bench: Bench) -> dict[str, int]:
    """What the node has found in the frames of the program."""
    command = (
        sys.executable,
        "-m",
        "ecatsim",
        "ctl",
        "--name",
        f"{bench.bus}-rig",
        "can",
        "--json",
    )
    shown = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    nodes = json.loads(shown)["buses"][0]["nodes"]
    (check,) = (check for node in nodes for check in node["checks"])
    return dict(check)


def _turn(daemon: Daemon, seconds: float, *, busy: bool) -> Interval:
    """The counters and histograms of some seconds, with frames of the program or without."""
    before = Health(daemon.bus)
    if busy:
        _follow(daemon, seconds)
    else:
        _idle(daemon, seconds)
    return Health(daemon.bus).since(before)


def _idle(daemon: Daemon, seconds: float) -> None:
    """The same program without frames: it has the simulator share a processor as much."""
    end = time.monotonic() + seconds
    with Client(daemon.bus) as client:
        into = client.can(1)
        while time.monotonic() < end:
            client.wait()
            into.read()
            for n in range(2 * RATE // 1000):
                frame(_OURS, n.to_bytes(8, "little"), extended=True)


def _follow(daemon: Daemon, seconds: float) -> dict[str, Any]:
    """Sends numbered frames, and follows these and those of the node."""
    with Client(daemon.bus) as reader, Client(daemon.bus) as writer:
        into, out = reader.can(1), writer.can(1)
        out.claim()
        sent = confirmed = received = wrong = 0
        expected = None
        left: dict[int, int] = {}
        late: list[int] = []
        begin = time.monotonic()
        while True:
            passed = time.monotonic() - begin
            if passed > seconds and (not left or passed > seconds + 5):
                break
            due = int(min(passed, seconds) * RATE)
            if due > sent:
                sent += _send(writer, out, sent, min(due, sent + 64), left)
            with contextlib.suppress(NoAnswerError):
                into.wait(0.002)
            for found in into.read():
                if found.kind == CanKind.SENT:
                    late.append(found.cycle - left.pop(found.number))
                    wrong += found.number != confirmed + 1
                    confirmed = found.number
                elif found.kind == CanKind.RECEIVED:
                    number = int.from_bytes(found.data, "little")
                    wrong += expected not in (None, number)
                    expected = number + 1
                    received += 1
        late.sort()
        info = into.info
        return {
            "seconds": seconds,
            "sent": sent,
            "confirmed": confirmed,
            "received": received,
            "wrong": wrong,
            "lost_by_terminal": info.overflows + info.unsent,
            "p50_cycles": late[len(late) // 2],
            "p99_cycles": late[len(late) * 99 // 100],
            "longest_cycles": late[-1],
            "late": [
                {"cycles": cycles, "percent": 100 * late.count(cycles) / len(late)}
                for cycles in range(late[-1] + 1)
            ],
        }


def _send(writer: Client, out: Any, first: int, end: int, left: dict[int, int]) -> int:
    frames: list[CanFrame] = [
        frame(_OURS, n.to_bytes(8, "little"), extended=True) for n in range(first, end)
    ]
    cycle = writer.cycle
    try:
        last = out.send_all(frames)
    except BusyError:
        return 0
    left.update(dict.fromkeys(range(first + 1, last + 1), cycle))
    return int(last - first)

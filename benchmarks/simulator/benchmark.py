"""The speed of ecatsim, compared with a bare echo of the same frames in C.

In each cycle the master sends all frames at once. They have 32 bytes of outputs and 32 bytes of
inputs of every slave, in as few LRW datagrams as possible: one per frame, for up to 23 slaves. The
turn-around is the time from just before the first frame is sent until the last one is back. Echo
and simulator each have a veth pair. The master switches from one to the other every fraction of a
second. A ratio is the median of the ratios of the rounds, because a disturbance of the machine
spoils only a few of them.
"""

from __future__ import annotations

import ctypes
import json
import statistics
import subprocess
import sys
import time
from typing import Any

from .. import native
from ..bench import Bench
from ..segment.frames import BRD, encode, frame
from ..segment.peers import ECHO, SIMULATOR, echo, end, on, simulator
from ..summary import ratio, total
from . import alone

SETTINGS = {
    "quick": {"rounds": 1, "seconds": 0.03, "endurance": 0.3, "starts": 1, "batches": 20},
    "full": {"rounds": 60, "endurance": 300.0},
}
_RATE = 1000
_MODES = ((_RATE, False), (_RATE, True), (0, False), (0, True))
_TOTALS = ("cycles", "lost_frames", "wrong", "late_frames", "missed_cycles")
_ASK = frame(BRD, 0, 0, bytes(1))


def measure(
    bench: Bench,
    *,
    rounds: int = 15,
    seconds: float = 0.15,
    endurance: float = 60.0,
    starts: int = 10,
    batches: int = 400,
    counts: tuple[int, ...] = (1, 8, 64, 200),
) -> dict[str, Any]:
    """Runs the whole benchmark and returns its results.

    Args:
        bench: Folder and processors for the measurement.
        rounds: Rounds of the comparison with the echo.
        seconds: Duration of each measurement in this comparison.
        endurance: Seconds that the longest line runs at 1 kHz.
        starts: How often `ecatsim run troll` is started.
        batches: Number of samples in the measurements without a wire.
        counts: Numbers of slaves on the line.
    """
    timing = ctypes.CDLL(str(native.build(bench.folder, "timing", library=True)))
    cases = [case for count in counts for case in _turn_around(bench, count, rounds, seconds)]
    lasting = _endurance(bench, max(counts), endurance)
    bench.say("start of `ecatsim run troll`")
    both = [(_start_with_namespace(bench), _start_on_interface(bench)) for _ in range(starts)]
    bench.say("slave controllers and device side alone")
    return {
        "processors": bench.processors.to_json(),
        "turn_around": cases,
        "endurance": lasting,
        "start": {
            "own_namespace": [own for own, _ in both],
            "existing_interface": [existing for _, existing in both],
        },
        "processing": alone.processing(timing, batches),
        "step": alone.steps(batches),
    }


def _turn_around(bench: Bench, count: int, rounds: int, seconds: float) -> list[dict[str, Any]]:
    """Measures the turn-around of both peers in rounds: paced or not, blocking or polling."""
    bench.say(f"turn-around, {count} slaves")
    found: dict[tuple[int, bool], dict[str, list[dict[str, Any]]]] = {
        mode: {"echo": [], "simulator": []} for mode in _MODES
    }
    with (
        echo(bench.program("echo"), bench.processors),
        simulator(count, bench.processors) as line,
    ):
        frames = line.cycle_frames()
        peers = [("echo", ECHO, 0), ("simulator", SIMULATOR, line.counter)]
        for _ in range(rounds):
            peers.reverse()
            for rate, spin in _MODES:
                options = ("--seconds", seconds, "--rate", rate, *(("--spin",) if spin else ()))
                for name, pair, counter in peers:
                    result = bench.ping(pair.near, frames, *options, "--counter", counter)
                    found[rate, spin][name].append(result)
    return [
        {"slaves": count, "rate": rate, "spin": spin, **_compare(both)}
        for (rate, spin), both in found.items()
    ]


def _compare(peers: dict[str, list[dict[str, Any]]]) -> dict[str, Any]:
    """Summarises all rounds of one case."""
    result: dict[str, Any] = {}
    for name, rounds in peers.items():
        result[name] = {
            **{key: statistics.median(r[key] for r in rounds) for key in ("p50", "p99", "rate")},
            "max": max(r["max"] for r in rounds),
            **total(rounds, *_TOTALS),
            "real_time": all(r["real_time"] for r in rounds),
            "rounds": [r["p50"] for r in rounds],
        }
    for key in ("p50", "p99"):
        ours, theirs = ((r[key] for r in peers[name]) for name in ("simulator", "echo"))
        result |= ratio(f"ratio_{key}", ours, theirs)
    return result


def _endurance(bench: Bench, count: int, seconds: float) -> dict[str, Any]:
    """Runs a line at 1 kHz for a long time."""
    bench.say(f"{count} slaves at {_RATE} Hz for {seconds:g} s")
    with simulator(count, bench.processors) as line:
        options = ("--seconds", seconds, "--rate", _RATE, "--counter", line.counter)
        return {"slaves": count, **bench.ping(SIMULATOR.near, line.cycle_frames(), *options)}


def _start_with_namespace(bench: Bench) -> float:
    """Returns the seconds from the command to the first answer; ecatsim starts the master."""
    program = bench.program("ping")
    begin = time.monotonic()
    result = subprocess.run(
        [
            *(sys.executable, "-m", "ecatsim", "run", "troll", "--"),
            *(program, "ecat-master", "--first"),
        ],
        input=encode([_ASK]),
        capture_output=True,
        check=True,
        preexec_fn=on(bench.processors.rest),
    )
    return float(json.loads(result.stdout)["first_answer"]) - begin


def _start_on_interface(bench: Bench) -> float:
    """Returns the same on an existing interface, where the master polls from the beginning."""
    begin = time.monotonic()
    command = (sys.executable, "-m", "ecatsim", "run", "troll", "--interface", SIMULATOR.far)
    process = subprocess.Popen(
        [*command, "--die-with-parent"],
        stdout=subprocess.DEVNULL,
        preexec_fn=on(bench.processors.rest),
    )
    try:
        return float(bench.ping(SIMULATOR.near, [_ASK], "--first")["first_answer"]) - begin
    finally:
        end(process)

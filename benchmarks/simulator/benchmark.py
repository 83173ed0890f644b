"""The speed of ecatsim, beside a bare C echo of the same frames.

A cycle is what a master sends at once: every slave's 32 bytes of outputs and 32 bytes of inputs
in as few LRW datagrams as possible, one a frame, 23 slaves each. The turn-around is the time from
before the first frame is sent until the last one is back. Echo and simulator have a veth pair
each and stay on it; the master turns from one to the other every fraction of a second. A ratio is
the median of the ratios of the rounds, so that a disturbance of the machine spoils few of them.
"""

from __future__ import annotations

import ctypes
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ecatd import network_namespace as namespace
from ecatsim.net import netlink

from .. import native
from ..machine import Processors
from ..segment.frames import BRD, encode, frame
from ..segment.peers import ECHO, SIMULATOR, echo, on, ping, simulator
from . import alone

COUNTS = (1, 8, 64, 200)
RATE = 1000
MODES = ((RATE, False), (RATE, True), (0, False), (0, True))
_TOTALS = ("cycles", "lost_frames", "wrong", "late_frames", "missed_cycles")


@dataclass(frozen=True)
class Settings:
    """How long everything is measured.

    Attributes:
        rounds: Rounds of the comparison with the echo.
        seconds: Seconds of each of its measurements.
        endurance: Seconds of 200 slaves at 1 kHz.
        starts: How often `ecatsim run troll` is started.
        batches: Samples of what is timed without a wire.
        counts: Slaves on the line.
    """

    rounds: int = 15
    seconds: float = 0.15
    endurance: float = 60.0
    starts: int = 10
    batches: int = 400
    counts: tuple[int, ...] = COUNTS


SETTINGS = {
    "quick": Settings(rounds=1, seconds=0.03, endurance=0.3, starts=1, batches=20),
    "normal": Settings(),
    "full": Settings(rounds=60, endurance=300.0),
}


def measure(settings: Settings, say: Callable[[str], None]) -> dict[str, Any]:
    """Everything; moves this process into a network namespace of its own."""
    processors = Processors.plan()
    namespace.enter_new()
    for pair in (ECHO, SIMULATOR):
        netlink.create_veth(pair.far, pair.near)
    with tempfile.TemporaryDirectory() as folder:
        bench = _Bench(settings, processors, Path(folder), say)
        return {
            "processors": processors.to_json(),
            "turn_around": bench.turn_around(),
            "endurance": bench.endurance(),
            "start": bench.start(),
            "processing": alone.processing(bench.timing, settings.batches, say),
            "step": alone.steps(settings.batches, say),
        }


class _Bench:
    def __init__(
        self, settings: Settings, processors: Processors, folder: Path, say: Callable[[str], None]
    ) -> None:
        self._settings = settings
        self._processors = processors
        self._say = say
        self._echo = native.build(folder, "echo")
        self._ping = native.build(folder, "ping")
        self.timing = ctypes.CDLL(str(native.build(folder, "timing", library=True)))

    def turn_around(self) -> list[dict[str, Any]]:
        """Every number of slaves, pace and way to receive, with both peers."""
        return [case for count in self._settings.counts for case in self._cases(count)]

    def _cases(self, count: int) -> list[dict[str, Any]]:
        """All rounds with one number of slaves."""
        self._say(f"turn-around, {count} slaves")
        found: dict[tuple[int, bool], dict[str, list[dict[str, Any]]]] = {
            mode: {"echo": [], "simulator": []} for mode in MODES
        }
        with (
            echo(self._echo, self._processors),
            simulator(count, self._processors) as line,
        ):
            frames = line.cycle_frames()
            peers = [("echo", ECHO, 0), ("simulator", SIMULATOR, line.counter)]
            for _ in range(self._settings.rounds):
                peers.reverse()
                for rate, spin in MODES:
                    for name, pair, counter in peers:
                        result = ping(
                            self._ping,
                            self._processors,
                            pair,
                            frames,
                            *("--seconds", self._settings.seconds, "--rate", rate),
                            *("--counter", counter, *(("--spin",) if spin else ())),
                        )
                        found[rate, spin][name].append(result)
        return [
            {"slaves": count, "rate": rate, "spin": spin, **_compare(peers)}
            for (rate, spin), peers in found.items()
        ]

    def endurance(self) -> dict[str, Any]:
        """Many slaves at 1 kHz, for long."""
        count = max(self._settings.counts)
        self._say(f"{count} slaves at {RATE} Hz for {self._settings.endurance:g} s")
        with simulator(count, self._processors) as line:
            found = ping(
                self._ping,
                self._processors,
                SIMULATOR,
                line.cycle_frames(),
                *("--seconds", self._settings.endurance, "--rate", RATE),
                *("--counter", line.counter),
            )
        return {"slaves": count, **found}

    def start(self) -> dict[str, list[float]]:
        """Seconds from the command to the first answer, in a namespace of its own and without."""
        self._say("start of `ecatsim run troll`")
        own, existing = [], []
        for _ in range(self._settings.starts):
            own.append(self._start_with_namespace())
            existing.append(self._start_on_interface())
        return {"own_namespace": own, "existing_interface": existing}

    def _start_with_namespace(self) -> float:
        """The master is started by ecatsim itself."""
        begin = time.monotonic()
        command = (sys.executable, "-m", "ecatsim", "run", "troll", "--")
        result = subprocess.run(
            [*command, self._ping, "ecat-master", "--first"],
            input=encode([frame(BRD, 0, 0, bytes(1))]),
            capture_output=True,
            check=True,
            preexec_fn=on(self._processors.rest),
        )
        return _first_answer(result.stdout) - begin

    def _start_on_interface(self) -> float:
        """The master polls from the beginning."""
        begin = time.monotonic()
        command = (sys.executable, "-m", "ecatsim", "run", "troll", "--interface", SIMULATOR.far)
        process = subprocess.Popen(
            [*command, "--die-with-parent"],
            stdout=subprocess.DEVNULL,
            preexec_fn=on(self._processors.rest),
        )
        try:
            found = ping(
                self._ping, self._processors, SIMULATOR, [frame(BRD, 0, 0, bytes(1))], "--first"
            )
        finally:
            process.terminate()
            process.wait()
        return float(found["first_answer"]) - begin


def _first_answer(output: bytes) -> float:
    found: float = json.loads(output)["first_answer"]
    return found


def _compare(peers: dict[str, list[dict[str, Any]]]) -> dict[str, Any]:
    """All rounds of one case."""
    result: dict[str, Any] = {}
    for name, rounds in peers.items():
        result[name] = {
            **{key: statistics.median(r[key] for r in rounds) for key in ("p50", "p99", "rate")},
            "max": max(r["max"] for r in rounds),
            **{key: sum(r[key] for r in rounds) for key in _TOTALS},
            "real_time": all(r["real_time"] for r in rounds),
            "rounds": [r["p50"] for r in rounds],
        }
    for quantile in ("p50", "p99"):
        ratios = sorted(
            ours[quantile] / theirs[quantile]
            for ours, theirs in zip(peers["simulator"], peers["echo"], strict=True)
        )
        result[f"ratio_{quantile}"] = round(statistics.median(ratios), 4)
        quarter = len(ratios) // 4
        result[f"ratio_{quantile}_quartiles"] = [
            round(ratios[quarter], 4),
            round(ratios[-1 - quarter], 4),
        ]
    return result

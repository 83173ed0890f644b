"""Files over FoE: by the daemon during its cycle of 1 kHz, in turns with SOEM on the idle bus."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from ecatd.base.errors import StateError
from ecatd.client.remote import Remote

from ..bench import Bench
from ..machine import ROOT, Processors
from ..masters.daemon import Daemon
from ..segment.peers import SIMULATOR, ecatsim, on
from .rig import NAME, SIZE

SETTINGS = {
    "quick": {"rounds": 1, "size": 100_000},
    "full": {"rounds": 9},
}
_RIG = Path(__file__).with_name("rig.py")


def measure(bench: Bench, *, rounds: int = 3, size: int = SIZE) -> dict[str, Any]:
    """Runs the whole benchmark and returns its results.

    Args:
        bench: Folder and processors for the measurement.
        rounds: How often each of the two transfers the file.
        size: Bytes that are written; the file that is read has `SIZE`.
    """
    here = bench.on(Processors.together())
    times: dict[str, list[dict[str, float]]] = {"soem": [], "ecatd": []}
    with ecatsim(_RIG, here.processors):
        for number in range(rounds):
            bench.say(f"files over FoE, round {number + 1} of {rounds}")
            times["soem"].append(_by_soem(here, size))
            times["ecatd"].append(_by_daemon(here, size))
    rates = {
        who: {
            "read": round(statistics.median(SIZE / row["read"] for row in rows)),
            "write": round(statistics.median(size / row["write"] for row in rows)),
        }
        for who, rows in times.items()
    }
    return {
        "rounds": rounds,
        "read_bytes": SIZE,
        "written_bytes": size,
        "rates": rates,
        "cycles": sum(row["cycles"] for row in times["ecatd"]),
        "missed": sum(row["missed"] for row in times["ecatd"]),
    }


def _by_soem(bench: Bench, size: int) -> dict[str, float]:
    command = [sys.executable, "-m", "benchmarks.files.soem", SIMULATOR.near, str(size)]
    found = subprocess.run(
        command,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        preexec_fn=on(bench.processors.rest),
        capture_output=True,
        text=True,
        check=False,
    )
    if found.returncode:
        raise StateError(f"SOEM: {found.stderr.strip()}")
    read, write = map(float, found.stdout.split())
    return {"read": read, "write": write}


def _by_daemon(bench: Bench, size: int) -> dict[str, float]:
    with Daemon(bench) as daemon:
        os.environ["ECATD_RUNTIME_DIR"] = daemon.environment["ECATD_RUNTIME_DIR"]
        with Remote(daemon.bus, timeout=60) as remote:
            before = remote.stats()
            reading = remote.start_file_read(0, NAME)
            read = _time(reading)
            writing = remote.start_file_write(0, "new.bin", reading.result()[:size])
            while writing.step == "receiving":
                writing.send()
            write = _time(writing)
            after = remote.stats()
    return {
        "read": read,
        "write": write,
        "cycles": after.cycle_number - before.cycle_number,
        "missed": after.counters["missed"] - before.counters["missed"],
    }


def _time(transfer: Any) -> float:
    """Waits until a transfer that has just begun is complete, and returns the seconds."""
    begin = time.monotonic()
    while not transfer.look():
        time.sleep(0.01)
    return time.monotonic() - begin

"""The time of the command that generates a library of 200 slaves."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from ecatd.base.errors import StateError
from ecatd.description.bus import Bus, Slave
from ecatdev import sample_buses

SLAVES = 200


def measure(folder: Path, rounds: int) -> dict[str, Any]:
    """Times `ecatctl generate` with a saved scan, first into an empty folder, then once more.

    Args:
        folder: Folder for the scan and the libraries.
        rounds: How often both are timed.

    Raises:
        StateError: The command fails.
    """
    scan = folder / "bus.json"
    bus = _bus()
    scan.write_text(json.dumps(bus.to_dict()))
    first, again = [], []
    for n in range(rounds):
        out = folder / f"library{n}"
        first.append(_seconds(scan, out))
        again.append(_seconds(scan, out))
    files = [file for file in (out / "Large").rglob("*") if file.is_file()]
    return {
        "slaves": SLAVES,
        "signals": sum(1 for s in bus.slaves for o in (True, False) for _ in s.entries(outputs=o)),
        "files": len(files),
        "bytes": sum(file.stat().st_size for file in files),
        "seconds": round(statistics.median(first), 3),
        "again": round(statistics.median(again), 3),
    }


def _bus() -> Bus:
    """Returns a bus of `SLAVES` slaves, which repeats the slaves of the reference plant."""
    plant = sample_buses.troll()
    slaves = []
    for position in range(SLAVES):
        like = plant.slaves[position % len(plant.slaves)]
        slaves.append(
            Slave(
                position,
                like.name,
                like.vendor,
                like.product,
                like.revision,
                outputs=like.outputs,
                inputs=like.inputs,
            )
        )
    return Bus("ecat0", 1000, slaves)


def _seconds(scan: Path, out: Path) -> float:
    command = [sys.executable, "-m", "ecatd.cli", "generate", "Large", str(out)]
    start = time.perf_counter()
    done = subprocess.run(
        [*command, "--from", str(scan)], capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        raise StateError(f"ecatctl generate has failed: {done.stderr.strip()}")
    return time.perf_counter() - start

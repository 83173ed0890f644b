"""How often the machine takes a processor away from a running program.

No program is on time on a processor that stands still. The host of a virtual machine may take
processors away at any time, and so may firmware.
"""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from ecatd.base.errors import StateError

from . import native

LONGER_THAN_US = 500.0
"""Half a cycle at 1 kHz: about the time that an exchange leaves free in a cycle."""
_SECONDS = {"quick": 0.1, "normal": 5.0, "full": 20.0}


def measure(extent: str) -> dict[str, Any]:
    """Measures the interruptions of all processors at the same time, with a busy loop on each.

    Args:
        extent: "quick", "normal" or "full": how long to measure.

    Returns:
        `longer_than_us`; `rate`, the number of interruptions longer than that, per second and
        processor; `longest_us`; and `real_time`, whether the loops had real-time priority, so that
        no ordinary program can have interrupted them.

    Raises:
        StateError: There is no compiler, or the program fails.
    """
    with tempfile.TemporaryDirectory() as folder:
        program = native.build(Path(folder), "interruptions")
        found = _run(program, _SECONDS[extent])
    return {
        "longer_than_us": LONGER_THAN_US,
        "rate": round(sum(x["times"] for x in found) / sum(x["seconds"] for x in found), 2),
        "longest_us": max(x["longest_us"] for x in found),
        "real_time": all(x["real_time"] for x in found),
    }


def _run(program: Path, seconds: float) -> list[dict[str, Any]]:
    options = ("--seconds", str(seconds), "--longer-than", str(LONGER_THAN_US))
    processes = [
        subprocess.Popen(
            [program, "--processor", str(number), *options], stdout=subprocess.PIPE, text=True
        )
        for number in sorted(os.sched_getaffinity(0))
    ]
    texts = [process.communicate()[0] for process in processes]
    if any(process.returncode for process in processes):
        raise StateError("the interruptions of the processors cannot be measured")
    return [json.loads(text) for text in texts]

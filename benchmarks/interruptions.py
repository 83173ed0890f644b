"""How often the machine itself takes its processors away from those who have them.

Nothing can be in time on a processor that does not run. The host of a virtual machine gives it to
others whenever it likes, and firmware may do so, too.
"""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from ecatd.model.errors import StateError

from . import native

LONGER_THAN_US = 500.0
"""Half a cycle of 1 kHz: about what there is left beside an exchange."""
_SECONDS = {"quick": 0.1, "normal": 5.0, "full": 20.0}


def measure(extent: str) -> dict[str, Any]:
    """Looks at all processors at the same time, all of them busy.

    Returns:
        `longer_than_us`, `rate` (interruptions a second and processor that are longer than that),
        `longest_us`, and `real_time`: whether no ordinary program can have been the reason.

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

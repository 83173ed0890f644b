"""What a result was measured on, and which processors the parts of a benchmark get."""

from __future__ import annotations

import datetime
import os
import platform
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]


@dataclass(frozen=True)
class Processors:
    """Processors of the parts of a benchmark.

    Attributes:
        master: For what sends and waits.
        peer: For the thread that answers frames.
        rest: For everything else, as the device side of the simulator.
    """

    master: frozenset[int]
    peer: frozenset[int]
    rest: frozenset[int]

    @staticmethod
    def plan() -> Processors:
        """Cores of their own for master and peer, taken from the end: interrupts prefer 0.

        Of two cores the master has one, and everything else the other one.
        """
        *rest, peer = sorted(os.sched_getaffinity(0))
        if not rest:
            return Processors.together()
        *others, master = rest
        return Processors(frozenset([master]), frozenset([peer]), frozenset(others or [peer]))

    @staticmethod
    def together() -> Processors:
        """Nobody has a core of its own."""
        every = frozenset(os.sched_getaffinity(0))
        return Processors(every, every, every)

    def to_json(self) -> dict[str, list[int]]:
        """Their numbers."""
        return {name: sorted(getattr(self, name)) for name in ("master", "peer", "rest")}


def _first(pattern: str, file: str) -> str:
    try:
        match = re.search(pattern, Path(file).read_text(), re.MULTILINE)
    except OSError:
        return ""
    return match[1].strip() if match else ""


def _revision() -> str:
    try:
        result = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--abbrev=10"],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
        )
    except FileNotFoundError:
        return "unknown"
    return result.stdout.strip() or "unknown"


def describe() -> dict[str, Any]:
    """The machine, for humans who compare; call it before the namespace changes."""
    return {
        "processor": _first(r"^model name\s*:\s*(.*)$", "/proc/cpuinfo") or platform.machine(),
        "cores": len(os.sched_getaffinity(0)),
        "virtual": "hypervisor" in _first(r"^flags\s*:\s*(.*)$", "/proc/cpuinfo").split(),
        "governor": _first(r"^(.*)$", "/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
        or "not known",
        "kernel": f"{platform.release()} {platform.version()}",
        "python": platform.python_version(),
        "root": os.geteuid() == 0,
        "load": round(os.getloadavg()[0], 1),
        "revision": _revision(),
        "date": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
    }

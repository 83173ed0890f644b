"""Describes the machine, and assigns its processors to the parts of a benchmark."""

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
        master: For the program that sends frames and waits for them.
        peer: For the thread that answers frames.
        rest: For everything else, such as the device side of the simulator.
    """

    master: frozenset[int]
    peer: frozenset[int]
    rest: frozenset[int]

    @staticmethod
    def plan() -> Processors:
        """Gives the master and the peer a core of their own if there are enough.

        Of two cores, the master has one, and everything else shares the other one. The last cores
        are taken, because interrupts prefer core 0.
        """
        *rest, peer = sorted(os.sched_getaffinity(0))
        if not rest:
            return Processors.together()
        *others, master = rest
        return Processors(frozenset([master]), frozenset([peer]), frozenset(others or [peer]))

    @staticmethod
    def together() -> Processors:
        """Gives all cores to every part."""
        every = frozenset(os.sched_getaffinity(0))
        return Processors(every, every, every)

    def to_json(self) -> dict[str, list[int]]:
        """Returns the numbers of the processors of each part."""
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
    """Returns facts about the machine, for readers who compare results.

    Must be called before this process enters a namespace, in which every user looks like root.
    """
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


def used(pid: int) -> float:
    """Seconds of processors that a process has had so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

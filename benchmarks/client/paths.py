"""How long reading and writing take, and whether they enter the kernel."""

from __future__ import annotations

import shutil
import statistics
from collections.abc import Callable, Sequence
from typing import Any

from .plant import Line, Plant

_RARE = "sched_yield"
"""A sample that finds the engine interrupted in the middle of writing lets it run."""
_MARK = "getppid"


def snapshots(
    line: Line, readers: Sequence[int], seconds: float, say: Callable[[str], None]
) -> list[dict[str, Any]]:
    """A snapshot and 20 reads, beside the least that it could be, with so many readers at once.

    Args:
        line: The slaves.
        readers: How many processes there are.
        seconds: How long they run; those that share a processor as much longer.
        say: Told what is going on.
    """
    processors = sorted(line.plant.processors.rest)
    result = []
    for free_running in (False, True):
        with line.exchanged(free_running=free_running):
            for count in readers:
                say(f"snapshot, {count} readers{', free-running' if free_running else ''}")
                share = -(-count // len(processors))
                found = line.plant.run("snapshot", count, seconds * min(share, 8), *processors)
                result.append({"free_running": free_running, "readers": count, **_summary(found)})
    return result


def _summary(processes: list[dict[str, float]]) -> dict[str, Any]:
    """Medians over the processes of their medians, and their span."""
    samples = sorted(process["sample"] for process in processes)
    return {
        "sample": statistics.median(samples),
        "span": [samples[0], samples[-1]],
        "plain": statistics.median(process["plain"] for process in processes),
        "ratio": statistics.median(process["ratio"] for process in processes),
        "turns": sum(process["turns"] for process in processes),
    }


def commits(line: Line, seconds: float) -> list[dict[str, Any]]:
    """A commit and a whole step of a program, with the outputs of one slave and of all."""
    result = []
    with line.exchanged():
        for claimed in (1, line.slaves):
            found = line.plant.run("commit", claimed, seconds)
            result.append({"slaves": line.slaves, "claimed": claimed, **found})
    return result


def system_calls(line: Line, plant: Plant) -> dict[str, Any]:
    """System calls of 10000 steps, counted by strace."""
    strace = shutil.which("strace")
    if strace is None:
        return {"reason": "strace is not installed"}
    log = plant.folder / "calls"
    with line.exchanged():
        steps = plant.run("commit", 1, "--once", command=(strace, "-o", str(log)))["steps"]
    calls = [call.partition("(")[0] for call in log.read_text().splitlines()]
    first, second = (n for n, call in enumerate(calls) if call == _MARK)
    between = calls[first + 1 : second]
    return {
        "steps": steps,
        "calls": sum(call != _RARE for call in between),
        "yields": between.count(_RARE),
    }

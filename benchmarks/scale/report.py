"""The results of large buses in words."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..target import verdicts
from ..words import table
from .targets import LARGE, targets

TITLE = "Many slaves"
_MIB, _KIB = 1 << 20, 1 << 10

_HOW = """\
The whole daemon at 1 kHz on the rig `terminals:N`: couplers and digital terminals, most with one \
byte. OP counts from the command, until `ecatctl` gets answers. Memory is what bus server and \
gateway have for themselves, and the shared memory of the bus. Frames are counted with those of \
the cycle answered by the simulator, and again with those answered in the kernel, as for two \
cores:"""

_MEMORY = """\
A line through the sums: {bus:.0f} MiB for the daemon, and {slave:.1f} KiB for each slave. On \
a wire, each slave delays a frame by some 0.8 µs, so a line of 1000 has no room for 100 Mbit/s \
cycles of much less than 1 ms; the simulator answers at once."""


def section(result: dict[str, Any]) -> str:
    """What the results say, in Markdown."""
    memory = result["memory"]
    return "\n\n".join(
        part
        for part in (
            f"## {TITLE}",
            _unanswered(result["obstacle"]),
            "![Start and memory by the number of slaves](performance/scale.svg)",
            verdicts(targets(result), result["machine"]),
            _HOW,
            _cases(result["cases"]),
            _MEMORY.format(bus=memory["bus"] / _MIB, slave=memory["slave"] / _KIB),
            _work(result["work"]),
        )
        if part
    )


def _unanswered(obstacle: str | None) -> str:
    return f"Not measured with frames answered in the kernel: {obstacle}." if obstacle else ""


def _cases(cases: list[dict[str, Any]]) -> str:
    rows = [
        (
            case["slaves"],
            f"{case['start']:.1f}",
            f"{case['memory'] / _MIB:.1f}",
            f"{case['shared'] / _KIB:.0f}",
            who,
            counts["cycles"],
            counts["missed_cycles"],
            f"{counts['lost_frames']} of {counts['frames']}",
        )
        for case in cases
        for who, counts in case["answered"].items()
    ]
    head = ("slaves", "to OP, s", "own memory, MiB", "shared memory, KiB")
    return table((*head, "answered by", "cycles", "missed", "frames lost"), rows)


def _work(work: dict[str, Any]) -> str:
    """Instructions of the engine in a cycle."""
    if "reason" in work:
        return f"The engine's instructions were not counted: {work['reason']}."
    rows = [
        (x["slaves"], x["bytes"], x["frames"], f"{x['instructions']:.0f}") for x in work["points"]
    ]
    return "\n\n".join(
        (
            "Instructions of the engine in a cycle, outside the kernel, with a byte of outputs and "
            "one of inputs for each slave:",
            table(("slaves", "bytes", "frames", "instructions"), rows),
        )
    )


def plot(result: dict[str, Any], path: Path) -> None:
    """Draws the time to OP and the memory by the number of slaves."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    style: Any = {"svg.fonttype": "none", "svg.hashsalt": "ecatd", "font.size": 9}
    with plt.rc_context(style):
        figure, (start, memory) = plt.subplots(1, 2, figsize=(8, 3.2), layout="constrained")
        slaves = [case["slaves"] for case in result["cases"]]
        start.plot(slaves, [case["start"] for case in result["cases"]], "o-", color="#1f6fb4")
        start.set(xlabel="slaves", ylabel="s", title="From the command to OP")
        memory.plot(
            slaves, [case["memory"] / _MIB for case in result["cases"]], "o-", color="#1f6fb4"
        )
        memory.set(xlabel="slaves", ylabel="MiB", title="Memory of bus server and gateway")
        for axes in (start, memory):
            axes.set_xlim(0, 1.05 * max(*slaves, LARGE))
            axes.set_ylim(0)
        figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)
        plt.close(figure)

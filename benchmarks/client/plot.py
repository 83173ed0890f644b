"""The results of clients as a plot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .targets import FLAT, exchange

_STYLE: Any = {"svg.fonttype": "none", "svg.hashsalt": "ecatd", "font.size": 9}


def plot(result: dict[str, Any], path: Path) -> None:
    """Draws snapshots by the number of readers."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    with plt.rc_context(_STYLE):
        figure, axes = plt.subplots(figsize=(7, 3.6), layout="constrained")
        _draw_snapshots(axes, result["snapshots"])
        figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)
        plt.close(figure)


def _draw_snapshots(axes: Any, cases: list[dict[str, Any]]) -> None:
    for free_running, color in ((False, "#1f6fb4"), (True, "#e08e2b")):
        found = [case for case in cases if case["free_running"] == free_running]
        readers = [case["readers"] for case in found]
        label = exchange(free_running)
        axes.plot(readers, [c["sample"] for c in found], "o-", color=color, label=label, ms=4)
        plain = f"plain copy, {label}"
        axes.plot(readers, [c["plain"] for c in found], "o:", color=color, label=plain, ms=3)
    alone = cases[0]["sample"]
    axes.axhspan(alone * (1 - FLAT), alone * (1 + FLAT), color="#1f6fb4", alpha=0.12, lw=0)
    axes.set_xscale("log", base=2)
    axes.set_xticks(readers, [str(count) for count in readers])
    axes.set(
        xlabel="readers",
        ylabel="ns",
        ylim=(0, None),
        title="Snapshot of 256 bytes and 20 reads; band: ± 15 % of one reader",
    )
    axes.legend(frameon=False, fontsize=8)

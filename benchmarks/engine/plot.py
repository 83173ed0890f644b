"""The results of `engine.py` as a plot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..words import US
from .targets import EXCHANGE

_STYLE: Any = {"svg.fonttype": "none", "svg.hashsalt": "ecatd", "font.size": 9}
_COLORS = {
    "bare": "#8c8c8c",
    "engine": "#1f6fb4",
    "bare busy": "#c4c4c4",
    "engine busy": "#7fb3dd",
    "pysoem": "#e08e2b",
    "kickcat": "#5b9a5b",
}


def plot(result: dict[str, Any], path: Path) -> None:
    """Draws exchanges, their ratios to the bare loop, rates, and the engine's work."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    with plt.rc_context(_STYLE):
        figure, axes = plt.subplots(2, 2, figsize=(12, 7.6), layout="constrained")
        lines = result["lines"]
        _draw_exchange(axes[0][0], lines)
        _draw_ratios(axes[0][1], lines)
        _draw_rates(axes[1][0], lines)
        _draw_work(axes[1][1], result["work"])
        figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)
        plt.close(figure)


def _at_rate(line: dict[str, Any], rate: float) -> dict[str, Any]:
    loops: dict[str, Any] = next(c["loops"] for c in line["exchange"] if c["rate"] == rate)
    return loops


def _ticks(axes: Any, lines: Sequence[dict[str, Any]]) -> None:
    axes.set_xticks(range(len(lines)), [str(line["slaves"]) for line in lines])
    axes.set_xlabel("slaves")


def _bars(axes: Any, lines: Sequence[dict[str, Any]], rate: float, key: str) -> None:
    """A bar for each loop with each line."""
    for k, (name, color) in enumerate(_COLORS.items()):
        found = [(i, _at_rate(line, rate).get(name)) for i, line in enumerate(lines)]
        at = [i + 0.14 * (k - 2.5) for i, loop in found if loop]
        scale = US if key == "p50" else 1000.0
        values = [loop[key] / scale for _, loop in found if loop]
        axes.bar(at, values, 0.13, color=color, label=name)
        if key == "p50":
            tail = [max(0.0, (loop["p99"] - loop["p50"]) / US) for _, loop in found if loop]
            axes.errorbar(
                *(at, values, [[0.0] * len(at), tail]), fmt="none", ecolor="#333", lw=0.8, capsize=2
            )
    _ticks(axes, lines)


def _draw_exchange(axes: Any, lines: Sequence[dict[str, Any]]) -> None:
    _bars(axes, lines, 1000, "p50")
    axes.set(ylabel="µs", title="Exchange at 1 kHz: median, whisker to p99")
    axes.set_ylim(top=1.3 * axes.get_ylim()[1])  # room for the legend
    axes.legend(frameon=False, ncols=3, loc="upper left")


def _draw_rates(axes: Any, lines: Sequence[dict[str, Any]]) -> None:
    _bars(axes, lines, 0, "rate")
    axes.set(ylabel="1000 cycles a second", title="Free-running")


def _draw_ratios(axes: Any, lines: Sequence[dict[str, Any]]) -> None:
    """Median ratio with quartiles, and that of the 99th percentiles, for every rate."""
    labels: list[str] = []
    for i, line in enumerate(lines):
        cases = [(case, kind) for case in line["exchange"] for kind in ("blocking", "busy")]
        for k, (case, kind) in enumerate(cases):
            at = i + 0.8 * ((k + 0.5) / len(cases) - 0.5)
            ratio = case["ratios"][kind]["exchange"]
            low, high = ratio["p50_quartiles"]
            color = _COLORS["engine" if kind == "blocking" else "engine busy"]
            label = f"{kind}, median" if f"{kind}, median" not in labels else None
            labels.append(label or "")
            axes.errorbar(
                *(at, ratio["p50"], [[max(0, ratio["p50"] - low)], [max(0, high - ratio["p50"])]]),
                fmt="o",
                color=color,
                markersize=4,
                capsize=2,
                lw=0.8,
                label=label,
            )
            axes.plot(at, ratio["p99"], "_", color=color, markersize=8)
    axes.axhline(EXCHANGE, color="#c0392b", lw=1.2, ls="--")
    axes.axhline(1.0, color="#8c8c8c", lw=0.8)
    _ticks(axes, lines)
    axes.set(title="Exchange, ratio to the bare loop at all rates; dash: p99; red: at most")
    axes.legend(frameon=False, fontsize=8)


def _draw_work(axes: Any, work: dict[str, Any]) -> None:
    axes.set(xlabel="bytes of the image", title="The engine's own work")
    if "points" not in work:
        axes.text(0.5, 0.5, "not measured", ha="center", transform=axes.transAxes)
        return
    for slaves in sorted({point["slaves"] for point in work["points"]}):
        chosen = [point for point in work["points"] if point["slaves"] == slaves]
        axes.plot(
            [point["bytes"] for point in chosen],
            [point["instructions"] for point in chosen],
            "o",
            markersize=4,
            label=f"{slaves} slave{'s' * (slaves != 1)}",
        )
    axes.set(ylabel="instructions a cycle", ylim=(0, None), xlim=(0, None))
    axes.legend(frameon=False, fontsize=8)

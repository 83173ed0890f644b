"""The results of `simulator.py` in words and as a plot."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ..target import Target, verdicts
from ..words import US, pace, slaves, table, us

TITLE = "The simulator"
TARGETS = {8: 1.15, 64: 2.0}
"""Largest ratio of the turn-around to that of the echo, by slaves."""
START_TARGET = 1.0
_NOISE_NS = 0.02


def _receive(case: dict[str, Any]) -> str:
    return "polling" if case["spin"] else "sleeping"


def section(result: dict[str, Any]) -> str:
    """What the results say, in Markdown."""
    return "\n\n".join(
        (
            f"## {TITLE}",
            "Frames go over a veth pair to `ecatsim run line:N`, or over another one to "
            "`benchmarks/c/echo.c`, which only receives, marks and sends. Both get the same "
            "frames, in turns of a fraction of a second. Each slave has "
            "32 bytes of outputs and 32 bytes of inputs; all slaves are in OP, return their "
            "outputs as inputs, and the working counter of every cycle is checked. A cycle is "
            "one LRW datagram a frame with at most 23 slaves in it, so 64 slaves take 3 frames "
            "and 200 slaves 9. Turn-around is the time from before the first frame is sent until "
            "the last one is back. The master sleeps in the socket or polls it; the far end "
            "always sleeps. A ratio is the median over the rounds, with the quartiles behind it.",
            "![Turn-around, its ratio to the echo, and the slave controllers alone]"
            "(performance/simulator.svg)",
            verdicts(_targets(result), result["machine"]),
            "Turn-around in µs:",
            _turn_around(result["turn_around"]),
            "Cycles a second, free-running:",
            _rates(result["turn_around"]),
            _alone(result["processing"]),
            _steps(result["step"]),
        )
    )


def _targets(result: dict[str, Any]) -> Iterator[Target]:
    for case in result["turn_around"]:
        most = TARGETS.get(case["slaves"])
        if most is not None:
            yield Target(
                f"turn-around, {slaves(case['slaves'])}, {pace(case['rate'])}, {_receive(case)}",
                f"≤ {most} × echo",
                f"{case['ratio_p50']:.2f} ×",
                case["ratio_p50"] <= most,
            )
    long = result["endurance"]
    yield Target(
        f"{slaves(long['slaves'])} at 1 kHz for {long['seconds']:.0f} s, "
        f"{long['cycles'] * long['frames']} frames",
        "none lost",
        f"{long['lost_frames']} lost, {long['wrong']} with a wrong working counter",
        long["lost_frames"] + long["wrong"] == 0,
        cores=3,  # master, frames, device side
    )
    for key, what in (
        ("own_namespace", "`ecatsim run troll` to the first answer, with a namespace of its own"),
        ("existing_interface", "the same on an existing interface, polled from the beginning"),
    ):
        worst = max(result["start"][key])
        yield Target(what, f"< {START_TARGET:g} s", f"at most {worst:.2f} s", worst < START_TARGET)


def _turn_around(cases: Sequence[dict[str, Any]]) -> str:
    rows = []
    for case in cases:
        echo, ours = case["echo"], case["simulator"]
        low, high = case["ratio_p50_quartiles"]
        rows.append(
            (
                f"{case['slaves']}, {pace(case['rate'])}, {_receive(case)}",
                *(us(echo[key]) for key in ("p50", "p99", "max")),
                *(us(ours[key]) for key in ("p50", "p99", "max")),
                f"{case['ratio_p50']:.2f} ({low:.2f} to {high:.2f})",
                f"{case['ratio_p99']:.2f}",
                ours["lost_frames"],
            )
        )
    head = ("slaves", "echo p50", "p99", "max", "ecatsim p50", "p99", "max")
    return table((*head, "ratio p50", "ratio p99", "lost"), rows)


def _rates(cases: Sequence[dict[str, Any]]) -> str:
    rows = [
        (
            f"{case['slaves']}, {_receive(case)}",
            f"{case['echo']['rate']:.0f}",
            f"{case['simulator']['rate']:.0f}",
            f"{case['simulator']['rate'] * case['slaves']:.3g}",
        )
        for case in cases
        if not case["rate"]
    ]
    return table(("slaves", "echo", "ecatsim", "ecatsim, slaves a second"), rows)


def _alone(result: dict[str, Any]) -> str:
    fit = result["fit"]
    byte = f"{fit['byte']:.2f} ns" if fit["byte"] >= _NOISE_NS else f"less than {_NOISE_NS} ns"
    return (
        f"The slave controllers alone (`esc_process`, no wire): an LRW frame costs "
        f"{fit['frame']:.0f} ns, and {fit['slave']:.1f} ns more for each slave it reads and "
        f"writes, {byte} for each byte, {fit['bystander']:.1f} ns for each slave "
        f"that it passes untouched; fitted to {len(result['points'])} points."
    )


def _steps(steps: Sequence[dict[str, Any]]) -> str:
    rows = [(step["rig"], us(step["p50"]), us(step["p99"])) for step in steps]
    return (
        "The device side in Python makes a step each millisecond. It does not hold up frames: "
        "they are answered by a thread of their own. One step takes, in µs:\n\n"
        + table(("rig", "p50", "p99"), rows)
    )


def plot(result: dict[str, Any], path: Path) -> None:
    """Draws turn-around, ratios and the cost of the slave controllers."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    style: Any = {"svg.fonttype": "none", "svg.hashsalt": "ecatd", "font.size": 9}
    with plt.rc_context(style):
        figure, axes = plt.subplots(1, 3, figsize=(12, 3.8), layout="constrained")
        _draw_turn_around(axes[0], result["turn_around"])
        _draw_ratios(axes[1], result["turn_around"])
        _draw_alone(axes[2], result["processing"])
        figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)
        plt.close(figure)


_ECHO, _OURS = "#8c8c8c", "#1f6fb4"


def _draw_turn_around(axes: Any, cases: Sequence[dict[str, Any]]) -> None:
    chosen = [case for case in cases if case["rate"] and not case["spin"]]
    for k, (peer, color, name) in enumerate(
        (("echo", _ECHO, "bare echo"), ("simulator", _OURS, "ecatsim"))
    ):
        at = [i + 0.38 * (k - 0.5) for i in range(len(chosen))]
        median = [case[peer]["p50"] / US for case in chosen]
        tail = [
            max(0.0, case[peer]["p99"] / US - m) for case, m in zip(chosen, median, strict=True)
        ]
        axes.bar(at, median, 0.36, color=color, label=name)
        axes.errorbar(at, median, [[0.0] * len(at), tail], fmt="none", ecolor="#333", capsize=3)
    axes.set_xticks(range(len(chosen)), [str(case["slaves"]) for case in chosen])
    axes.set(xlabel="slaves", ylabel="µs", title="Turn-around at 1 kHz: median, whisker to p99")
    axes.legend(frameon=False, loc="upper left")


def _draw_ratios(axes: Any, cases: Sequence[dict[str, Any]]) -> None:
    counts = sorted({case["slaves"] for case in cases})
    marks = (
        (True, False, "o", _OURS),
        (True, True, "^", _OURS),
        (False, False, "s", "#e08e2b"),
        (False, True, "D", "#e08e2b"),
    )
    for k, (paced, spin, mark, color) in enumerate(marks):
        chosen = [c for c in cases if bool(c["rate"]) == paced and c["spin"] == spin]
        at = [counts.index(c["slaves"]) + 0.18 * (k - 1.5) for c in chosen]
        ratio = [c["ratio_p50"] for c in chosen]
        spread = [
            [r - c["ratio_p50_quartiles"][0] for r, c in zip(ratio, chosen, strict=True)],
            [c["ratio_p50_quartiles"][1] - r for r, c in zip(ratio, chosen, strict=True)],
        ]
        label = f"{'1 kHz' if paced else 'free-running'}, {'polling' if spin else 'sleeping'}"
        axes.errorbar(
            at, ratio, spread, fmt=mark, color=color, markersize=5, capsize=2, lw=0.8, label=label
        )
    for count, target in TARGETS.items():
        if count in counts:
            middle = counts.index(count)
            axes.hlines(target, middle - 0.42, middle + 0.42, color="#c0392b", lw=1.5, ls="--")
    axes.axhline(1.0, color=_ECHO, lw=0.8)
    axes.set_xticks(range(len(counts)), [str(count) for count in counts])
    axes.set(xlabel="slaves", title="Ratio to the echo, with quartiles; red: at most")
    axes.legend(frameon=False, loc="upper left", fontsize=8)


def _draw_alone(axes: Any, result: dict[str, Any]) -> None:
    fit = result["fit"]
    points = [point for point in result["points"] if not point["bystanders"]]
    sizes = sorted({point["bytes"] // point["slaves"] for point in points})
    for size in sizes:
        chosen = [point for point in points if point["bytes"] == size * point["slaves"]]
        axes.plot(
            [point["slaves"] for point in chosen],
            [point["ns"] for point in chosen],
            "o",
            markersize=4,
            label=f"{size} bytes a slave",
        )
    most = max(point["slaves"] for point in points)
    per_slave = fit["slave"] + fit["byte"] * max(sizes)
    axes.plot([0, most], [fit["frame"], fit["frame"] + per_slave * most], color="#333", lw=0.8)
    axes.set(
        xlabel="slaves in the frame",
        ylabel="ns",
        title=f"Slave controllers alone: {fit['frame']:.0f} + {fit['slave']:.1f} ns a slave",
        ylim=(0, None),
        xlim=(0, None),
    )
    axes.legend(frameon=False, fontsize=8)

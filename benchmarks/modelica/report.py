"""The results of models in words."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..target import verdicts
from ..words import slaves, table, us
from .targets import targets

TITLE = "Models"

_HOW = """\
One sample of a model in which every slave of the bus has its block: wait, the state of each \
slave, all reads, all writes, a commit. Each slave has two inputs and two outputs of 32 bits. \
*Blocks* are the calls of the blocks of a generated library, made from C; *plain* is the least \
that a program in C can do: a sample, the same reads and writes by handle, and one commit. Both go \
through the same connection, in turns of 100; ratios are medians over neighbouring turns. The \
engine exchanges at 1 kHz meanwhile."""

_TRANSLATED = """\
*OpenModelica* is a whole model of these blocks, translated and run free-running by OpenModelica: \
its events, its solver and its bookkeeping are in the time."""

_GENERATION = """\
`ecatctl generate` as a command, with a saved scan of {slaves} ({signals} entries; the reference \
plant again and again): {seconds:.2f} s into an empty folder ({files} files, {mb:.1f} MB), \
{again:.2f} s when nothing changes."""


def section(result: dict[str, Any]) -> str:
    """What the results say, in Markdown."""
    generation = result["generation"]
    return "\n\n".join(
        (
            f"## {TITLE}",
            _HOW,
            _TRANSLATED if "cases" in result["translated"] else _not_translated(result),
            "![A sample of a model](performance/modelica.svg)",
            verdicts(targets(result), result["machine"]),
            _samples(result),
            _GENERATION.format(
                **{**generation, "slaves": slaves(generation["slaves"])},
                mb=generation["bytes"] / 1e6,
            ),
        )
    )


def _not_translated(result: dict[str, Any]) -> str:
    return f"No model was translated: {result['translated'].get('reason', 'it was a trial')}."


def _samples(result: dict[str, Any]) -> str:
    whole = {case["slaves"]: case["sample"] for case in result["translated"].get("cases", [])}
    rows = [
        (
            case["slaves"],
            f"{case['reads']} + {case['writes']}",
            us(case["plain"]),
            us(case["model"]),
            f"{case['ratio']:.2f}",
            f"{(case['model'] - case['plain']) / (case['reads'] + case['writes']):.1f}",
            us(whole[case["slaves"]]) if case["slaves"] in whole else "–",
        )
        for case in result["samples"]
    ]
    return table(
        (
            *("slaves", "reads + writes", "plain, µs", "blocks, µs", "ratio"),
            *("more a value, ns", "OpenModelica, µs"),
        ),
        rows,
    )


def plot(result: dict[str, Any], path: Path) -> None:
    """Draws the time of a sample by the number of slaves."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    style: Any = {"svg.fonttype": "none", "svg.hashsalt": "ecatd", "font.size": 9}
    with plt.rc_context(style):
        figure, axes = plt.subplots(figsize=(7, 3.6), layout="constrained")
        count = [case["slaves"] for case in result["samples"]]
        for key, label, color in (
            ("plain", "plain calls", "#888888"),
            ("model", "calls of the blocks", "#1f6fb4"),
        ):
            values = [case[key] / 1000 for case in result["samples"]]
            axes.plot(count, values, "o-", color=color, label=label, ms=4)
        if cases := result["translated"].get("cases"):
            values = [case["sample"] / 1000 for case in cases]
            axes.plot(
                [case["slaves"] for case in cases],
                values,
                "s--",
                color="#e08e2b",
                label="model in OpenModelica",
                ms=4,
            )
        axes.set(
            xlabel="slaves, two inputs and two outputs each",
            ylabel="µs",
            xlim=(0, None),
            ylim=(0, None),
            title="One sample of a model",
        )
        axes.legend(frameon=False, fontsize=8)
        figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)
        plt.close(figure)

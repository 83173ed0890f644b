"""The results of requests in words."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..target import verdicts
from ..words import US, table, us
from .targets import CLIENTS, MS, RATE, targets

TITLE = "SDO reads over Zenoh"

_HOW = """\
The whole daemon runs on the rig `troll` at 1 kHz; nobody has a processor for itself. Clients in \
Python that stay connected read an object of 4 bytes of one slave, each asking again as soon as it \
has the answer, for some seconds in turns. Times are from the question to the answer, in µs:"""

_COMMAND = """\
One read as a command, `ecatctl sdo-read`, from the start of the process to its end, in turns with \
an interpreter that does nothing, {count} times each, in ms:"""


def section(result: dict[str, Any]) -> str:
    """What the results say, in Markdown."""
    return "\n\n".join(
        (
            f"## {TITLE}",
            "![How long SDO reads take](performance/requests.svg)",
            verdicts(targets(result), result["machine"]),
            _HOW,
            _reads(result["reads"]),
            _COMMAND.format(count=result["command"]["count"]),
            _command(result["command"]),
        )
    )


def _reads(cases: list[dict[str, Any]]) -> str:
    rows = [
        (
            case["clients"],
            f"{case['rate']:.0f} ({case['rates'][0]:.0f} to {case['rates'][-1]:.0f})",
            us(case["p50"]),
            us(case["p99"]),
            case["reads"],
        )
        for case in cases
    ]
    return table(("clients", "reads a second, median (range)", "p50", "p99", "reads"), rows)


def _command(found: dict[str, Any]) -> str:
    rows = [
        (name, *(f"{found[kind][key] / MS:.0f}" for key in ("best", "median")))
        for kind, name in (("command", "`ecatctl sdo-read`"), ("python", "`python -c pass`"))
    ]
    return table(("what", "best", "median"), rows)


def plot(result: dict[str, Any], path: Path) -> None:
    """Draws the rates, and how long a read takes."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    style: Any = {"svg.fonttype": "none", "svg.hashsalt": "ecatd", "font.size": 9}
    with plt.rc_context(style):
        figure, (rates, times) = plt.subplots(1, 2, figsize=(8, 3.2), layout="constrained")
        names = [str(case["clients"]) for case in result["reads"]]
        rates.bar(names, [case["rate"] for case in result["reads"]], 0.5, color="#1f6fb4")
        rates.axhline(RATE, color="#8c8c8c", linestyle=":")
        rates.set(
            xlabel="clients", title=f"SDO reads a second; {RATE} are meant with {CLIENTS} clients"
        )
        for key, color, shift in (("p50", "#1f6fb4", -0.18), ("p99", "#8c8c8c", 0.18)):
            places = [number + shift for number in range(len(names))]
            values = [case[key] / US for case in result["reads"]]
            times.bar(places, values, 0.34, color=color, label=key)
        times.set_xticks(range(len(names)), names)
        times.set(xlabel="clients", ylabel="µs", title="From question to answer")
        times.legend(frameon=False, fontsize=8)
        figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)
        plt.close(figure)

"""The results of two processors in words."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import Any

from ..engine.turns import ENGINE, SLEEP
from ..segment.responder import KERNEL
from ..target import verdicts
from ..words import US, pace, table, us
from .benchmark import OWN
from .targets import LOAD, targets

TITLE = "Two cores"

_HOW = """\
Many industrial PCs have two cores. Here everything shares two, however many there are: the \
engine, the Python of the daemon, its clients, the loads and the simulator. A machine with real \
slaves has no simulator. So each measurement is made twice:

- *simulator*: `ecatsim` answers all frames. To do so it must be woken, on the same two cores.
- *kernel*: an XDP program on the far end of the veth pair answers the frames of the cycle as \
`ecatsim` did before (`benchmarks/c/responder.c`), in the system call that sends them, so that \
nobody has to be woken. `ecatsim` still answers for mailboxes and registers. Inputs stand still.

The difference is what the simulator costs. The targets are for the engine, so they use the \
second kind."""

_ALONE = """\
The engine on 8 slaves with 32 bytes of outputs and of inputs each, in turns with a loop in C that \
only wakes up (*sleep*), in µs:"""

_LOADS = """\
The whole daemon on the rig `troll` at 1 kHz beside loads. Each load is on for a fraction of a \
second and off for as long, in turns; values are medians over the turns, in µs, and sums. The \
sleeping loop has turns of its own beside the load, on the processors of the engine. *Own*: the \
engine has a core for itself (`realtime.cpu`), and everything else shares the other one. *Shared*: \
everything may run on both cores."""

_ADVICE = """\
How to get this on a machine with two cores: set `realtime.cpu`, so that the daemon leaves that \
core to the engine, and keep all other programs off it, too (`isolcpus=` on the command line of \
the kernel, or `CPUAffinity=` in `/etc/systemd/system.conf`). Then the length of the exchange does \
not depend on SDO traffic, clients or busy Python programs. When a cycle begins is up to the \
kernel and the machine: the engine misses deadlines where a loop that only sleeps is late, too. A \
kernel with PREEMPT_RT helps there, and a processor that does not fall asleep. Do not judge such a \
machine by a simulated bus: `ecatsim` needs a core of its own to answer in time, so that takes \
three cores."""


def section(result: dict[str, Any]) -> str:
    """What the results say, in Markdown."""
    reason = result["obstacle"]
    return "\n\n".join(
        part
        for part in (
            f"## {TITLE}",
            _HOW,
            f"Not measured with frames answered in the kernel: {reason}." if reason else "",
            "![Exchange beside loads](performance/cores.svg)",
            verdicts(targets(result), result["machine"]),
            _ALONE,
            _alone(result["alone"]),
            _LOADS,
            _loads(result["loads"]),
            _ADVICE,
        )
        if part
    )


def _alone(cases: list[dict[str, Any]]) -> str:
    rows = []
    for case in cases:
        for name in (ENGINE, SLEEP):
            loop = case["loops"][name]
            exchange = [us(loop[f"exchange_p{q}"]) if name == ENGINE else "–" for q in (50, 99)]
            rows.append(
                (
                    f"{case['responder']}, {pace(case['rate'])}, {name}",
                    *exchange,
                    *(us(loop[f"wakeup_p{q}"]) for q in ("50", "99")),
                    loop["cycles"],
                    loop["missed_cycles"],
                    loop.get("lost_frames", "–"),
                )
            )
    head = ("answered by", "exchange p50", "p99", "wake-up p50", "p99", "cycles", "missed", "lost")
    return table(head, rows)


def _loads(loads: list[dict[str, Any]]) -> str:
    rows = []
    for load in loads:
        off, on, sleep = load["off"], load["on"], load[SLEEP]
        low, high = load["ratio_p99_quartiles"]
        rows.append(
            (
                f"{load['responder']}, {load['place']}, {load['load']}",
                f"{load['rate']:.0f}" if load["rate"] else "–",
                *(f"{us(off[key])} / {us(on[key])}" for key in ("p50", "p99")),
                f"{load['ratio_p99']:.2f} ({low:.2f} to {high:.2f})",
                f"{off['cycles']} / {on['cycles']}",
                f"{off['missed_cycles']} / {on['missed_cycles']}",
                f"{sleep['missed_cycles']} of {sleep['cycles']}",
                f"{off['lost_frames']} / {on['lost_frames']}",
            )
        )
    head = ("answered by, core, load", "done a second", "p50 off / on", "p99", "ratio p99")
    return table((*head, "cycles", "missed", "sleep missed", "lost"), rows)


def plot(result: dict[str, Any], path: Path) -> None:
    """Draws the 99th percentile of the exchange beside each load."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    style: Any = {"svg.fonttype": "none", "svg.hashsalt": "ecatd", "font.size": 9}
    with plt.rc_context(style):
        figure, axes = plt.subplots(figsize=(8, 3.8), layout="constrained")
        names = list(dict.fromkeys(load["load"] for load in result["loads"]))
        kinds = list(dict.fromkeys((x["responder"], x["place"]) for x in result["loads"]))
        for number, kind in enumerate(kinds):
            chosen = [x for x in result["loads"] if (x["responder"], x["place"]) == kind]
            color = "#1f6fb4" if kind == (KERNEL, OWN) else "#8c8c8c"
            for key, alpha, shift in (("off", 0.45, -0.065), ("on", 1.0, 0.065)):
                axes.bar(
                    [names.index(x["load"]) + 0.29 * (number - 1) + shift for x in chosen],
                    [x[key]["p99"] / US for x in chosen],
                    0.12,
                    color=color,
                    alpha=alpha * (0.6 if kind[1] != OWN else 1.0),
                    label=f"{kind[0]}, {kind[1]}, load {key}",
                )
        axes.set_xticks(range(len(names)), [textwrap.fill(name, 22) for name in names])
        axes.set(ylabel="µs", title=f"99th percentile of the exchange; at most {LOAD:g} × is meant")
        axes.legend(frameon=False, fontsize=8, ncols=3)
        axes.set_ylim(0, 1.2 * axes.get_ylim()[1])
        figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)
        plt.close(figure)

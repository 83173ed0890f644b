"""The results of clients in words."""

from __future__ import annotations

from typing import Any

from ..target import verdicts
from ..words import pace, table, us
from .comparison import comparison
from .plot import plot
from .targets import exchange, targets

__all__ = ["plot", "section"]

TITLE = "Clients of the process image"

_HOW = """\
Programs in C use the client library while the engine of the daemon exchanges with simulated \
slaves. The bus has 8 slaves with 16 bytes of outputs and of inputs each: a domain of 256 bytes. \
A turn is 100 calls in a row; times are medians over the turns. Beside each turn of *snapshot and \
20 reads by handle* there is one of the least that it could be: a `memcpy` of the same bytes from \
the same memory, without knowing whether they are consistent, and 20 plain loads. Every call of \
both waits until the one before it has ended, as in a program that does it once a cycle; that \
wait is subtracted."""

_READERS = """\
Readers are processes, pinned in turns to the processors that {who} ({processors}). With more \
readers than processors they share them, and a time is \
that of one who has its processor; more at the same instant there cannot be on this machine."""

_COSTS = """\
What clients cost the engine: time and instructions (outside the kernel) of its thread in a cycle \
of 1 ms with 200 slaves, sleeping at once for the answer. The time has the send and receive calls \
in it, and with them what the simulator does in them. Writers commit in every cycle and wait for \
nobody; waiters are processes that wait for every cycle and sample, woken at its end."""

_AXES = {
    "writers": "clients that commit, one slave each",
    "claims": "slaves whose outputs one such client owns",
    "waiters": "clients that wait",
}


def section(result: dict[str, Any]) -> str:
    """What the results say, in Markdown."""
    return "\n\n".join(
        part
        for part in (
            f"## {TITLE}",
            _HOW,
            "![Snapshots with many readers](performance/client.svg)",
            verdicts(targets(result), result["machine"]),
            _readers(result["processors"]),
            _snapshots(result["snapshots"]),
            "A commit, and a whole step of a program (sample, 20 reads, 4 writes, commit), in ns:",
            _commits(result["commits"]),
            _no_calls(result["calls"]),
            _delay(result["delay"]),
            _COSTS,
            *(_cost(result["costs"][axis], word) for axis, word in _AXES.items()),
            _waiting(result["costs"]["waiters"]["points"]),
            "The client in C++, beside C (a snapshot and 20 reads), and in Python, in ns:",
            _languages(result["languages"]),
            "How a model reaches the bus, beside other ways:",
            comparison(result),
        )
        if part
    )


def _readers(processors: dict[str, list[int]]) -> str:
    rest, peer = processors["rest"], processors["peer"]
    alone, shared = "neither the engine nor the simulator has", "the engine does not have"
    return _READERS.format(who=shared if set(rest) & set(peer) else alone, processors=len(rest))


def _snapshots(cases: list[dict[str, Any]]) -> str:
    rows = [
        (
            f"{case['readers']}, {exchange(case['free_running'])}",
            f"{case['sample']:.1f}",
            f"{case['span'][0]:.1f} to {case['span'][1]:.1f}",
            f"{case['plain']:.1f}",
            f"{case['ratio']:.2f}",
            case["turns"],
        )
        for case in cases
    ]
    head = ("readers", "snapshot, ns", "of all readers", "plain, ns", "ratio", "turns")
    return table(head, rows)


def _commits(cases: list[dict[str, Any]]) -> str:
    rows = [
        (case["slaves"], case["claimed"], f"{case['commit']:.1f}", f"{case['step']:.1f}")
        for case in cases
    ]
    return table(("slaves", "claimed by the program", "commit", "whole step"), rows)


def _no_calls(calls: dict[str, Any]) -> str:
    return f"System calls were not counted: {calls['reason']}." if "reason" in calls else ""


def _delay(delay: dict[str, Any]) -> str:
    urgent = "with" if delay["real_time"] else "without"
    rate = pace(delay.get("rate", 1000))
    engine = delay["engine"]
    return (
        f"From sample to wire: in each of {delay['cycles']} cycles at {rate} a program ({urgent} "
        f"real-time priority) waits, samples the number of the cycle, writes it to a slave that "
        f"returns its outputs in the same frame, and commits. {delay['exact']} times the number "
        f"went out and came back in exactly the next cycle; {delay['late']} times the program was "
        f"late (its commit had not returned at the deadline of the next cycle, or it slept through "
        f"one), {delay['lost']} times the frame was lost, {delay['wrong']} times there was no such "
        f"reason. The engine counted {engine[1]} commits one cycle after their sample, {engine[2]} "
        f"two, {engine[3]} more."
    )


def _cost(cost: dict[str, Any], word: str) -> str:
    points, more = cost["points"], cost["more"]
    number = next(key for key in points[0] if key not in more)
    columns = {"ns": ("µs a cycle", us), "exchange": ("exchange, µs", us)}
    columns["instructions"] = ("instructions", "{:.0f}".format)
    shown = [column for column in columns if column in points[0]]
    rows = [(p[number], *(columns[key][1](p[key]) for key in shown)) for p in points]
    return table((word, *(columns[key][0] for key in shown)), rows)


def _waiting(points: list[dict[str, Any]]) -> str:
    """Why those who wait are not for nothing."""
    none, most = points[0], points[-1]
    more = us(most["ns"] - none["ns"])
    return (
        f"So waiting is not for nothing: {more} µs of processor time a cycle with "
        f"{most['waiters']} clients. The engine wakes the first two itself, by a futex call that "
        f"wakes them one after the other, and the rest by one more to a thread of its own; both "
        f"come after the exchange, when the cycle is published, so frames do not come later."
    )


def _languages(languages: dict[str, Any]) -> str:
    wrapper = languages["wrapper"]
    rows = [
        ("C, snapshot and 20 reads", f"{wrapper['c']:.1f}"),
        ("C++, the same", f"{wrapper['cpp']:.1f}"),
        *((f"Python, {name}", f"{ns:.0f}") for name, ns in languages["python"].items()),
    ]
    return table(("what", "ns"), rows)

"""The results of clients in words."""

from __future__ import annotations

from typing import Any

from ..words import met, table
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
both waits until the one before it has ended, as in a program that does it once a cycle; that wait \
is subtracted."""

_READERS = """\
Readers are processes, pinned in turns to the processors that neither the engine nor the \
simulator has ({processors}). With more readers than processors they share them, and a time is \
that of one who has its processor; more at the same instant there cannot be on this machine."""


def section(result: dict[str, Any]) -> str:
    """What the results say, in Markdown."""
    rows = [(t.what, t.target, t.measured, met(t.met)) for t in targets(result)]
    processors = len(result["processors"]["rest"])
    return "\n\n".join(
        part
        for part in (
            f"## {TITLE}",
            _HOW,
            "![Snapshots with many readers](performance/client.svg)",
            table(("what", "target", "measured", "met"), rows),
            _READERS.format(processors=processors),
            _snapshots(result["snapshots"]),
            "A commit, and a whole step of a program (sample, 20 reads, 4 writes, commit), in ns:",
            _commits(result["commits"]),
            _no_calls(result["calls"]),
        )
        if part
    )


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

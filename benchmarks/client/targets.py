"""What clients are meant to reach, and whether they do."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ..target import Target
from ..words import slaves, us

SNAPSHOT_NS, SNAPSHOT_RATIO = 150, 3.0
"""Most that a snapshot of 256 bytes and 20 reads may take, also as a ratio to the plain copy."""
FLAT = 0.15
"""Most that it may differ from that of a single reader."""
COMMIT_NS = 200
CORES = 3
"""For the engine, for the simulator's frames, and for clients that never let them rest."""


def targets(result: dict[str, Any]) -> list[Target]:
    """All of them, in the order of the page."""
    return [
        *_snapshot(result["snapshots"]),
        *_commit(result["commits"]),
        *_calls(result["calls"]),
        *_delay(result["delay"]),
        *_costs(result["costs"]),
    ]


def exchange(free_running: bool) -> str:
    """How the engine exchanges meanwhile."""
    return "free-running" if free_running else "1 kHz"


def _snapshot(cases: list[dict[str, Any]]) -> Iterator[Target]:
    for free_running in (False, True):
        found = [case for case in cases if case["free_running"] == free_running]
        alone, pace = found[0], exchange(free_running)
        cores = CORES if free_running else 1
        yield Target(
            f"snapshot of 256 bytes and 20 reads, {pace}",
            f"≤ {SNAPSHOT_NS} ns",
            f"{alone['sample']:.0f} ns",
            alone["sample"] <= SNAPSHOT_NS,
            cores,
        )
        yield Target(
            f"the same beside a plain copy and 20 loads, {pace}",
            f"≤ {SNAPSHOT_RATIO:g} ×",
            f"{alone['ratio']:.1f} × ({alone['plain']:.0f} ns)",
            alone["ratio"] <= SNAPSHOT_RATIO,
            cores,
        )
        others = [case["sample"] / alone["sample"] for case in found]
        yield Target(
            f"the same with up to {found[-1]['readers']} readers, {pace}",
            f"± {FLAT:.0%} of one reader",
            f"{min(others) - 1:+.0%} to {max(others) - 1:+.0%}",
            all(abs(other - 1) <= FLAT for other in others),
            CORES,
        )


def _commit(cases: list[dict[str, Any]]) -> Iterator[Target]:
    for case in cases:
        if case["claimed"] == 1:
            yield Target(
                f"commit of the outputs of one slave, on a bus of {slaves(case['slaves'])}",
                f"≤ {COMMIT_NS} ns",
                f"{case['commit']:.0f} ns",
                case["commit"] <= COMMIT_NS,
            )


def _calls(calls: dict[str, Any]) -> Iterator[Target]:
    if "calls" in calls:
        yield Target(
            f"system calls of {calls['steps']} times sample, 20 reads, 4 writes and commit",
            "0",
            f"{calls['calls']} (and {calls['yields']} `sched_yield`)",
            calls["calls"] == 0,
        )


def _delay(delay: dict[str, Any]) -> Iterator[Target]:
    yield Target(
        f"from sample to wire, {delay['cycles']} cycles: exactly the next cycle, but where the "
        f"program was late or the frame lost",
        "0 wrong",
        f"{delay['exact']} exact, {delay['late']} program late, {delay['lost']} frame lost, "
        f"{delay['wrong']} wrong",
        delay["wrong"] == 0 and delay["exact"] > 0,
    )


def _costs(costs: dict[str, Any]) -> Iterator[Target]:
    """What has no target, and what has: waiting is to cost nothing."""
    for kind, each in (("writers", "client that commits"), ("claims", "claimed slave")):
        more = costs[kind]["more"]
        if "instructions" in more:
            yield Target(
                f"instructions of the engine for each {each}",
                "–",
                f"{more['instructions']:.0f}",
                True,
            )
    points = {point["waiters"]: point for point in costs["waiters"]["points"]}
    many = max(points)
    compared = [("exchange", "the exchange", 0), ("ns", "the engine's whole cycle", 0)]
    for key, what, few in (*compared, ("ns", "the engine's whole cycle", sorted(points)[-2])):
        if key in points[many]:
            yield Target(
                f"{what} with {many} waiting clients, beside {few}",
                f"≤ {1 + FLAT:.2f} ×",
                f"{points[many][key] / points[few][key]:.2f} × ({us(points[many][key])} µs)",
                points[many][key] <= (1 + FLAT) * points[few][key],
                CORES,
            )

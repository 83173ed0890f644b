"""What the engine is meant to reach, and whether it does."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ..target import Target
from ..words import pace, slaves
from .deadlines import allowed
from .loads import ATTACH, WANTED

EXCHANGE = 1.10
"""Largest ratio of an exchange to that of the bare loop."""
RATE = {"blocking": 1.1, "busy": 3.5}
"""Smallest ratio of the free-running rate to that of pysoem."""
LOAD = 1.10
"""Largest ratio of the 99th percentile of an exchange under load to that without."""
DONE = 0.95
"""Smallest part of a load that must have been done for anything to be said about it."""
WORK, WORK_SLAVE, WORK_BYTE = 3000, 60, 1
"""Instructions of a cycle with 8 slaves, and of each slave and byte more."""
CORES = 3
"""For the engine, for the simulator's frames, and for what disturbs both."""
CLOCKS_NS = 1000
"""Largest difference of a slave's clock to the reference clock."""
START = {8: 3.0, 199: 15.0}
"""Seconds from the command to OP, by slaves."""


def targets(result: dict[str, Any]) -> list[Target]:
    """All of them, in the order of the page."""
    return [
        *(target for line in result["lines"] for target in _exchange(line)),
        *(target for line in result["lines"] for target in _rate(line)),
        *(target for line in result["lines"] for target in _deadlines(line)),
        *_loads(result["loads"]),
        *_work(result["work"]),
        _clocks(result["clocks"]),
        *_start(result["start"]),
    ]


def _exchange(line: dict[str, Any]) -> Iterator[Target]:
    """A target for each way to receive and each quantile, at all rates."""
    paces = ", ".join(pace(case["rate"]) for case in line["exchange"])
    for kind in ("blocking", "busy"):
        for quantile, word in (("p50", "median"), ("p99", "99th percentile")):
            ratios = [case["ratios"][kind]["exchange"][quantile] for case in line["exchange"]]
            yield Target(
                f"exchange, {slaves(line['slaves'])}, {kind}, {word}; {paces}",
                f"≤ {EXCHANGE:.2f} × bare",
                ", ".join(f"{ratio:.2f}" for ratio in ratios) + " ×",
                all(ratio <= EXCHANGE for ratio in ratios),
            )


def _rate(line: dict[str, Any]) -> Iterator[Target]:
    for case in line["exchange"]:
        for kind, least in RATE.items():
            found = case["ratios"][kind]
            if "rate" in found:
                yield Target(
                    f"free-running, {slaves(line['slaves'])}, {kind}",
                    f"≥ {least} × pysoem",
                    f"{found['rate']:.2f} × (the bare loop {found['limit']:.2f} ×)",
                    found["rate"] >= least,
                )


def _deadlines(line: dict[str, Any]) -> Iterator[Target]:
    for case in line.get("deadlines", ()):
        for name in ("engine", "engine busy"):
            loop, sleep = case["loops"][name], case["loops"]["sleep"]
            most = allowed(case, name)
            kind = "busy" if name.endswith("busy") else "blocking"
            yield Target(
                f"missed of {loop['cycles']} cycles, {slaves(line['slaves'])}, "
                f"{pace(case['rate'])}, {kind}",
                f"≤ {most:.1f} (sleep: {sleep['missed_cycles']} of {sleep['cycles']})",
                str(loop["missed_cycles"]),
                loop["missed_cycles"] <= most,
                cores=CORES,
            )


def _loads(loads: list[dict[str, Any]]) -> Iterator[Target]:
    for load in loads:
        name = load["load"] + (", busy receive" if load["busy"] else "")
        on, off = load["on"], load["off"]
        if load["load"] == ATTACH:
            bad, before = (x["missed_cycles"] + x["lost_frames"] for x in (on, off))
            yield Target(
                f"cycles missed and frames lost beside {name} ({load['rate']:.0f} a second)",
                f"≤ {before} (without)",
                f"{bad} of {on['cycles']}",
                bad <= before,
                cores=CORES,
            )
            continue
        wanted = WANTED.get(load["load"], 0)
        enough = load["rate"] >= DONE * wanted
        low, high = load["ratio_p99_quartiles"]
        done = f"; {load['rate']:.0f} a second were done" if wanted else ""
        yield Target(
            f"exchange beside {name}, 99th percentile",
            f"≤ {LOAD:.2f} × without",
            f"{load['ratio_p99']:.2f} × ({low:.2f} to {high:.2f}){done}",
            enough and load["ratio_p99"] <= LOAD,
            cores=CORES,
        )
        yield Target(
            f"frames lost beside {name}",
            "0",
            f"{on['lost_frames']} of {on['frames']} (without: {off['lost_frames']}){done}",
            enough and on["lost_frames"] == 0,
            cores=CORES,
        )


def _work(work: dict[str, Any]) -> Iterator[Target]:
    if "points" not in work:
        return
    cells = [p for p in work["points"] if p["slaves"] == 8 and p["bytes"] == 512]
    for point in cells:
        yield Target(
            "instructions of the engine a cycle, 8 slaves with 64 bytes each",
            f"≤ {WORK}",
            f"{point['instructions']:.0f}",
            point["instructions"] <= WORK,
        )
    for what, key, most in (("slave", "slave", WORK_SLAVE), ("byte", "byte", WORK_BYTE)):
        yield Target(
            f"more for each {what}",
            f"≤ {most}",
            f"{work['fit'][key]:.2f}",
            work["fit"][key] <= most,
        )


def _clocks(clocks: dict[str, Any]) -> Target:
    drift, largest = max(map(abs, clocks["drifts"])), clocks["largest_ns"]
    return Target(
        f"distributed clocks of {len(clocks['drifts'])} slaves that drift by up to {drift:g} ppm, "
        f"difference to the reference clock",
        f"≤ {CLOCKS_NS} ns",
        f"at most {largest} ns in {clocks['seconds']:g} s",
        largest <= CLOCKS_NS,
    )


def _start(starts: list[dict[str, Any]]) -> Iterator[Target]:
    for start in starts:
        worst, most = max(start["seconds"]), START[start["slaves"]]
        yield Target(
            f"`ecatd` to OP, {slaves(start['slaves'])} ({start['rig']})",
            f"≤ {most:g} s",
            f"at most {worst:.2f} s",
            worst <= most,
        )

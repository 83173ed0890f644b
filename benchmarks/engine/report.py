"""The results of `engine.py` in words."""

from __future__ import annotations

from typing import Any

from ..target import verdicts
from ..words import pace, slaves, table, us
from .plot import plot
from .targets import RATE, targets

__all__ = ["plot", "section"]

TITLE = "The cyclic engine"

_HOW = """\
Five loops exchange process data with the slaves of one simulated segment (`ecatsim` on a veth \
pair), in turns of a fraction of a second, so that all of them meet the same disturbances:

- (a) *bare*: `benchmarks/c/ping.c`, a C loop that sends the frames that the engine was seen to \
send, and waits for them; it sleeps in `recv` (blocking) or polls the socket (busy);
- (b) *sleep*: `benchmarks/c/nanosleep.c`, a C loop that only wakes up on the grid: the limit of \
the machine;
- (c) *engine*: the cyclic engine of ecatd with its shared memory and all of its work, blocking \
(as it is by default: where answers usually come within 30 µs, `realtime.poll_us`, it polls for \
that long, and then it sleeps) and with \
`busy_receive`; its times are the histograms that it keeps there;
- (d) *pysoem*: `send_processdata()` and `receive_processdata()` in Python, over SOEM;
- (e) *kickcat*: `process_data()` in Python, over C++.

Slaves return their outputs as inputs. Each has 32 bytes of both; only the 200 have 8, since \
100 Mbit/s carry no more in a millisecond. Every master has FMMUs and logical addresses of its \
own in the same slaves, which stay in OP without watchdogs; the FMMUs of the others are switched \
off while one has its turn. Master and simulator run at real-time priority on processors of their \
own, everything else on the remaining ones. An exchange takes from before the first frame is sent \
until the last one is back and checked. All times are sorted into the same histograms, whose \
steps are 3 % wide. A turn has some hundred cycles or more; times are medians over the rounds of \
the median and of the 99th percentile of a turn. A ratio is the median over the rounds of the \
ratio to the neighbour in the same round, with the quartiles behind it: what disturbs the machine \
for a moment spoils few of them."""

_AWAKE = """\
A loop of the lowest priority (SCHED_IDLE) keeps the processors of master and simulator from \
sleeping, as `idle=poll` would: the host of a virtual machine gives an idle processor away and \
brings it back late, by up to a millisecond, which would be measured in place of the loops."""

_LOADS = """\
The whole daemon on the rig `troll` at 1 kHz, its Python on the remaining processors, as are the \
loads. Each load is on for a fraction of a second and off for as long, in turns; the values are \
differences of what stands in shared memory. SDO reads come from two clients over Zenoh, each \
asking again at once; the other requests, for what the daemon is, come from several at a given \
rate, and where fewer than 95 % of them were done, the targets beside them are not met; the busy \
thread computes in the interpreter of the bus server; each reader is a process that waits for \
every cycle and samples. Exchange in µs:"""

_WORK = """\
Instructions of the engine's thread outside the kernel, counted by the processor \
(`perf_event_open`, user mode only), at 1 kHz, sleeping at once for the answer, all outputs safe. \
Bytes are those of the whole image:"""


def section(result: dict[str, Any]) -> str:
    """What the results say, in Markdown."""
    return "\n\n".join(
        part
        for part in (
            f"## {TITLE}",
            _HOW,
            _AWAKE if result.get("awake") else "",
            _missing(result),
            "![Exchange, its ratio to the bare loop, rates, and work](performance/engine.svg)",
            verdicts(targets(result), result["machine"]),
            "Exchange in µs, blocking:",
            _exchange(result, ("bare", "engine", "pysoem", "kickcat")),
            "Exchange in µs, busy:",
            _exchange(result, ("bare busy", "engine busy")),
            "Cycles a second, free-running; in brackets how often the loop sleeps in a cycle:",
            _rates(result),
            _limits(result),
            "Wake-ups after their deadline in µs, and cycles missed:",
            _deadlines(result),
            _LOADS,
            _loads(result),
            _clocks(result["clocks"]),
            _work(result),
        )
        if part
    )


def _missing(result: dict[str, Any]) -> str:
    parts = [
        f"{master} with {slaves(line['slaves'])} ({reason})"
        for line in result["lines"]
        for master, reason in line["missing"].items()
    ]
    return f"Not measured: {', '.join(parts)}." if parts else ""


def _exchange(result: dict[str, Any], loops: tuple[str, ...]) -> str:
    rows = []
    for line in result["lines"]:
        for case in line["exchange"]:
            cells: list[str] = []
            for name in loops:
                found = case["loops"].get(name)
                cells += [us(found["p50"]), us(found["p99"])] if found else ["–", "–"]
            kind = "busy" if "bare busy" in loops else "blocking"
            ratio = case["ratios"][kind]["exchange"]
            rows.append(
                (
                    f"{line['slaves']}, {pace(case['rate'])}",
                    *cells,
                    *(
                        "{:.2f} ({:.2f} to {:.2f})".format(ratio[q], *ratio[f"{q}_quartiles"])
                        for q in ("p50", "p99")
                    ),
                )
            )
    head = [cell for name in loops for cell in (f"{name.removesuffix(' busy')} p50", "p99")]
    return table(("slaves", *head, "engine / bare p50", "p99"), rows)


def _rates(result: dict[str, Any]) -> str:
    names = ("bare", "engine", "bare busy", "engine busy", "pysoem", "kickcat")
    rows = []
    for line in result["lines"]:
        for case in line["exchange"]:
            if case["rate"] == 0:
                loops = case["loops"]
                rows.append(
                    (
                        line["slaves"],
                        *(_rate(loops[n]) if n in loops else "–" for n in names),
                    )
                )
    return table(("slaves", *names), rows)


def _rate(loop: dict[str, Any]) -> str:
    return f"{loop['rate']:.0f} ({loop['sleeps']:.2f})"


def _limits(result: dict[str, Any]) -> str:
    """Why a rate is out of reach, where it is."""
    parts = []
    for line in result["lines"]:
        for case in line["exchange"]:
            loops, ratios = case["loops"], case["ratios"]["busy"]
            if "limit" in ratios and ratios["limit"] < RATE["busy"]:
                wanted = RATE["busy"] * loops["pysoem"]["rate"]
                parts.append(
                    f"with {slaves(line['slaves'])} {1e6 / wanted:.1f} µs for an exchange, where "
                    f"the bare loop that polls needs {us(loops['bare busy']['p50'])} µs"
                )
    if not parts:
        return ""
    return (
        f"{RATE['busy']:g} × pysoem is out of reach of any program on this machine: it would need "
        f"{'; '.join(parts)}. To sleep and to be woken costs little here: compare the bare loop "
        f"that sleeps with the one that polls."
    )


def _deadlines(result: dict[str, Any]) -> str:
    rows = []
    for line in result["lines"]:
        for case in line.get("deadlines", ()):
            for name, loop in case["loops"].items():
                rows.append(
                    (
                        f"{line['slaves']}, {pace(case['rate'])}, {name}",
                        *(us(loop[f"wakeup_p{q}"]) for q in ("50", "99", "99.9")),
                        loop["cycles"],
                        loop["missed_cycles"],
                        loop.get("lost_frames", "–"),
                    )
                )
    return table(("slaves", "p50", "p99", "p99.9", "cycles", "missed", "frames lost"), rows)


def _loads(result: dict[str, Any]) -> str:
    rows = []
    for load in result["loads"]:
        off, on = load["off"], load["on"]
        rows.append(
            (
                load["load"] + (", busy receive" if load["busy"] else ""),
                f"{load['rate']:.0f}" if load["rate"] else "–",
                *(f"{us(off[key])} / {us(on[key])}" for key in ("p50", "p99")),
                *(f"{off[key]} / {on[key]}" for key in ("cycles", "missed_cycles", "lost_frames")),
            )
        )
    head = ("load", "done a second", "p50 off / on", "p99", "cycles", "missed", "lost")
    return table(head, rows)


def _clocks(clocks: dict[str, Any]) -> str:
    p50, p99, p999 = (us(clocks[f"phase_p{q}"]) for q in ("50", "99", "99.9"))
    return (
        f"With distributed clocks, at 1 kHz for {clocks['seconds']:g} s, the cycle is off the "
        f"reference clock by {p50} µs (median), {p99} µs (99th percentile), {p999} µs (99.9th); "
        f"that clock runs {clocks['drift_ppb'] / 1000:.1f} ppm faster than this machine's. How far "
        f"the clocks of slaves are from it is what the simulator says, at one moment for all."
    )


def _work(result: dict[str, Any]) -> str:
    work = result["work"]
    if "points" not in work:
        return f"The engine's own work was not measured: {work['reason']}."
    rows = [
        (p["slaves"], p["bytes"], p["frames"], f"{p['instructions']:.0f}") for p in work["points"]
    ]
    fit = work["fit"]
    return "\n\n".join(
        (
            _WORK,
            table(("slaves", "bytes", "frames", "instructions a cycle"), rows),
            f"The straight line through them: {fit['cycle']:.0f} a cycle, {fit['slave']:.1f} more "
            f"for each slave and {fit['byte']:.2f} for each byte, in which the frames that the "
            f"bytes need have their share.",
        )
    )

"""Command `dc`: distributed clocks."""

from __future__ import annotations

import argparse
import datetime
from typing import Any

from ecatd.base.errors import EcatError
from ecatd.operations.statistics import Clocks, ReadClocks, SlaveClock
from ecatd.shm.statistics.clocks import read_clocks

from .output import print_json, print_table, shortened
from .source import Source

COMMANDS = {"health": {"dc": "Show the distributed clocks."}}

_NAME = 22  # longest name of a slave, so that the table fits into 80 columns
_GONE = {"": "", "absent": "absent", "missing": "no answer"}
_EPOCH = datetime.datetime(2000, 1, 1, tzinfo=datetime.UTC)


def dc(options: argparse.Namespace) -> None:
    """Shows the reference clock, whether the cycle follows it, and the clocks of all slaves."""
    with Source(options) as source:
        document = (
            read_clocks(options.bus) if source.local else source.remote().request(ReadClocks())
        )
    if options.json:
        print_json(document)
        return
    try:
        summary = _summary(document)
        rows = [_row(slave, document) for slave in document["slaves"]]
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise EcatError(
            f"this ecatctl does not understand the clocks of the daemon ({error!r}): run 'ecatctl "
            "info', and install the version of the daemon here"
        ) from error
    print("\n".join(summary))
    print()
    head = ("POS", "NAME", "CLOCK", "DELAY", "DIFFERENCE", "SYNC0", "SHIFT", "SYNC1")
    print_table(head, rows, "> >>>>>>")


def _summary(document: Clocks) -> list[str]:
    bus, slaves = document["bus"], document["slaves"]
    if document["state"] == "off":
        return [
            f"bus {bus}: distributed clocks are off; the cycle runs on this machine's clock",
            f"slaves with a clock: {sum(slave['dc_bits'] > 0 for slave in slaves)}",
        ]
    reference = slaves[document["reference"]]
    state, phase = document["state"], document["phase"]
    lines = [
        f"bus {bus}: {state}; the cycle of {document['cycle_time_us']:g} µs "
        f"{'follows' if state == 'locked' else 'does not follow'} the clock of slave "
        f"{reference['position']}",
        f"time   {_time(document['time_ns'])} UTC, on the reference clock",
        f"drift  {document['drift_ppb'] / 1000:+.1f} ppm, reference clock to this machine",
        f"phase  {document['offset']:+.1f} µs in the last cycle",
    ]
    if phase["count"]:
        lines[-1] += (
            f"; since the start p50 {phase['p50']:.1f}, p99 {phase['p99']:.1f}, "
            f"max {phase['max']:.1f} µs"
        )
    return lines


def _time(ns: int) -> str:
    """Formats a time of a clock in ns since 2000.

    A time below 2^33 ns is printed in seconds: a clock with 32 bits wraps around every 4.3 s, so
    its time is no date.
    """
    if ns < 1 << 33:
        return f"{ns / 1e9:.9f} s"
    seconds, rest = divmod(ns, 10**9)
    try:
        moment = _EPOCH + datetime.timedelta(seconds=seconds)
    except OverflowError:
        return f"{ns} ns"
    return f"{moment:%Y-%m-%d %H:%M:%S}.{rest:09d}"


def _row(slave: SlaveClock, document: Clocks) -> tuple[Any, ...]:
    gone = _GONE[slave["gone"]]
    on = document["state"] != "off" and slave["dc_bits"] and not gone
    difference = slave["dc_difference_ns"]
    if gone:
        text = gone
    elif slave["position"] == document["reference"]:
        text = "reference"
    elif difference is not None:
        text = f"{difference:+d} ns"
    else:
        text = "does not follow" if on else "-"
    signal = slave["sync0_ns"] > 0
    return (
        slave["position"],
        shortened(slave["name"] or "(no name)", _NAME),
        f"{slave['dc_bits']} bit" if slave["dc_bits"] else "-",
        f"{slave['dc_delay_ns']} ns" if on else "-",
        text,
        _us(slave["sync0_ns"]) if signal else "-",
        _us(slave["sync_shift_ns"]) if signal else "-",
        _us(slave["sync1_ns"]) if slave["sync1_ns"] else "-",
    )


def _us(ns: int) -> str:
    return f"{ns / 1000:g} µs"

"""Commands `stats` and `metrics`: counters and times of the cyclic exchange."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any

from ecatd.base.errors import EcatError, UsageError
from ecatd.operations.bus import Event, ReadEvents
from ecatd.operations.health import Health
from ecatd.shm.contract import TIMES
from ecatd.shm.statistics import Snapshot
from ecatd.shm.statistics.maps import histogram_to_map, interval_to_map, to_map
from ecatd.shm.statistics.problems import is_exchanged
from ecatd.view.worst import find_worst

from .arguments import add_watch
from .bus_warnings import check_cycle
from .output import print_json, print_json_line
from .source import Source
from .stats_screen import RECENT_S, histogram_lines, stats_lines, worst_lines
from .terminal import Screen
from .watch import check, clock, ticks

COMMANDS = {
    "health": {
        "metrics": "Print the statistics for Prometheus, in the OpenMetrics format.",
        "stats": "Show counters and timing of the cyclic exchange.",
    },
}


def add_arguments(command: argparse.ArgumentParser, name: str) -> None:
    """Adds the arguments of a command."""
    if name == "metrics":
        return
    add_watch(command)
    command.add_argument(
        "--histogram", choices=TIMES, metavar="NAME", help=f"show one time: {', '.join(TIMES)}"
    )


def stats(options: argparse.Namespace) -> int:
    """Shows statistics since the start, and with `--watch` of the last interval."""
    check(options)
    with Source(options) as source:
        if options.watch is None:
            snapshot = source.read()
            if options.json:
                print_json(_document(snapshot, options.histogram))
            else:
                print("\n".join(_lines(snapshot, None, options.histogram)))
                if options.histogram is None:
                    print("\n".join(["", *_worst(snapshot, source)]))
            return check_cycle(snapshot, source)
        elif options.json:
            for now, interval, _notice in _watch(source, options):
                print_json_line(_line(now, interval, options))
        else:
            screen = Screen()
            for now, interval, notice in _watch(source, options):
                screen.draw(_screen(now, interval, notice, options))
    return 0


def _worst(snapshot: Snapshot, source: Source) -> list[str]:
    """What stood beside the worst cycles; events only if the gateway answers."""
    now = time.time()
    events: Sequence[Event] = ()
    if is_exchanged(snapshot):  # else hardly anybody answers
        with suppress(EcatError):
            events = source.remote().request(ReadEvents())["events"]
    return worst_lines(
        find_worst(snapshot, events, now), find_worst(snapshot, events, now, RECENT_S)
    )


def _watch(
    source: Source, options: argparse.Namespace
) -> Iterator[tuple[Snapshot | EcatError, Snapshot | None, str]]:
    """Yields statistics at every interval of `--watch`.

    Yields:
        The statistics, or an error if there are none; the difference to the previous ones, or None
        at first, after a restart and with an error; and a notice about a restart, or an empty text.

    Raises:
        EcatError: There are no statistics at the first time.
    """
    now: Snapshot | EcatError = source.read()
    last: Snapshot | None = None
    notice = ""
    for turn, _ in enumerate(ticks(options.watch, options.count)):
        if turn > 0:
            now = _again(source)
        interval = None
        if isinstance(now, Snapshot):
            if last is not None and now.instance != last.instance:
                notice = f"{clock()}  the daemon was restarted: its counters begin at 0 again"
            elif last is not None:
                interval = now - last
            last = now
        yield now, interval, notice


def _again(source: Source) -> Snapshot | EcatError:
    try:
        return source.read()
    except EcatError as error:
        return error


def _document(snapshot: Snapshot, histogram: str | None) -> dict[str, Any]:
    if histogram is None:
        return to_map(snapshot)
    return {
        "bus": snapshot.bus,
        "histogram": histogram,
        "seconds": round(snapshot.seconds, 9),
        **histogram_to_map(snapshot.times[histogram], buckets=True),
    }


def _line(
    now: Snapshot | EcatError, interval: Snapshot | None, options: argparse.Namespace
) -> dict[str, Any]:
    """The JSON document of one time; `interval` is null at first and after a restart."""
    if isinstance(now, EcatError):
        return {"bus": options.bus, "error": now.to_reply()}
    last: dict[str, Any] | None = None
    if interval is not None:
        last = interval_to_map(interval)
        if options.histogram is not None:
            last = _document(interval, options.histogram)
    return {**_document(now, options.histogram), "interval": last}


def _lines(snapshot: Snapshot, interval: Snapshot | None, histogram: str | None) -> list[str]:
    if histogram is None:
        return stats_lines(snapshot, interval)
    return histogram_lines(histogram, snapshot, interval)


def _screen(
    now: Snapshot | EcatError, interval: Snapshot | None, notice: str, options: argparse.Namespace
) -> list[str]:
    notices = [notice] if notice else []
    if isinstance(now, EcatError):
        return [f"{clock()}  {now}", *notices, "Waiting for it to come back; Ctrl-C ends."]
    return [*_lines(now, interval, options.histogram), *notices]


def metrics(options: argparse.Namespace) -> None:
    """Prints the metrics; those of single slaves only if the gateway answers."""
    if options.json:
        raise UsageError(
            "metrics have a format of their own; `ecatctl stats --json` gives the statistics as "
            "JSON"
        )
    from ecatd.shm.statistics.open_metrics import write_metrics

    with Source(options) as source:
        snapshot = source.read()
        slaves: Health | EcatError
        try:
            slaves = source.remote().health()
        except EcatError as error:
            slaves = error
    print(write_metrics(snapshot, slaves), end="")

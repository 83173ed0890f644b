"""Command `events`: what has happened on the bus, and what happens now."""

from __future__ import annotations

import argparse
import re
import sys
import time
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

from ecatd.base.close_names import did_you_mean
from ecatd.description.bus import Bus
from ecatd.operations.bus import Events, ReadEvents
from ecatd.operations.events import PUBLISHED, SEVERITIES

from .arguments import add_slave
from .output import moment_text, print_json, print_json_line
from .terminal import check_stdout
from .watch import outlive

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

COMMANDS = {
    "diagnosis": {"events": "Show what has happened on the bus, or follow what happens now."}
}

_PAUSE = 0.5
"""Seconds between two requests for new events."""
_AGO = re.compile(r"(\d+)([smhd])")
_UNITS = {"s": 1, "m": 60, "h": 3600, "d": 86400}
_CLOCK = re.compile(r"(\d{1,2}):(\d{2})(?::(\d{2}))?")


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments of the command."""
    command.add_argument(
        "--since",
        type=_time,
        metavar="TIME",
        help="only events of the last 10m, 2h or 1d, or since a time of today such as 10:02 "
        "(default: all that the daemon keeps, at most 1000)",
    )
    command.add_argument(
        "-f", "--follow", action="store_true", help="keep showing new events until you press Ctrl-C"
    )
    command.add_argument(
        "--kind",
        action="append",
        type=_kind,
        metavar="KIND",
        help="only events of this kind, such as emergency; can be given several times",
    )
    command.add_argument(
        "--severity",
        choices=SEVERITIES,
        default=SEVERITIES[-1],
        help="only events that are at least this severe: error, warning, notice or info",
    )
    add_slave(command)


def _kind(text: str) -> str:
    """Checks that there are events of a kind: one that does not exist would filter all out."""
    if text not in PUBLISHED:
        hint = did_you_mean(text, PUBLISHED) or f"choose from {', '.join(sorted(PUBLISHED))}"
        raise argparse.ArgumentTypeError(f"there are no events of kind '{text}': {hint}")
    return text


def _time(text: str) -> float:
    """Converts a time of day, or how long ago it was, to Unix time."""
    now = time.time()
    if ago := _AGO.fullmatch(text):
        return now - int(ago[1]) * _UNITS[ago[2]]
    if clock := _CLOCK.fullmatch(text):
        hour, minute, second = (int(part or 0) for part in clock.groups())
        if hour < 24 and minute < 60 and second < 60:
            today = time.localtime(now)
            return time.mktime((*today[:3], hour, minute, second, 0, 0, -1))
    raise argparse.ArgumentTypeError(f"'{text}' is not a time such as 10m, 2h, 1d or 10:02")


def events(options: argparse.Namespace) -> None:
    """Prints the events that the daemon keeps; with `--follow`, new ones as they come."""
    if options.follow:
        check_stdout()
    outlive(options, _Follower(options).follow)


class _Follower:
    """Prints the events of a daemon, and of the next one after a restart."""

    def __init__(self, options: argparse.Namespace) -> None:
        self._options = options
        self._since: float | None = options.since
        self._instance: int | None = None  # the run of the daemon that has answered last
        self._next = 0  # number of its next event

    def follow(self, remote: Remote) -> Iterator[None]:
        """Prints events; yields after each answer."""
        bus = remote.describe()
        while True:
            answer = remote.request(ReadEvents(self._next))
            if self._instance not in (None, answer["instance"]):
                bus, answer = remote.describe(), remote.request(ReadEvents())
                text = f"ecatctl: the daemon of bus '{remote.bus}' has started again"
                print(text, file=sys.stderr, flush=True)
                self._since = None  # all of them are new, whatever the clock of the daemon says
            self._show(bus, answer)
            self._instance, self._next = answer["instance"], answer["next"]
            yield
            if not self._options.follow:
                return
            time.sleep(_PAUSE)

    def _show(self, bus: Bus, answer: Events) -> None:
        options = self._options
        chosen = None if options.slave is None else bus.find(options.slave).position
        found = list(_wanted(answer["events"], chosen, self._since, options))
        if options.json and not options.follow:
            print_json({"bus": bus.name, "events": found})
            return
        if self._instance is not None and answer["left_out"] and not options.json:
            print(
                f"{answer['left_out']} events are missing: the daemon keeps only the last ones",
                flush=True,
            )
        _print(bus, found, as_json=options.json)


def _wanted(
    found: Iterable[Any],
    chosen: int | None,
    since: float | None,
    options: argparse.Namespace,
) -> Iterator[dict[str, Any]]:
    severities = SEVERITIES[: SEVERITIES.index(options.severity) + 1]
    for event in found:
        of_slave = chosen is None or chosen in _concerned(event)
        of_kind = not options.kind or event["event"] in options.kind
        is_bad = event["severity"] in severities
        if of_slave and of_kind and is_bad and (since is None or event["time_ns"] >= since * 1e9):
            yield event


def _concerned(event: dict[str, Any]) -> set[int]:
    """Positions of the slaves that an event is about."""
    named = {*event.get("slaves", ()), *event.get("missing", ())}
    return named | {event["slave"]} if "slave" in event else named


def _print(bus: Bus, found: Iterable[dict[str, Any]], *, as_json: bool) -> None:
    for event in found:
        if as_json:
            print_json_line({"bus": bus.name, **event})
        else:
            print(_line(bus, event), flush=True)


def _line(bus: Bus, event: dict[str, Any]) -> str:
    position = event.get("slave", -1)
    label = bus.slaves[position].label if 0 <= position < len(bus.slaves) else ""
    text = str(event.get("text", ""))
    what = text if label in text else f"{label}: {text}" if text else label
    times = f"{event.get('times', 1)} times"
    if times != "1 times" and times not in text:
        what += f" ({times})"
    return f"{moment_text(event['time_ns'])}  {event['event']:<16}  {what}".rstrip()

"""Command `events`: what has happened on the bus, and what happens now."""

from __future__ import annotations

import argparse
import re
import sys
import time
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

from ecatd.model.bus import Bus
from ecatd.model.errors import NoAnswerError, UnreachableError

from .arguments import add_slave
from .output import print_json, print_json_line
from .terminal import check_stdout

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

_PAUSE, _RETRY = 0.5, 2.0
"""Seconds between two requests for new events, and for a daemon that is gone."""
_AGO = re.compile(r"(\d+)([smhd])")
_UNITS = {"s": 1, "m": 60, "h": 3600, "d": 86400}
_CLOCK = re.compile(r"(\d{1,2}):(\d{2})(?::(\d{2}))?")
_SAID = ("event", "sequence", "time_ns", "slave", "text")
"""Facts that have a place of their own in the line of an event."""
_IN_TEXT = {"emergency": ("code", "register")}
"""Facts that the text of an event says already."""


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments of the command."""
    command.set_defaults(alone=events)
    command.add_argument(
        "--since",
        type=_time,
        metavar="TIME",
        help="only events since this time: 10m, 2h, 1d, or a time of today as 10:02 (default: "
        "all that the daemon keeps, up to 1000)",
    )
    command.add_argument("-f", "--follow", action="store_true", help="go on with new events")
    add_slave(command)


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
    raise argparse.ArgumentTypeError(f"'{text}' is no time: write it as 10m, 2h, 1d or 10:02")


def events(options: argparse.Namespace) -> None:
    """Prints the events that the daemon keeps; with `--follow`, new ones as they come."""
    from ecatd.client.remote import Remote  # loading Zenoh is slow

    if options.follow:
        check_stdout()
    since, shown_since, first = 0, options.since, True
    while True:
        try:
            with Remote(options.bus, options.connect, options.timeout) as remote:
                for answered in _follow(remote, options, since, shown_since):
                    since, first = answered, False
            return
        except (UnreachableError, NoAnswerError) as error:
            if first or not options.follow:
                raise
            print(f"ecatctl: {error}; waiting for it to come back", file=sys.stderr)
            time.sleep(_RETRY)
        shown_since = None


def _follow(
    remote: Remote, options: argparse.Namespace, since: int, shown_since: float | None
) -> Iterator[int]:
    """Prints events; yields the number of the next one after each answer.

    Args:
        remote: The daemon.
        options: The options.
        since: Number of the first event to ask for.
        shown_since: Unix time before which events are not shown.
    """
    bus = remote.describe()
    chosen = None if options.slave is None else bus.find(options.slave).position
    while True:
        answer = remote.events(since)
        found = list(_wanted(answer["events"], chosen, shown_since))
        if options.json and not options.follow:
            print_json({"bus": bus.name, "events": found})
        else:
            if since and answer["left_out"] and not options.json:
                print(
                    f"{answer['left_out']} events are missing: the daemon keeps only the last ones",
                    flush=True,
                )
            _print(bus, found, as_json=options.json)
        since = answer["next"]
        yield since
        if not options.follow:
            return
        time.sleep(_PAUSE)


def _wanted(
    found: Iterable[dict[str, Any]], chosen: int | None, since: float | None
) -> Iterator[dict[str, Any]]:
    for event in found:
        of_slave = chosen is None or event.get("slave") == chosen
        if of_slave and (since is None or event["time_ns"] >= since * 1e9):
            yield event


def _print(bus: Bus, found: Iterable[dict[str, Any]], *, as_json: bool) -> None:
    for event in found:
        if as_json:
            print_json_line({"bus": bus.name, **event})
        else:
            print(_line(bus, event), flush=True)


def _line(bus: Bus, event: dict[str, Any]) -> str:
    seconds, ns = divmod(event["time_ns"], 10**9)
    when = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(seconds))
    position = event.get("slave", -1)
    label = bus.slaves[position].label if 0 <= position < len(bus.slaves) else ""
    facts = [str(event["text"])] if event.get("text") else []
    said = _SAID + _IN_TEXT.get(event["event"], ())
    facts += [
        f"{name} {_shown(value)}"
        for name, value in event.items()
        if name not in said and value not in ("", None)
    ]
    what = f"{label}: {', '.join(facts)}" if label and facts else label or ", ".join(facts)
    return f"{when}.{ns // 10**6:03}  {event['event']:<16}  {what}".rstrip()


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.3g}"
    if isinstance(value, list | tuple):
        return " ".join(_shown(item) for item in value) or "none"
    if isinstance(value, dict):
        return " ".join(f"{name}={_shown(item)}" for name, item in value.items()) or "none"
    return str(value)

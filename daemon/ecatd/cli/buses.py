"""Command `buses`: all buses of this machine, or all that a Zenoh endpoint reaches."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Mapping
from typing import Any

from ecatd.base.errors import JOIN, EcatError, NoAnswerError, NotPermittedError, StateError
from ecatd.base.paths import closed_buses, search_dirs, served_buses
from ecatd.operations.bus import ReadInfo, ReadStates
from ecatd.operations.health import look_at

from .arguments import connect
from .output import print_json, print_table

COMMANDS = {"bus": {"buses": "List the buses of this machine, or all that --connect reaches."}}


def buses(options: argparse.Namespace) -> None:
    """Lists buses: of this machine, or with `--connect` those that are reached there."""
    rows = list(_there(options) if options.connect else _here(options))
    if options.json:
        print_json({"buses": rows})
    elif rows:
        head = ("BUS", "HOST", "INTERFACE", "CYCLE", "SINCE", "SLAVES")
        print_table(head, map(_cells, rows))
    elif options.connect:
        print(f"no bus answers at {options.connect}, or none of them lets this user in")
    else:
        print(
            "no bus is running on this machine; --connect ENDPOINT lists the buses of another "
            "machine"
        )


def _here(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """The buses of this machine, also those that do not answer."""
    from ecatd.client.remote import Remote  # loading Zenoh is slow
    from ecatd.client.why_no_daemon import has_shared_memory

    names = {bus: None for folder in search_dirs() for bus in served_buses(folder)}
    for bus in names:
        try:
            with Remote(bus, timeout=options.timeout) as remote:
                yield _row(bus, remote.request(ReadInfo()), remote.request(ReadStates()))
        except EcatError as error:
            yield {"bus": bus, "error": error.to_reply()}
    closed = {bus for folder in search_dirs() for bus in closed_buses(folder)}
    for bus in sorted(filter(has_shared_memory, closed)):
        denied = NotPermittedError(f"no right to use bus '{bus}': {JOIN}")
        yield {"bus": bus, "error": denied.to_reply()}


def _there(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """The buses at an endpoint, of one gateway or of all behind a router, also silent ones."""
    with connect(options) as remote:
        alive = remote.alive()
        infos, states = remote.ask_all("info", "state")
    for bus in sorted({*alive, *infos}):
        if bus in infos and bus in states:
            yield _row(bus, infos[bus], states[bus])
        else:
            silent = NoAnswerError("no answer: its bus server is busy, or hangs")
            yield {"bus": bus, "error": silent.to_reply()}


def _row(bus: str, info: Mapping[str, Any], states: Mapping[str, Any]) -> dict[str, Any]:
    """What is said of a bus; one whose answers make no sense does not hide the others."""
    try:
        health = look_at(states)
        row = {
            "bus": bus,
            **{key: info.get(key) for key in ("host", "interface", "cycle_time_us", "started")},
            "version": info.get("version"),
            "slaves": health.expected,
            "in_op": health.in_op,
            "problems": health.problems,
        }
        _cells(row)
    except (AttributeError, LookupError, OSError, OverflowError, TypeError, ValueError) as error:
        malformed = StateError(
            f"its answer makes no sense ({error!r:.60}): perhaps another version of ecatd serves it"
        )
        return {"bus": bus, "error": malformed.to_reply()}
    return row


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    if "error" in row:
        return row["bus"], "", "", "", "", row["error"]["message"]
    since = time.strftime("%Y-%m-%d %H:%M", time.localtime(row["started"]))
    return (
        row["bus"],
        row["host"] or "",
        row["interface"],
        f"{row['cycle_time_us']:g} µs",
        since,
        f"{row['in_op']} of {row['slaves']} in OP",
    )

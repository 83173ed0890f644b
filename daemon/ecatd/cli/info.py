"""Command `info`: the daemon, its bus, and the real-time settings that the system has granted."""

from __future__ import annotations

import argparse
import os
import textwrap
from collections.abc import Mapping
from typing import Any

from ecatd.base.errors import NoAnswerError, UnreachableError
from ecatd.description.bus import positions_text
from ecatd.etg.al import AlState, al_state_text
from ecatd.operations.bus import ReadInfo
from ecatd.operations.faults import RECORDER
from ecatd.shm import contract as shm
from ecatd.shm.real_time import SETTINGS
from ecatd.shm.statistics import Grant, Snapshot, to_map
from ecatd.shm.statistics.problems import ring_text, word

from .bus_warnings import check_cycle
from .output import date_text, print_json, table_lines
from .source import Source
from .stats_screen import clock_text, duration

COMMANDS = {
    "health": {
        "info": "Show the daemon, its bus, and the real-time settings that the system has granted."
    }
}

# AL states that are no bitwise OR of others: BOOT (3) is INIT (1) | PREOP (2).
_SINGLE = (AlState.INIT, AlState.PREOP, AlState.SAFEOP, AlState.OP)


def info(options: argparse.Namespace) -> int:
    """Shows the daemon, the state of its bus, and the real-time settings."""
    with Source(options) as source:
        snapshot = source.read()
        running: Mapping[str, Any] = {}
        silent = ""
        unused: list[str] = []
        try:
            running = source.remote().request(ReadInfo())
            faults = source.remote().health().faults
            unused = [fault.text for fault in faults if fault.kind == RECORDER]
        except (UnreachableError, NoAnswerError) as error:
            if not source.local:
                raise
            silent = str(error)
        if options.json:
            print_json({**_document(snapshot, running, silent), "unused_conditions": unused})
        else:
            lines = info_lines(snapshot, running, silent)
            lines += [f"{'recorder':<12}{text}" for text in unused]
            lines += ["", *real_time_lines(snapshot)]
            print("\n".join(lines))
        return check_cycle(snapshot, source)


def _document(snapshot: Snapshot, running: Mapping[str, Any], silent: str) -> dict[str, Any]:
    known = to_map(snapshot)
    kept = ("bus", "version", "state", "cycle_time_us", "slaves", "ring", "links", "dc", "domains")
    document = {key: known[key] for key in kept}
    document["started"] = snapshot.instance * 1e-9
    document["interface"] = None  # only the gateway knows the name of the interface
    document["links"] = dict(_links(snapshot, running))
    document["settings"] = [
        {
            **row,
            "effect": _effect(grant),
            "how": SETTINGS[grant.setting].how if _refused(grant) else "",
        }
        for row, grant in zip(known["realtime"]["settings"], snapshot.grants, strict=True)
    ]
    document["gateway"] = {"error": silent} if silent else {"error": None}
    # Links and ring come from shared memory, see above.
    later = {key: running[key] for key in running.keys() - {"schema", "links", "ring"}}
    return {**document, **later}


def info_lines(snapshot: Snapshot, running: Mapping[str, Any], silent: str) -> list[str]:
    """Lines about the daemon and its bus.

    Args:
        snapshot: Statistics of the bus.
        running: Answer of the gateway; empty without one.
        silent: Why the gateway has not answered; empty if it has.
    """
    unnamed = " (its name is unknown without an answer)" if silent else ""
    rows = [
        ("bus", f"{snapshot.bus}, {word(snapshot.state)}"),
        *(("interface", f"{name}, {state}{unnamed}") for name, state in _links(snapshot, running)),
        ("cycle time", f"{snapshot.cycle_time_ns / 1000:g} µs"),
    ]
    if {"wire_us", "wire_frames", "wire_bytes"} <= running.keys():
        frames = f"{running['wire_frames']} frame{'s' * (running['wire_frames'] != 1)}"
        size = f"{running['wire_bytes']} bytes, {frames}"
        rows.append(("wire time", f"{running['wire_us']} µs in the longest cycle: {size}"))
    elif silent:
        rows.append(("wire time", "unknown without an answer"))
    if running.get("frames_s"):
        rows.append(("last frames", f"those of about {running['frames_s']:g} s"))
    rows += [
        ("slaves", _slaves(snapshot)),
        ("ring", ring_text(snapshot)),
        ("DC", clock_text(snapshot)),
        ("started", f"{date_text(snapshot.instance * 1e-9)}, {duration(snapshot.seconds)} ago"),
        ("version", snapshot.version),
    ]
    rows += [("recovery", text) for text in _recovery(running)]
    if silent:
        rows.append(("no answer", f"{silent}; the values here are from shared memory"))
    if snapshot.silence:
        rows.append(("NO CYCLE", f"for {snapshot.silence:.1f} s: the exchange stands still"))
    return [f"{name:<12}{value}" for name, value in rows]


def _slaves(snapshot: Snapshot) -> str:
    """Number of slaves, and their AL state if the bitwise OR of all states is a single one."""
    text = f"{snapshot.slaves_found} found, {snapshot.slaves_expected} expected"
    if not snapshot.slaves_found:
        return text
    state = snapshot.al_status & 0x0F
    who = "all" if snapshot.slaves_found == snapshot.slaves_expected else "these"
    text += f", {who} in {al_state_text(state)}" if state in _SINGLE else ", in different AL states"
    return text + (", with errors (see ecatctl state)" if snapshot.al_status & 0x10 else "")


def _recovery(running: Mapping[str, Any]) -> list[str]:
    """Lines about slaves that should be in OP and are not. Those in the same state share a line."""
    alike: dict[str, list[int]] = {}
    for row in running.get("recovery", []):
        alike.setdefault(row["state"], []).append(row["slave"])
    return [
        f"slave{'s' * (len(positions) > 1)} {positions_text(positions)}: {state}"
        for state, positions in alike.items()
    ]


def _links(snapshot: Snapshot, running: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Name and state of each interface; without the gateway the names are unknown."""
    used = [link for link in snapshot.links if link != shm.Link.UNUSED]
    known = running.get("links")
    names = [str(name) for name in known] if isinstance(known, dict) else []
    if len(names) != len(used):
        names = ["first", "second"]
    return [(name, word(link)) for name, link in zip(names, used, strict=False)]


def _refused(grant: Grant) -> bool:
    return grant.wanted and not grant.granted


def _effect(grant: Grant) -> str:
    texts = SETTINGS[grant.setting]
    return texts.with_it if grant.granted else texts.without


def real_time_lines(snapshot: Snapshot) -> list[str]:
    """Table of the real-time settings, and how to get those that were refused."""
    refused = [grant for grant in snapshot.grants if _refused(grant)]
    rows = []
    for grant in snapshot.grants:
        texts = SETTINGS[grant.setting]
        wanted = texts.value.format(grant.value) if grant.wanted else "no"
        granted = "yes" if grant.granted else "REFUSED" if grant.wanted else "-"
        rows.append((texts.title, wanted, granted, _effect(grant)))
    lines = table_lines(("REAL TIME", "WANTED", "GRANTED", "WHAT THAT MEANS"), rows)
    for grant in refused:
        texts = SETTINGS[grant.setting]
        why = os.strerror(grant.error) if grant.error else "not in force"
        lines += [
            "",
            *textwrap.wrap(
                f"{texts.title} was refused ({why}): {texts.how}.",
                79,
                subsequent_indent="  ",
                break_on_hyphens=False,
            ),
        ]
    return lines

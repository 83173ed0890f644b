"""Command `check`: says in one line whether the bus is well, for monitoring systems.

The exit statuses are those of monitoring plug-ins: 0 well, 1 degraded, 2 down.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any

from ecatd import shm
from ecatd.model.al import AlState
from ecatd.model.bus import display_name
from ecatd.model.errors import EcatError, NoAnswerError, UnreachableError
from ecatd.stats import Snapshot

from .output import print_json
from .source import Source
from .stats_screen import ring_line, word

WORDS = ("well", "degraded", "down")
_WELL, _DEGRADED, _DOWN = range(3)
_SHOWN = 3
_ABSENT = "absent"


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Sets the function of the command; it has no arguments of its own."""
    command.set_defaults(alone=check)


def check(options: argparse.Namespace) -> int:
    """Prints whether the bus is well; returns 0 well, 1 degraded, 2 down."""
    with Source(options) as source:
        try:
            status, problems, counts = _look(source)
        except EcatError as error:
            status, problems, counts = _DOWN, [str(error)], {}
    if options.json:
        document = {"bus": options.bus, "status": WORDS[status], "problems": problems, **counts}
        print_json(document)
    else:
        print(f"{WORDS[status]}: {_line(options.bus, problems, counts)}")
    return status


def _line(bus: str, problems: list[str], counts: dict[str, int]) -> str:
    facts = []
    if counts:
        absent = f" ({counts['absent']} optional absent)" if counts["absent"] else ""
        facts.append(f"{counts['in_op']} of {counts['slaves']} slaves in OP{absent}")
    more = len(problems) - _SHOWN
    facts += problems[:_SHOWN] + ([f"and {more} more (--json lists all)"] if more > 0 else [])
    return f"bus {bus}, {'; '.join(facts)}"


def _look(source: Source) -> tuple[int, list[str], dict[str, int]]:
    """Status, problems, and numbers of slaves.

    Raises:
        EcatError: The bus cannot be seen at all.
    """
    snapshot = source.read()
    if snapshot.state != shm.BusState.RUNNING:
        return _DOWN, [f"the daemon is {word(snapshot.state)}"], {}
    if snapshot.silence:
        return _DOWN, [f"no cycle for {snapshot.silence:.1f} s: the exchange stands still"], {}
    problems = list(_wire_problems(snapshot))
    counts: dict[str, int] = {}
    try:
        rows = source.remote().states()
    except (UnreachableError, NoAnswerError) as error:
        problems += _seen_from_here(snapshot)
        problems.append(f"the gateway does not answer: {error}")
        return _DEGRADED, problems, counts
    expected = [row for row in rows if row.get("recovery") != _ABSENT]
    in_op = [row for row in expected if row["al_state"] == AlState.OP]
    counts = {
        "slaves": len(expected),
        "in_op": len(in_op),
        "absent": len(rows) - len(expected),
    }
    problems += [_told(row) for row in expected if row not in in_op or row.get("recovery")]
    if expected and not in_op:
        return _DOWN, problems, counts
    return (_DEGRADED if problems else _WELL), problems, counts


def _wire_problems(snapshot: Snapshot) -> Iterator[str]:
    names = ("the interface", "the second interface")
    for name, link in zip(names, snapshot.links, strict=True):
        if link not in (shm.Link.UNUSED, shm.Link.UP):
            yield (
                f"{name} has {word(link)}"
                if link == shm.Link.NO_CARRIER
                else (f"{name} is {word(link)}")
            )
    if snapshot.ring == shm.Ring.OPEN:
        yield ring_line(snapshot)
    if snapshot.clock.state == shm.DcState.LOCKING:
        yield "the cycle is not in step with the reference clock"


def _seen_from_here(snapshot: Snapshot) -> Iterator[str]:
    """What the shared memory says of the slaves, where nobody can be asked for each of them."""
    if snapshot.slaves_found < snapshot.slaves_expected:
        yield f"{snapshot.slaves_found} of {snapshot.slaves_expected} slaves answer"
    if snapshot.slaves_found and snapshot.al_status != AlState.OP:
        yield "slaves are not in OP"


def _told(row: dict[str, Any]) -> str:
    """A slave that is not well, and what is known about its recovery."""
    name = display_name(row.get("given_name", ""), row["name"])
    known = (row["text"], row.get("recovery"), row.get("recovery_text"))
    return f"slave {row['position']} ({name}): {', '.join(text for text in known if text)}"

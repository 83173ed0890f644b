"""Command `check`: says in one line whether the bus is well, for monitoring systems.

The exit statuses are those of monitoring plug-ins: 0 well, 1 degraded, 2 down, 3 unknown, because
the user may not look.
"""

from __future__ import annotations

import argparse

from ecatd.base.errors import EcatError, NoAnswerError, NotPermittedError, UnreachableError
from ecatd.operations.health import Health
from ecatd.shm.statistics.problems import find_problems, is_exchanged

from .output import first_of, print_json
from .source import Source

COMMANDS = {"health": {"check": "Say in one line whether the bus is well, for monitoring systems."}}

WORDS = ("well", "degraded", "down", "denied")
_WELL, _DEGRADED, _DOWN, _DENIED = range(4)
_SHOWN = 3


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the statuses to the help; the command has no arguments of its own."""
    command.epilog = (
        "exit status (that of monitoring plug-ins): 0 well, 1 degraded, 2 down, 3 no right to look"
    )


def check(options: argparse.Namespace) -> int:
    """Prints whether the bus is well; returns the exit status."""
    with Source(options) as source:
        try:
            status, problems, slaves = _look(source)
        except EcatError as error:
            status = _DENIED if isinstance(error, NotPermittedError) else _DOWN
            problems, slaves = [str(error)], None
    if options.json:
        counts = (
            {"slaves": slaves.expected, "in_op": slaves.in_op, "absent": slaves.absent}
            if slaves
            else {}
        )
        document = {"bus": options.bus, "status": WORDS[status], "problems": problems, **counts}
        print_json(document)
    else:
        print(f"{WORDS[status]}: {_line(options.bus, problems, slaves)}")
    return status


def _line(bus: str, problems: list[str], slaves: Health | None) -> str:
    facts = [slaves.counts] if slaves else []
    facts += first_of(problems, _SHOWN, " (--json lists all)")
    line = "; ".join(facts)
    return line if f"bus '{bus}'" in line else f"bus {bus}, {line}"


def _look(source: Source) -> tuple[int, list[str], Health | None]:
    """Status, problems, and how the slaves are.

    Raises:
        EcatError: The bus cannot be seen at all.
    """
    snapshot = source.read()
    if not is_exchanged(snapshot):
        return _DOWN, find_problems(snapshot), None
    try:
        slaves = source.remote().health()
    except (UnreachableError, NoAnswerError) as error:
        return _DEGRADED, find_problems(snapshot, error), None
    problems = find_problems(snapshot, slaves)
    if slaves.is_down:
        return _DOWN, problems, slaves
    return (_DEGRADED if problems else _WELL), problems, slaves

"""Finds the commands of `ecatctl`: each screen says in `COMMANDS` which ones it has.

A command must start fast, and importing all screens takes longer than most commands run. So this
reads the tables in their source texts, and only the screen of the given command is imported.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import NamedTuple

GROUPS = (
    *("bus", "values", "health", "objects", "diagnosis", "mailboxes", "slaves"),
    *("daemon", "documents", "machine"),
)
"""What commands are about, in the order of the help."""

_MARK, _END = b"\nCOMMANDS = ", b"\n\n"
"""What stands before and behind such a table."""
_HEAD = 4096
"""Bytes of a file in which it stands."""


class Command(NamedTuple):
    """A command.

    Attributes:
        group: One of `GROUPS`.
        summary: What it does, for the help.
        aliases: Its other names.
        has_bus: Whether it takes the options that choose a bus.
    """

    group: str
    summary: str
    aliases: tuple[str, ...] = ()
    has_bus: bool = True


class Found(NamedTuple):
    """A command, and where it is.

    Attributes:
        name: Its name.
        module: Name of the module of its screen.
        command: What its screen says of it.
    """

    name: str
    module: str
    command: Command


def find_commands() -> list[Found]:
    """All commands, in the order of the help: by group, screen, and place in its table."""
    return sorted(_found(), key=lambda found: (GROUPS.index(found.command.group), found.module))


def _found() -> Iterator[Found]:
    folder = os.path.dirname(__file__)  # noqa: PTH120  loading pathlib takes as long as all of this
    for file in os.listdir(folder):  # noqa: PTH208
        module, end = os.path.splitext(file)  # noqa: PTH122
        if end == ".py":
            with open(os.path.join(folder, file), "rb") as source:  # noqa: PTH118, PTH123
                _, mark, table = source.read(_HEAD).partition(_MARK)
            commands = eval(table.partition(_END)[0], {"Command": Command}) if mark else {}
            for name, command in commands.items():
                yield Found(name, module, command)

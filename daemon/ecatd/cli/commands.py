"""Finds the commands of `ecatctl`: each screen says in `COMMANDS` which ones it has, by group.

A function of the screen carries a command out, and has its name, with _ for -. It gets the session
with the daemon and the options, or only these if it connects to the bus itself, or needs none; it
may return the exit status. If commands have arguments, `add_arguments(parser, name)` adds them.

A command must start fast, and importing all screens takes longer than most commands run. So this
reads the tables in their source texts, and only the screen of the given command is imported.
"""

from __future__ import annotations

import os
from ast import literal_eval
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
    """A command."""

    name: str  #: Its name.
    group: str  #: One of `GROUPS`.
    summary: str  #: What it does, for the help.
    module: str  #: Name of the module of its screen.


def find_commands() -> list[Command]:
    """All commands, in the order of the help: by group, screen, and place in its table."""
    return sorted(_found(), key=lambda found: (GROUPS.index(found.group), found.module))


def _found() -> Iterator[Command]:
    folder = os.path.dirname(__file__)  # noqa: PTH120  loading pathlib takes as long as all of this
    for file in os.listdir(folder):  # noqa: PTH208
        module, end = os.path.splitext(file)  # noqa: PTH122
        if end == ".py":
            with open(os.path.join(folder, file), "rb") as source:  # noqa: PTH118, PTH123
                _, mark, table = source.read(_HEAD).partition(_MARK)
            groups = literal_eval(table.partition(_END)[0].decode()) if mark else {}
            for group, commands in groups.items():
                for name, summary in commands.items():
                    yield Command(name, group, summary, module)

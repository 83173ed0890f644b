"""Command `log`: new lines of the log of a daemon, also of another machine."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from .output import moment_text, print_json_line
from .terminal import check_stdout
from .watch import outlive

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

COMMANDS = {"daemon": {"log": "Show new lines of the daemon's log as they come."}}

_EPILOG = """\
Lines of levels below notice, values that were written into objects, and older lines are only in the
journal of the machine: journalctl -u 'ecatd*'.
"""


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments of the command."""
    command.epilog = _EPILOG


def log(options: argparse.Namespace) -> None:
    """Prints lines of the log as they come, also those of the next daemon after a restart."""
    check_stdout()

    def follow(remote: Remote) -> Iterator[None]:
        lines = remote.log_lines()
        remote.stats()  # its gateway answers, so the command goes on when it is away
        yield
        for line in lines:
            if options.json:
                print_json_line({"bus": remote.bus, **line})
            else:
                print(_text(line), flush=True)
            yield

    outlive(options, follow)


def _text(line: dict[str, Any]) -> str:
    when = moment_text(line["time_ns"])
    return f"{when}  {line['level']:<7}  {line['part']:<10}  {line['text']}"

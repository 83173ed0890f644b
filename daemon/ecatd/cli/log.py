"""Command `log`: new lines of the log of a daemon, also of another machine."""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING, Any

from .output import print_json_line
from .terminal import check_stdout

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

_EPILOG = """\
Lines of levels below notice, values that were written into objects, and older lines are only in the
journal of the machine: journalctl -u 'ecatd*'.
"""


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments of the command."""
    command.epilog = _EPILOG
    command.set_defaults(run=log)


def log(remote: Remote, options: argparse.Namespace) -> None:
    """Prints lines of the log as they come, until the daemon ends."""
    check_stdout()
    for line in remote.log_lines():
        if options.json:
            print_json_line({"bus": remote.bus, **line})
        else:
            print(_text(line), flush=True)


def _text(line: dict[str, Any]) -> str:
    seconds, ns = divmod(line["time_ns"], 10**9)
    when = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(seconds))
    return f"{when}.{ns // 10**6:03}  {line['level']:<7}  {line['part']:<10}  {line['text']}"

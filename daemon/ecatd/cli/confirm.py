"""The question before a dangerous command."""

from __future__ import annotations

import argparse
import sys

from ecatd.base.errors import UsageError

_YES = ("y", "yes")


def add_yes(command: argparse.ArgumentParser) -> None:
    """Adds the option `--yes`, for scripts."""
    command.add_argument("--yes", action="store_true", help="do it without asking")


def confirm(options: argparse.Namespace, about: str) -> None:
    """Asks on a terminal whether to go on; without a terminal, `--yes` must be given.

    Args:
        options: Parsed arguments of a command with `add_yes`.
        about: What the command is about to do, and to which slave: a sentence.

    Raises:
        UsageError: The user does not want it, or cannot be asked.
    """
    if options.yes:
        return
    can_be_asked = sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty()
    if not can_be_asked:
        raise UsageError(f"{about} Nothing was done, because nobody can be asked: add --yes.")
    print(f"{about} Continue? [y/N] ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in _YES:
        raise UsageError("nothing was done")

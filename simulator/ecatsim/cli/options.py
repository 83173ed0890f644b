"""Command line parsers that all commands share."""

from __future__ import annotations

import argparse
from typing import NoReturn, TypeAlias

from ecatd.base.errors import UsageError
from ecatd.base.lazy_command import CommandLine, LazyCommand


class Parser(CommandLine):
    """A parser that reports wrong arguments in one line, like all other errors."""

    def error(self, message: str) -> NoReturn:
        """Raises `UsageError`."""
        says_more = message.endswith("?") or "--help`" in message
        raise UsageError(message if says_more else f"{message}; see `{self.prog} --help`")


class Command(LazyCommand, Parser):
    """A command of `ecatsim`."""


Commands: TypeAlias = "argparse._SubParsersAction[Parser]"
"""The type of the object to which commands are added."""

"""Command line parsing that all commands share."""

from __future__ import annotations

import argparse
from typing import NoReturn, TypeAlias

from ecatd.lazy_command import LazyCommand
from ecatd.model.errors import UsageError


class Parser(argparse.ArgumentParser):
    """Reports wrong arguments as every other error, in one line."""

    def error(self, message: str) -> NoReturn:
        """Raises `UsageError`."""
        raise UsageError(f"{message}; see `{self.prog} --help`")


class Command(LazyCommand, Parser):
    """A command of `ecatsim`."""


Commands: TypeAlias = "argparse._SubParsersAction[Parser]"
"""Where commands are added."""

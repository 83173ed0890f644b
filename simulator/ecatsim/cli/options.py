"""Command line parsing that all commands share."""

from __future__ import annotations

import argparse
from typing import NoReturn, TypeAlias

from ecatd.model.errors import UsageError


class Parser(argparse.ArgumentParser):
    """Reports wrong arguments as every other error, in one line."""

    def error(self, message: str) -> NoReturn:
        """Raises `UsageError`."""
        raise UsageError(f"{message}; see `{self.prog} --help`")


Commands: TypeAlias = "argparse._SubParsersAction[Parser]"
"""Where commands are added. Each sets `execute`: from its options to the exit status."""

"""Command line parsing that all commands share."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from importlib import import_module
from typing import Any, NoReturn, TypeAlias

from ecatd.model.errors import UsageError


class Parser(argparse.ArgumentParser):
    """Reports wrong arguments as every other error, in one line."""

    def error(self, message: str) -> NoReturn:
        """Raises `UsageError`."""
        raise UsageError(f"{message}; see `{self.prog} --help`")


class Command(Parser):
    """A command; its module is loaded, and declares its arguments, when it is asked for."""

    def __init__(self, *, command: str, module: str, **settings: Any) -> None:
        super().__init__(**settings)
        self._command = command
        self._module = module

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> tuple[Any, list[str]]:
        """Loads the module; then as usual."""
        import_module(f".{self._module}", __package__).add_arguments(self, self._command)
        return super().parse_known_args(args, namespace)


Commands: TypeAlias = "argparse._SubParsersAction[Parser]"
"""Where commands are added."""

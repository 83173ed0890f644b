"""Commands of `ecatctl` and `ecatsim` whose modules are loaded only when they are used."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from importlib import import_module
from typing import Any


class LazyCommand(argparse.ArgumentParser):
    """The parser of a command. Its module declares the arguments when the command is parsed.

    Args:
        command: Name of the command.
        module: Full name of its module, which has `add_arguments(parser, command)`.
        settings: As for `argparse.ArgumentParser`.
    """

    def __init__(self, *, command: str, module: str, **settings: Any) -> None:
        super().__init__(**settings)
        self._command = command
        self._module = module

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> tuple[Any, list[str]]:
        """Loads the module, which declares the arguments, and parses them."""
        import_module(self._module).add_arguments(self, self._command)
        return super().parse_known_args(args, namespace)

"""Commands of `ecatctl` and `ecatsim` whose modules are loaded only when they are used."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Any

from .close_names import did_you_mean
from .errors import StateError
from .sanitized_output import write_no_more


class CommandLine(argparse.ArgumentParser):
    """A parser whose message about a wrong choice suggests the right one.

    A help text that cannot be written ends the program without a traceback.
    """

    def _print_message(self, message: str, file: Any = None) -> None:
        stream = file or sys.stderr
        try:
            super()._print_message(message, file)
            stream.flush()
        except OSError as error:
            write_no_more(stream)
            if stream is sys.stderr:
                return  # the exit status says that the arguments are wrong
            if isinstance(error, BrokenPipeError):  # its reader has seen enough
                self.exit(0)
            why = f"{self.prog}: the output cannot be written: {error.strerror}\n"
            self.exit(StateError.exit_code, why)

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Checks a value with choices.

        Raises:
            argparse.ArgumentError: It is none of them.
        """
        if action.choices is None or value in action.choices:
            return
        known = [str(choice) for choice in action.choices]
        if isinstance(action, argparse._SubParsersAction):  # without "argument COMMAND:" before it
            listed = f"`{self.prog} --help` lists all commands"
            hint = did_you_mean(str(value), known) or listed
            raise argparse.ArgumentError(None, f"there is no command '{value}': {hint}")
        hint = did_you_mean(str(value), known) or f"choose from {', '.join(known)}"
        raise argparse.ArgumentError(action, f"'{value}' is not a valid choice: {hint}")


class LazyCommand(CommandLine):
    """The parser of a command. Its module declares the arguments when the command is parsed.

    Args:
        command: Name of the command.
        module: Full name of its module, which has `add_arguments(parser, command)`.
        settings: Further arguments for `argparse.ArgumentParser`.
    """

    def __init__(self, *, command: str, module: str, **settings: Any) -> None:
        super().__init__(**settings)
        # As in Python 3.14: before, argparse takes -0x10, -1e3 and -1,2 for options.
        self._negative_number_matcher = re.compile(r"-\.?\d")
        self._command = command
        self._module = module
        self._is_declared = False
        self._is_parsing = False

    def declare(self) -> None:
        """Loads the module and has it declare the arguments, unless that was done before."""
        if not self._is_declared:
            self._is_declared = True
            import_module(self._module).add_arguments(self, self._command)

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> tuple[Any, list[str]]:
        """Parses the arguments, after they have been declared.

        argparse does not find an optional argument, such as the FILE of `config check --json FILE`,
        if an option is in front of it. So this parses the options first, and then the rest.
        """
        self.declare()
        optional = any(
            not item.option_strings and item.nargs in ("?", "*") for item in self._actions
        )
        if not optional or self._is_parsing:
            return super().parse_known_args(args, namespace)
        self._is_parsing = True
        try:
            return self.parse_known_intermixed_args(args, namespace)
        finally:
            self._is_parsing = False

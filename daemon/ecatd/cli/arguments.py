"""What arguments of several commands have in common: their types, the bus, a question before harm.

The converters raise `argparse.ArgumentTypeError`.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING

from ecatd.base.errors import UsageError

if TYPE_CHECKING:
    from ecatd.client.remote import Remote


_YES = ("y", "yes")


def number(text: str) -> int:
    """Converts a number, decimal or such as 0x0A."""
    try:
        return int(text, 0)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not a number such as 10 or 0x0A") from None


def bounded(low: int, high: int) -> Callable[[str], int]:
    """Returns a converter for numbers from `low` to `high`."""

    def convert(text: str) -> int:
        value = number(text)
        if not low <= value <= high:
            in_hex = "x" in text.lower()
            limits = f"0x{low:X} to 0x{high:X}" if in_hex else f"{low} to {high}"
            raise argparse.ArgumentTypeError(f"{text} is out of range: {limits}")
        return value

    return convert


def slave(text: str) -> int | str:
    """Converts a slave: its position, 0 to 65535, or its name."""
    if not text[:1].isdigit() and not text.startswith("-"):
        if not text or set(text) & set("/*$#?"):  # it becomes a part of a Zenoh key
            raise argparse.ArgumentTypeError(
                f"'{text}' cannot be the name of a slave: a name has none of / * $ # ?"
            )
        return text
    value = number(text)
    if not 0 <= value <= 0xFFFF:
        raise argparse.ArgumentTypeError(
            f"'{text}' is not a position: the first slave has "
            "position 0, and the last at most 65535"
        )
    return value


def seconds(text: str) -> float:
    """Converts a time in seconds: more than 0, at most 3600."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value <= 3600:
        raise argparse.ArgumentTypeError(
            f"'{text}' is not a time: give seconds, more than 0 and at most 3600"
        )
    return value


def interval(text: str) -> float:
    """Converts the interval of `--watch` in seconds: 0.05 to 3600."""
    value = seconds(text)
    if value < 0.05:
        raise argparse.ArgumentTypeError(f"'{text}' is too short: give 0.05 s or more")
    return value


def times(text: str) -> int:
    """Converts a number of times, 1 or more."""
    value = number(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is not 1 or more")
    return value


def add_watch(command: argparse.ArgumentParser, *, count: bool = True) -> None:
    """Adds `--watch` and `--count`, for commands that can repeat their output.

    Args:
        command: The command.
        count: False: it has an option `--count` already.
    """
    command.add_argument(
        "--watch",
        nargs="?",
        type=interval,
        const=1.0,
        metavar="SECONDS",
        help="repeat every SECONDS (default: 1); stats also counts the last interval",
    )
    if count:
        command.add_argument(
            "--count", type=times, metavar="N", help="with --watch: stop after N times"
        )


def add_slave(command: argparse.ArgumentParser) -> None:
    """Adds the argument SLAVE, which chooses one slave of all."""
    command.add_argument(
        "slave", type=slave, nargs="?", metavar="SLAVE", help="only this slave, by position or name"
    )


def add_one_slave(command: argparse.ArgumentParser) -> None:
    """Adds the argument SLAVE of commands that are about one slave."""
    command.add_argument(
        "slave", type=slave, metavar="SLAVE", help="the slave, by position or name"
    )


def hex_bytes(text: str) -> bytes | None:
    """The bytes that a user writes as `hex:04 00`; None if the text does not begin so.

    Raises:
        UsageError: It does, and no bytes follow.
    """
    if not text.startswith("hex:"):
        return None
    try:
        return bytes.fromhex(text[4:])
    except ValueError:
        raise UsageError(f"'{text}' is not a row of bytes such as 'hex:04 00'") from None


def connect(options: argparse.Namespace) -> Remote:
    """Opens a session with the daemon that the options choose."""
    from ecatd.client.remote import Remote  # loading Zenoh is slow

    return Remote(options.bus, options.connect, options.timeout)


def add_yes(command: argparse.ArgumentParser) -> None:
    """Adds the option `--yes`, for scripts."""
    command.add_argument("--yes", action="store_true", help="do not ask for confirmation")


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
        raise UsageError(
            f"{about} Nothing was done, because there is no terminal for the "
            "question: add --yes to do it."
        )
    print(f"{about} Continue? [y/N] ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in _YES:
        raise UsageError("nothing was done")

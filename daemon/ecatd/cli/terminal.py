"""Output on a terminal: coloured lines, and a screen that is redrawn."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterable
from typing import Self

from ecatd.base.errors import StateError
from ecatd.base.sanitized_output import nobody_reads, printable, write_controls

_HIDE, _SHOW = "\033[?25l", "\033[?25h"
_HOME, _CLEAR = "\033[H", "\033[2J"
_REST_OF_LINE, _REST_OF_SCREEN = "\033[K", "\033[J"


class StyledLine(str):
    """A line with a colour, which is only printed on terminals."""

    style: str

    def __new__(cls, text: str, style: str) -> Self:
        """Makes a line; `style` is the number of an SGR sequence (ECMA-48)."""
        made = super().__new__(cls, text)
        made.style = style
        return made


def heading(text: str) -> StyledLine:
    """The head of a table."""
    return StyledLine(text, "1")


def alarm(text: str) -> StyledLine:
    """A line about something that is wrong."""
    return StyledLine(text, "31")


def _painted(line: str, width: int | None = None) -> str:
    text = printable(line if width is None else line[:width])
    if isinstance(line, StyledLine) and text and not os.environ.get("NO_COLOR"):
        return f"\033[{line.style}m{text}\033[0m"
    return text


def check_stdout() -> None:
    """Checks that somebody sees the output; for commands that would go on without end.

    Raises:
        StateError: stdout is closed.
    """
    if nobody_reads():
        raise StateError("stdout is closed, so nobody sees the output")


def show(lines: Iterable[str]) -> None:
    """Prints lines; with colours if stdout is a terminal."""
    coloured = sys.stdout.isatty()
    if coloured:
        write_controls(sys.stdout, "".join(f"{_painted(line)}\n" for line in lines))
    else:
        print("\n".join(lines))


class Screen:
    """Draws lines over the previous ones; a file or pipe gets them one after the other.

    Each drawing is a single write that overwrites the old text, so that nothing flickers. It leaves
    the cursor visible below the last line, so the command may end at any time.
    """

    def __init__(self) -> None:
        self._terminal = sys.stdout.isatty()
        self._begin = _CLEAR if self._terminal else ""

    def draw(self, lines: list[str]) -> None:
        """Draws lines, cut to the size of the terminal; too many are drawn without empty ones."""
        if self._terminal:
            width, height = shutil.get_terminal_size()
            if len(lines) >= height:
                lines = [line for line in lines if line]
            if len(lines) >= height:
                room = max(1, height - 2)
                lines = [*lines[:room], f"({len(lines) - room} more lines: enlarge the window)"]
            text = "".join(f"{_painted(line, width)}{_REST_OF_LINE}\n" for line in lines)
            screen = _HIDE + self._begin + _HOME + text + _REST_OF_SCREEN + _SHOW
            write_controls(sys.stdout, screen)
            self._begin = ""
        else:
            sys.stdout.write(self._begin + "\n".join(lines) + "\n")
            self._begin = "\n"
        sys.stdout.flush()

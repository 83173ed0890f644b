"""A screen that is drawn again and again."""

from __future__ import annotations

import shutil
import sys
from types import TracebackType
from typing import Self

_HIDE, _SHOW = "\033[?25l", "\033[?25h"
_HOME, _CLEAR = "\033[H", "\033[2J"
_REST_OF_LINE, _REST_OF_SCREEN = "\033[K", "\033[J"


class Screen:
    """Draws lines in place of the last ones; into a file or pipe one after the other.

    Each drawing is one write that overwrites what is there, so that nothing flickers. The cursor is
    hidden meanwhile, and comes back below the last line however the command ends.
    """

    def __init__(self) -> None:
        self._terminal = sys.stdout.isatty()
        self._drawn = 0

    def __enter__(self) -> Self:
        if self._terminal:
            sys.stdout.write(_HIDE + _HOME + _CLEAR)
        return self

    def draw(self, lines: list[str]) -> None:
        """Shows lines, cut to the size of the terminal; empty ones are left out first."""
        if not self._terminal:
            sys.stdout.write("\n" * (self._drawn > 0) + "\n".join(lines) + "\n")
        else:
            width, height = shutil.get_terminal_size()
            if len(lines) >= height:
                lines = [line for line in lines if line]
            if len(lines) >= height:
                room = max(1, height - 2)
                lines = [*lines[:room], f"({len(lines) - room} more lines: enlarge the window)"]
            text = "".join(f"{line[:width]}{_REST_OF_LINE}\n" for line in lines)
            sys.stdout.write(_HOME + text + _REST_OF_SCREEN)
        self._drawn += 1
        sys.stdout.flush()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._terminal and kind is not BrokenPipeError:
            sys.stdout.write(_SHOW)
            sys.stdout.flush()

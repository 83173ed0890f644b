"""Marks and lines, by what the terminal can draw: the font of the Linux console has few signs."""

from __future__ import annotations

import os

IS_CONSOLE = os.environ.get("TERM") == "linux"
"""Whether this is the console of a machine without a desktop."""
MARKS = {"good": "•" if IS_CONSOLE else "●", "warning": "▲", "bad": "■", "unknown": "?"}
"""A shape for each state, since not all terminals and people see colours."""
STYLES = {"good": "green", "warning": "yellow", "bad": "bold red", "unknown": "dim"}
"""Its colour."""

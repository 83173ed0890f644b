"""The levels of the log, and the parts of the daemon that have a level each.

`Levels` has the level of all parts as "level", and that of each part which has its own by its name:
the table `[log]` of the configuration.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

LEVELS = ("error", "warning", "info", "debug")
"""From the most important messages to the least important ones."""

PARTS = {
    "service": "the processes of the daemon, and the configuration",
    "start": "the start from the interface to OP; settings for slaves, such as start-up parameters",
    "slaves": "which slaves answer, and their AL states",
    "recovery": "slaves that are brought back to OP",
    "mailbox": "mailboxes, SDO transfers, emergencies",
    "outputs": "who owns outputs, and why they are safe",
    "dc": "distributed clocks",
    "interfaces": "network interfaces, lost frames, other masters",
    "recorder": "incidents of the flight recorder",
    "gateway": "requests over Zenoh, addresses, metrics",
    "ros": "what ROS 2 sees of the bus",
}
"""The parts, and what their messages are about."""

OTHERS = "level"
"""The key of the level of all parts without a level of their own."""

Levels: TypeAlias = Mapping[str, str]

DEFAULTS: Levels = {OTHERS: "info"}


def level_of(levels: Levels, part: str) -> str:
    """The level of a part."""
    return levels.get(part, levels[OTHERS])


def level_of_each(levels: Levels) -> dict[str, str]:
    """The levels of all parts, by part."""
    return {part: level_of(levels, part) for part in PARTS}


def levels_text(levels: Levels) -> str:
    """The levels in words, as short as possible: `info (mailbox debug)`."""
    own = ", ".join(f"{part} {level}" for part, level in levels.items() if part != OTHERS)
    return levels[OTHERS] + (f" ({own})" if own else "")


def with_level(levels: Levels, part: str | None, level: str) -> dict[str, str]:
    """Returns levels in which one part has this level, or every part if `part` is None."""
    return {OTHERS: level} if part is None else {**levels, part: level}

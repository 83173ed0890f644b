"""Facts of events in words: for `ecatctl events`, and for the comments in files of frames."""

from __future__ import annotations

from typing import Any

KINDS = frozenset(
    {
        *("al_state", "slaves", "absent", "recovery", "emergency", "expected_bus"),
        *("link", "sending", "ring", "interface", "foreign_master"),
        *("exchange", "disturbance", "working_counter", "clock", "clock_difference"),
        *("claimed", "safe", "stopped", "refused", "malformed", "tampered"),
        *("configuration", "change", "log_levels"),
    }
)
"""Kinds of events."""


def shown(value: Any) -> str:
    """A fact as text for people."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.3g}"
    if isinstance(value, list | tuple):
        return " ".join(shown(item) for item in value) or "none"
    if isinstance(value, dict):
        return " ".join(f"{name}={shown(item)}" for name, item in value.items()) or "none"
    return str(value)

"""Dataclasses as maps and lists, to be sent to another process or written to a file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any

_LEAVES = frozenset({int, str, float, bool, type(None)})


def plain(value: Any) -> Any:
    """Dataclasses as maps, and lists of them as lists of maps; anything else as it is.

    Fields that do not take part in comparisons are left out. `dataclasses.asdict` also copies each
    value, which takes several times as long for a large bus.
    """
    return [plain(item) for item in value] if type(value) is list else _way(value.__class__)(value)


@cache
def _way(kind: type[Any]) -> Callable[[Any], Any]:
    """How values of a type other than a list become plain."""
    if not is_dataclass(kind):
        return lambda value: value
    names = [item.name for item in fields(kind) if item.compare]

    def to_map(value: Any) -> dict[str, Any]:
        found = {}
        for name in names:
            item = getattr(value, name)
            found[name] = item if type(item) in _LEAVES else plain(item)
        return found

    return to_map

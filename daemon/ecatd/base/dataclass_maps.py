"""Dataclasses as maps and lists, to be sent to another process or written to a file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from typing import Any

_LEAVES = frozenset({int, str, float, bool, type(None)})


def to_maps(value: Any) -> Any:
    """Dataclasses as maps, and lists of them as lists of maps; anything else as it is.

    Fields that do not take part in comparisons are left out. `dataclasses.asdict` also copies each
    value, which takes several times as long for a large bus.
    """
    return (
        [to_maps(item) for item in value] if type(value) is list else _way(value.__class__)(value)
    )


@cache
def _way(kind: type[Any]) -> Callable[[Any], Any]:
    """How values of a type other than a list become maps."""
    if not is_dataclass(kind):
        return lambda value: value
    names = [item.name for item in fields(kind) if item.compare]

    def to_map(value: Any) -> dict[str, Any]:
        found = {}
        for name in names:
            item = getattr(value, name)
            found[name] = item if type(item) in _LEAVES else to_maps(item)
        return found

    return to_map


@cache
def required_fields(kind: Callable[..., Any]) -> list[str]:
    """The fields of a dataclass that have no default."""
    return [
        item.name
        for item in fields(kind)  # type: ignore[arg-type]
        if item.default is MISSING and item.default_factory is MISSING
    ]

"""Types of values in msgpack: their names, the maps that they lead to, and a check."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, NamedTuple, NotRequired, Union, cast, get_args, get_origin, get_type_hints

from ecatd.operations.bus import Event
from ecatd.operations.events import FACTS, KINDS, Kind
from ecatd.operations.operation import Operation
from ecatd.operations.statistics import CanStatistics, Distribution, DomainStatistics, Statistics
from ecatd.shm import contract as shm

from .. import page_parts

_NAMES: dict[Any, str] = {
    int: "int",
    float: "float",
    bool: "bool",
    str: "str",
    bytes: "bin",
    NoneType: "nil",
    Any: "any",
}
"""Names of types as msgpack has them."""


class Key(NamedTuple):
    """A key of a map.

    Attributes:
        name: Its name.
        kind: The type of its value.
        needed: Whether it is always there.
        about: What it means; may be empty.
    """

    name: str
    kind: Any
    needed: bool
    about: str


def keys_of(kind: type) -> list[Key]:
    """Returns the keys of a map."""
    about = attributes(kind)
    return [
        Key(name.rstrip("_"), plain, needed, about.get(name, ""))
        for name, (plain, needed) in _hints_of(kind).items()
    ]


@cache
def _hints_of(kind: type) -> dict[str, tuple[Any, bool]]:
    """The type of each attribute of a map, and whether it is always there."""
    hints = get_type_hints(kind, include_extras=True)
    if is_dataclass(kind):
        hints = {item.name: hints[item.name] for item in fields(kind) if item.compare}
    found = {}
    for name, hint in hints.items():
        needed = get_origin(hint) is not NotRequired
        found[name] = (hint if needed else get_args(hint)[0], needed)
    return found


def answer_of(kind: type[Operation[Any]]) -> type:
    """The map that answers an operation."""
    (base,) = kind.__orig_bases__  # type: ignore[attr-defined]
    (answer,) = get_args(base)
    return cast(type, answer)


def summary(kind: type) -> str:
    """Returns what a docstring says in front of its attributes, in one line."""
    return _in_msgpack(" ".join(page_parts.paragraphs(kind)))


def attributes(kind: type) -> dict[str, str]:
    """Returns what a docstring says about each attribute."""
    return {name: _in_msgpack(text) for name, text in page_parts.attributes(kind).items()}


def _in_msgpack(text: str) -> str:
    return text.replace("None", f"`{_NAMES[NoneType]}`")


def is_map(kind: Any) -> bool:
    """Whether a type is a map with known keys."""
    return isinstance(kind, type) and kind not in _NAMES and get_origin(kind) is None


def name_of(kind: Any) -> str:
    """Returns the name of a type in Markdown; a map is a link to its table."""
    if kind in _NAMES:
        return f"`{_NAMES[kind]}`"
    if is_map(kind):
        return f"[{kind.__name__}](#{kind.__name__.lower()})"
    parts = [name_of(part) for part in get_args(kind)]
    if get_origin(kind) in (Union, UnionType):
        return " or ".join(parts)
    if get_origin(kind) is dict:
        return f"map of {parts[0]} to {parts[1]}"
    return f"list of {parts[0]}"


def maps_in(kind: Any) -> Iterator[type]:
    """Yields the maps in a type, also those within maps; one that is there twice comes twice."""
    if is_map(kind):
        yield kind
        for key in keys_of(kind):
            if key.kind is not kind:
                yield from (item for item in maps_in(key.kind) if item is not kind)
    else:
        for part in get_args(kind):
            yield from maps_in(part)


def problems(value: Any, kind: Any, where: str = "") -> Iterator[str]:
    """Yields in what a value differs from a type.

    Args:
        value: The value, as msgpack gives it.
        kind: The type.
        where: Where the value is, for the texts.
    """
    origin, parts = get_origin(kind), get_args(kind)
    if is_map(kind):
        if isinstance(value, dict):
            yield from _problems_of_map(value, kind, where)
        else:
            yield f"{where}: {value!r} is no map"
    elif origin in (Union, UnionType):
        tried = [[*problems(value, part, where)] for part in parts]
        yield from min(tried, key=len)
    elif origin is dict and isinstance(value, dict):
        for key, item in value.items():
            yield from problems(key, parts[0], where)
            yield from problems(item, parts[1], f"{where}.{key}")
    elif origin in (list, tuple) and isinstance(value, list):
        for number, item in enumerate(value):
            yield from problems(item, parts[0], f"{where}[{number}]")
    elif kind is not Any and not (type(value) is kind or (kind is float and type(value) is int)):
        yield f"{where}: {value!r} is no {kind}"


def _problems_of_map(value: dict[str, Any], kind: type, where: str) -> Iterator[str]:
    # Without what the keys are about: several threads come here at once, and Python 3.11 must
    # not parse sources in two threads at once ("AST constructor recursion depth mismatch").
    known = _hints_of(kind)
    if kind is Event:
        event = value.get("event")
        if event in EVENTS:
            known = known | _hints_of(EVENTS[event])
        else:
            yield f"{where}: {event!r} is no kind of event"
    known = {name.rstrip("_"): hint for name, hint in known.items()}
    for name, (hint, needed) in known.items():
        if name in value:
            yield from problems(value[name], hint, f"{where}.{name}")
        elif needed:
            yield f"{where}: '{name}' of {kind.__name__} is missing"
    for name in value.keys() - known.keys() - {"schema"}:
        yield f"{where}: '{name}' is no key of {kind.__name__}"


def _facts_of(kind: Kind) -> type:
    """The keys of events of a kind, as a map."""
    types = {
        name.rstrip("?"): NotRequired[FACTS[name.rstrip("?")].type]
        if name.endswith("?")
        else FACTS[name].type
        for name in kind.facts
    }
    return type(kind.name, (dict,), {"__annotations__": types, "__doc__": f"{kind.subject}."})


EVENTS = {name: _facts_of(KINDS[name]) for name in KINDS if KINDS[name].published}
"""The facts of each kind of event, beside those that all have."""


def _add(kind: Any, name: str, of: type, meaning: str) -> None:
    """Adds a key that the shared memory defines to a map."""
    kind.__annotations__[name] = of
    about = f"{meaning[0].upper()}{meaning[1:]}."
    said = kind.__doc__.rstrip()
    if "Attributes:" not in said:
        said += "\n\n    Attributes:"
    kind.__doc__ = f"{said}\n        {name}: {about}\n"


for _counter in shm.COUNTERS:
    _add(Statistics, _counter.name, int, _counter.meaning)
for _counter in shm.DOMAIN_COUNTERS:
    _add(DomainStatistics, _counter.name, int, _counter.meaning)
for _counter in shm.CAN_COUNTERS:
    _add(CanStatistics, _counter.name, int, _counter.meaning)
for _name, _meaning in shm.TIMES.items():
    _add(Statistics, _name, Distribution, _meaning)

"""Writes docs/zenoh-keys.md: the Zenoh keys, and the types of all maps.

    PYTHONPATH=tools .venv/bin/python -m ecatdev.zenoh_keys.page docs/zenoh-keys.md

Operations and answers are those of `ecatd.operations`.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ecatd.operations.bus import Event
from ecatd.operations.catalog import OPERATIONS
from ecatd.operations.description import BusDescription
from ecatd.operations.events import FACTS, KINDS
from ecatd.operations.fields import Limits
from ecatd.operations.log import LogLine
from ecatd.operations.operation import Failure, Operation, needs_right
from ecatd.operations.query import ALL
from ecatd.operations.statistics import Statistics
from ecatd.operations.streams import PdoValue, StreamRow
from ecatd.operations.traces import TraceBatch

from ..page_parts import head, row
from .types import EVENTS, answer_of, attributes, keys_of, maps_in, name_of, summary

_INTRO = """\
# Zenoh keys and maps

This page has the type of each value that a program sends to ecatd over [Zenoh](zenoh.md), or gets
from it. It is made from the sources, and tests compare the answers of a real daemon with it.

- **Keys** are those below `ecat/v1/<bus>/`. `<bus>` is the name of the bus, or `HOST:BUS` if
  `gateway.host` names the machine.
- **Payloads** are maps in msgpack with strings as keys. Each that ecatd sends has `schema`, an
  `int`: 1 for what this page says. Types are named as in msgpack: `bin` are bytes, and `nil` is no
  value. A `float` may come as an integer.
- **Numbers in keys and parameters** are decimal or `0x…`. A slave is its position or its name,
  percent-encoded.
- **A query that only reads** has no payload. Its parameters are behind a `?`:
  `ro/sii/3?word=0x40;count=8`.
- **A change** is a query under `rw/…`, or for a user of another machine under `as/<user>/rw/…`. Its
  payload needs an [`id`](zenoh.md#changes): a `str` of 1 to 64 characters, new for each change.
- **The cost** of an answer: `memory`: the daemon knows it; `frames`: it takes some frames on the
  wire; `mailbox`: a slave is asked over its mailbox or for its EEPROM, and few may wait for that.
- **An error** is an error reply with the map [Failure](#failure). The daemon refuses parameters and
  keys that are not on this page.
"""

PUBLICATIONS: dict[str, tuple[type, str]] = {
    "ro/event": (Event, "each event at once"),
    "ro/log/lines": (LogLine, "each line of the log of the bus server from level notice up"),
    "ro/pdo/{slave}/{address}": (
        PdoValue,
        "a value when it has changed, at most `gateway.publish_hz` times a second, and in any case "
        "every second; `address` is `0xINDEX:SUB`, both in hexadecimal",
    ),
    "ro/slaves": (BusDescription, "after a reload that has changed it"),
    "ro/stats": (Statistics, "every second while somebody subscribes, without `buckets`"),
    "ro/stream/{id}": (StreamRow, "a row of a stream"),
    "ro/trace/{id}": (TraceBatch, "some cycles of a trace, about 20 times a second"),
}
"""What is published under which key, and when."""
_WITH_RIGHT = """\
A user of another machine needs a right for each of them, in `gateway.user.write`. Reading frames
and files changes nothing, but needs a right as well.\
"""

_NAMES = {
    "int": "`int`",
    "float": "`float`",
    "bool": "`bool`",
    "str": "`str`",
    "bytes": "`bin`",
    "dict": "map",
}


def page() -> str:
    """Returns the page."""
    maps = {item for kind in OPERATIONS.values() for item in maps_in(answer_of(kind))}
    maps |= {item for kind, _ in PUBLICATIONS.values() for item in maps_in(kind)}
    maps |= {*maps_in(Failure)}
    lines = [_INTRO, "## Publications", "", *_publications(), ""]
    lines += ["## Queries that only read", "", *_requests(change=False)]
    lines += ["## Changes", "", _WITH_RIGHT, "", *_requests(change=True)]
    lines += ["## Maps", ""]
    for kind in sorted(maps, key=lambda item: item.__name__):
        lines += _map(kind)
    lines += ["## Kinds of events", "", *_events()]
    return "\n".join(lines) + "\n"


def _publications() -> Iterator[str]:
    yield "`alive` is no publication but a liveliness token, which exists while the daemon runs."
    yield ""
    yield from head("key", "map", "when")
    for key, (kind, when) in PUBLICATIONS.items():
        yield row(f"`{_shown(key)}`", name_of(kind), when)


def _requests(*, change: bool) -> Iterator[str]:
    for kind in OPERATIONS.values():
        if needs_right(kind) != change:
            continue
        yield f"### `{_shown(kind.key)}`"
        yield ""
        answer = name_of(answer_of(kind))
        yield f"{summary(kind)} Answer: {answer}. Cost: {kind.cost}."
        yield ""
        if kind.fields:
            yield from head("field", "in", "type", "default", "meaning")
            for name in kind.fields:
                where, default = _place(kind, name)
                yield row(f"`{name}`", where, _type(kind, name), default, _said(kind, name))
            yield ""


def _said(kind: type[Operation[Any]], name: str) -> str:
    about = attributes(kind).get(name, "")
    return about.replace("`nil`", f"`{ALL}`") if "{" + name + "}" in kind.key else about


def _place(kind: type[Operation[Any]], name: str) -> tuple[str, str]:
    """Returns where a field is, and what it is if it is left out."""
    if "{" + name + "}" in kind.key:
        return "key", ""
    default = "needed" if name in kind.needed else _value(getattr(kind, name))
    return "payload" if needs_right(kind) else "parameter", default


def _value(value: Any) -> str:
    if value is None or value == "":
        return ""
    return f"`{str(value).lower() if isinstance(value, bool) else value}`"


def _type(kind: type[Operation[Any]], name: str) -> str:
    field = kind.fields[name]
    text = " or ".join(_NAMES[part] for part in field.types if part != "None")
    if isinstance(field.rule, Limits):
        text = text.replace("`int`", f"`int` ({field.rule.least} to {field.rule.greatest})")
    in_key = "{" + name + "}" in kind.key
    return f"{text} or `{ALL}`" if in_key and "None" in field.types else text


def _map(kind: type) -> Iterator[str]:
    yield f"### {kind.__name__}"
    yield ""
    yield summary(kind)
    yield ""
    yield from head("key", "type", "meaning")
    for key in keys_of(kind):
        yield row(f"`{key.name}`{'' if key.needed else ' *'}", name_of(key.kind), key.about)
    yield ""
    if not all(key.needed for key in keys_of(kind)):
        yield "\\* not always there"
        yield ""


def _events() -> Iterator[str]:
    yield "Each event has the keys of its kind in addition to those of [Event](#event)."
    yield "[Events](troubleshooting.md#events) says what to do."
    yield ""
    yield from head("`event`", "when", "keys")
    for name, kind in EVENTS.items():
        values = KINDS[name].values
        keys = (
            f"`{key.name}`{'' if key.needed else ' *'}"
            + (f" ({values[key.name]})" if key.name in values else "")
            for key in keys_of(kind)
        )
        yield row(f"`{name}`", summary(kind), ", ".join(keys))
    yield ""
    yield "\\* not always there"
    yield ""
    yield from head("key", "type", "meaning")
    for name, fact in FACTS.items():
        meaning = fact.meaning.replace("None", "`nil`")
        yield row(f"`{name}`", name_of(fact.type), f"{meaning[0].upper()}{meaning[1:]}.")


def _shown(key: str) -> str:
    return re.sub(r"\{(\w+)\}", r"<\1>", key)


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(page())

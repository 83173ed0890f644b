"""Writes docs/configuration-keys.md: all keys of the configuration.

    PYTHONPATH=tools .venv/bin/python -m ecatdev.configuration_page docs/configuration-keys.md

All of it is in `ecatd.config`. Each table of the file is a dataclass there, and each key one
of its fields, with the default and, in the annotation, the rule that has the range. Docstrings say
what tables and keys mean. Two things in them are for this page:

- A last sentence `Default: ….` stands in place of the default of the field.
- A constant of the module in backticks, such as `DOMAINS_MAX`, stands for its value.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterator
from dataclasses import MISSING, Field, fields, is_dataclass
from pathlib import Path
from textwrap import TextWrapper
from typing import Any, NamedTuple, get_args, get_origin, get_type_hints

from ecatd.base.dataclass_maps import required_fields
from ecatd.base.log_levels import DEFAULTS, OTHERS, PARTS
from ecatd.base.toml_file import Limits, Rule, Table
from ecatd.config import Config
from ecatd.config.config import LOG
from ecatd.config.placed import rules_of
from ecatd.config.writer import value_text

from .page_parts import attributes, head, paragraphs, row

_INTRO = """\
# Configuration keys

This page has all keys of the configuration file, table by table. It is made from the sources that
read the file. [Configuration](configuration.md) says how the file is read, and explains the larger
subjects.

- **Default** is the value of a key that is not in the file. Without a key that is needed, ecatd
  refuses the table.
- **Range** is what ecatd accepts. Many keys have the unit of their value at their end: `_us` are
  microseconds.

## The top of the file

These keys stand in front of the first `[table]`.
"""
_ABOUT_LOG = """\
The level of each [part of the daemon](configuration.md#the-log) that has one of its own, such as
`mailbox = "debug"`, and of all others.
"""
_UNITS = {"us": "µs", "ms": "ms", "s": "s", "hz": "Hz", "mb": "MiB", "cycles": "cycles"}
"""Units by the ends of keys."""
_LARGE_NUMBER = re.compile(r"(?<![\w.])\d{5,}(?![\w.])")
_wrap = TextWrapper(128, break_long_words=False, break_on_hyphens=False).wrap


class Section(NamedTuple):
    """A table of the file, or an array of tables.

    Attributes:
        path: The keys that lead to it, such as `dc.slave`.
        title: Its header, such as `[[dc.slave]]`.
        kind: The dataclass.
    """

    path: str
    title: str
    kind: Any


def page() -> str:
    """Returns the page."""
    lines = [_INTRO, *_keys(Config), "", "## `[log]`", "", _ABOUT_LOG, *_levels()]
    for section in sections():
        first, *others = paragraphs(section.kind)
        about = first.removeprefix(f"`{section.title}`: ")
        lines += ["", f"## `{section.title}`", ""]
        for text in (about[0].upper() + about[1:], *others):
            lines += [*_wrapped(_with_values(section.kind, text)), ""]
        lines += _keys(section.kind)
    return "\n".join(lines) + "\n"


def _wrapped(text: str) -> Iterator[str]:
    """Yields the lines of a paragraph; what is in backticks stays on one line."""
    whole = re.sub("`[^`]*`", lambda code: code[0].replace(" ", "\0"), text)
    yield from (line.replace("\0", " ") for line in _wrap(whole))


def sections(kind: Any = Config, above: str = "") -> Iterator[Section]:
    """Yields the tables within a table, each in front of those within it."""
    hints = get_type_hints(kind)
    for name in rules_of(kind):
        if inner := _table_in(hints[name]):
            path = above + name
            title = f"[[{path}]]" if get_origin(hints[name]) is list else f"[{path}]"
            yield Section(path, title, inner)
            yield from sections(inner, f"{path}.")


def _table_in(hint: Any) -> Any:
    """Returns the dataclass in a type; None if there is none."""
    return next((part for part in (hint, *get_args(hint)) if is_dataclass(part)), None)


def _keys(kind: Any) -> Iterator[str]:
    hints, rules, about = get_type_hints(kind), rules_of(kind), attributes(kind)
    yield from head("key", "default", "range", "meaning")
    for item in fields(kind):
        if item.name in rules and not _table_in(hints[item.name]) and item.name != "log":
            said = _with_values(kind, about[item.name])
            meaning, _, default = said.partition(" Default: ")
            default = default.removesuffix(".") or _default(kind, item)
            yield row(f"`{item.name}`", default, range_of(item.name, rules[item.name]), meaning)


def _levels() -> Iterator[str]:
    yield from head("key", "default", "range", "meaning")
    for part, rule in LOG.items():
        default, meaning = f"that of `{OTHERS}`", f"Level of messages about {PARTS.get(part)}."
        if part == OTHERS:
            default, meaning = _code(part, DEFAULTS[part]), attributes(Config)["log"]
        yield row(f"`{part}`", default, range_of(part, rule), meaning)


def _default(kind: Any, item: Field[Any]) -> str:
    if item.name in required_fields(kind):
        return "needed"
    factory: Any = item.default_factory
    return _code(item.name, item.default if factory is MISSING else factory())


def _code(key: str, value: Any) -> str:
    return f"`{value_text(key, value)}`"


def _with_values(kind: Any, text: str) -> str:
    """Returns a text with the values of constants in place of their names."""
    constants = vars(sys.modules[kind.__module__])
    return re.sub(r"(?<=`)[A-Z][A-Z_]+(?=`)", lambda name: _constant(constants, name[0]), text)


def _constant(constants: dict[str, Any], name: str) -> str:
    return value_text("", constants[name]) if name in constants else name


def range_of(key: str, rule: Rule) -> str:
    """Returns what a rule accepts, in words."""
    if rule is Table.boolean:
        return "`true`, `false`"
    assert isinstance(rule, Limits), f"{key}: its rule does not say what it accepts"
    text = rule.accepted
    if not isinstance(text, str):
        low, high = text
        text = "finite" if high == math.inf else f"{_number(key, low)} to {_number(key, high)}"
    text = _LARGE_NUMBER.sub(lambda number: f"{int(number[0]):,}".replace(",", " "), text)
    unit = _UNITS.get(key.rpartition("_")[2], "")
    return f"{text} {unit}".rstrip()


def _number(key: str, value: float) -> str:
    return value_text(key, value) if isinstance(value, int) else f"{value:.15g}"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(page())

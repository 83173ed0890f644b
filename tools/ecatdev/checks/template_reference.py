"""The tables of `docs/templates.md` that follow from the code: classes, attributes and filters.

`python -m ecatdev.checks.template_reference docs/templates.md` brings the file up to date.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

from ecatd.etg.pdo import Entry, Value
from ecatgen import ir
from ecatgen.render import FILTERS

CLASSES = (
    *(ir.Library, ir.Block, ir.Connector, Value, ir.Skipped),
    *(ir.Can, ir.CanMessage, ir.CanSignal, Entry),
    *(ir.Drive, ir.DriveLine, ir.DriveParameter),
    *(ir.Channels, ir.Vector),
    *(ir.Example, ir.Component, ir.Connection, ir.Variable, ir.Extent, ir.Point),
)
"""Classes of the objects that templates use, from the whole library to its parts."""

_PLACE = re.compile(r"(?<=<!-- reference -->\n).*?(?=<!-- end -->)", re.DOTALL)


def reference() -> str:
    """Returns the tables as Markdown.

    Raises:
        ValueError: An attribute has no description.
    """
    lines = [line for kind in CLASSES for line in _table(kind)]
    lines += ["### Filters", "", "| filter | gives |", "|---|---|", *_filters(), ""]
    return "\n".join(lines)


def updated(document: str) -> str:
    """Returns the document with up-to-date tables."""
    return _PLACE.sub(lambda _: f"\n{reference()}\n", document)


def _table(kind: type[Any]) -> Iterator[str]:
    text = inspect.cleandoc(kind.__doc__ or "")
    about = _attributes(text)
    yield f"### {kind.__name__}"
    yield ""
    yield text.split("\n\n")[0].replace("\n", " ")
    yield ""
    yield "| attribute | type | |"
    yield "|---|---|---|"
    for item in fields(kind):
        if item.name not in about:
            raise ValueError(f"{kind.__name__}.{item.name} has no description")
        type_name = str(item.type).replace("|", "\\|")
        yield f"| `{item.name}` | `{type_name}` | {about[item.name]} |"
    yield ""


def _attributes(text: str) -> dict[str, str]:
    body = text.partition("Attributes:\n")[2]
    items = re.split(r"\n(?=    \w)", body.rstrip())
    pairs = (" ".join(item.split()).partition(": ") for item in items)
    return {name: description for name, _, description in pairs}


def _filters() -> Iterator[str]:
    for name, function in FILTERS.items():
        first = (inspect.getdoc(function) or "").splitlines()[0]
        yield f"| `{name}` | {first} |"


if __name__ == "__main__":
    for file in map(Path, sys.argv[1:]):
        file.write_text(updated(file.read_text("utf-8")), "utf-8")

"""Checks each class of a library against the conventions of the Modelica Standard Library.

The conventions are in its `UsersGuide.Conventions`. They are about names, descriptions,
documentation, icons and dialogs.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

_CLASS_NAME = re.compile(r"[A-Z][A-Za-z0-9]*(_\d+)?")
_FUNCTION_NAME = re.compile(r"[a-z][A-Za-z0-9]*")
# Allows suffixes such as `_ref` or `_max`, and the numbers and addresses in generated names.
_COMPONENT_NAME = re.compile(r"[a-z][A-Za-z0-9]*(_[a-z]+|(_[0-9A-F]+)+|_\d+[A-Za-z]*)*")
_ICONS = {
    "package": re.compile(r"extends (Modelica|EtherCAT)\.Icons\.(\w*Package|Information|Plant)\b"),
    "function": re.compile(r"extends Modelica\.Icons\.Function\b"),
    "record": re.compile(r"extends Modelica\.Icons\.Record\b"),
}
_DEFAULT_NAME = re.compile(r'\bdefaultComponentName = "[a-z]\w*"')
_SHORT = re.compile(r"within [\w.]*;\n\w+ \w+ =")
_STRING = re.compile(r'"(?:[^"\\]|\\.)*"', re.DOTALL)
_BOOLEAN = re.compile(r"parameter Boolean (?P<name>\w+)[^;]*?;", re.DOTALL)


def check_conventions(library: Path) -> Iterator[str]:
    """Yields a sentence for each place where a library departs from the conventions."""
    from pymoca import parser

    for file in sorted(library.rglob("*.mo")):
        source = file.read_text("utf-8")
        found = parser.parse(source)
        parent = file.parent.parent if file.name == "package.mo" else file.parent
        for package in parent.relative_to(library.parent).parts:
            found = found.classes[package]
        name = file.parent.name if file.name == "package.mo" else file.stem
        for problem in _check_file(found.classes[name], source):
            yield f"{file.relative_to(library.parent)}: {problem}"


def _check_file(found: Any, source: str) -> Iterator[str]:
    kind = _kind(found)
    yield from _check_class(found)
    yield from _check_dialogs(source)
    if 'Documentation(info = "<html>' not in source:
        yield "has no documentation"
    is_short = _SHORT.match(source) is not None
    if kind in _ICONS and not is_short and not _ICONS[kind].search(source):
        yield f"extends no icon for a {kind}"
    if "extends Modelica.Icons.Example;" in source:
        if not re.search(r"\bexperiment\(StopTime = ", source):
            yield "is an example without a stop time"
    elif kind in ("block", "model") and not found.partial and not _DEFAULT_NAME.search(source):
        yield "has no defaultComponentName"


def _kind(found: Any) -> str:
    return str(found.type).removeprefix("impure").removeprefix("expandable").strip()


def _check_class(found: Any) -> Iterator[str]:
    """Checks names and descriptions of a class, its components and its inner classes."""
    kind = _kind(found)
    pattern = _FUNCTION_NAME if kind == "function" else _CLASS_NAME
    if not pattern.fullmatch(found.name):
        yield f"{found.name} is not a name for a {kind}"
    yield from _check_description(found.name, found.comment)
    for symbol in found.symbols.values():
        if kind != "type" and not _COMPONENT_NAME.fullmatch(symbol.name):
            yield f"{symbol.name} is not a name for a component"
        yield from _check_description(f"{found.name}.{symbol.name}", symbol.comment)
    for inner in found.classes.values():
        yield from _check_class(inner)


def _check_description(name: str, text: str) -> Iterator[str]:
    if not text:
        yield f"{name} has no description"
    elif text.endswith(".") and not text.endswith(".."):
        yield f"{name}: a description has no full stop at its end"


def _check_dialogs(source: str) -> Iterator[str]:
    public = _STRING.sub('""', source).partition("\nprotected\n")[0]
    for match in _BOOLEAN.finditer(public):
        if "checkBox = true" not in match[0]:
            yield f"{match['name']} has no check box in the dialog of parameters"

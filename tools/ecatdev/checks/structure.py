"""Checks files, names and texts of a Modelica library."""

from __future__ import annotations

import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

_HEAD = re.compile(
    r"within ?(?P<within>[\w.]*);\n"
    r"(?:(?:impure|partial) )*"
    r"(?:package|block|model|class|connector|function|record|type) (?P<name>\w+)\b"
)
_CONSTANT = re.compile(r"^  constant [\w.]+ (\w+)", re.MULTILINE)
_STRING = re.compile(r'"((?:[^"\\]|\\.)*)"', re.DOTALL)
_DOCUMENTATION = re.compile(r'\b(?:info|revisions)\s*=\s*"((?:[^"\\]|\\.)*)"', re.DOTALL)
_URI = re.compile(r"modelica://([\w.]+)((?:/[\w./-]*)?)")
_ELEMENTS = re.compile(r"enumeration\((.*?)\)\s*(?:\"|annotation)", re.DOTALL)
_VOID = frozenset({"br", "hr", "img"})


def check_structure(library: Path) -> Iterator[str]:
    """Yields problems with the files of a library.

    Links to other libraries are looked up in the folder that has this library.
    """
    for file in sorted(library.rglob("*.mo")):
        source = file.read_text("utf-8")
        where = file.relative_to(library.parent)
        for problem in (
            *_check_head(file, source, library),
            *_check_texts(source, library.parent),
            *_check_enumerations(source),
        ):
            yield f"{where}: {problem}"
    for file in sorted(library.rglob("package.mo")):
        for problem in _check_order(file.parent):
            yield f"{file.parent.relative_to(library.parent)}: {problem}"


def _check_head(file: Path, source: str, library: Path) -> Iterator[str]:
    is_package = file.name == "package.mo"
    name = file.parent.name if is_package else file.stem
    parent = (file.parent.parent if is_package else file.parent).relative_to(library.parent)
    within = ".".join(parent.parts)
    match = _HEAD.match(source)
    if match is None:
        yield "does not begin with a within clause and a class"
        return
    if match["within"] != within:
        yield f"is within '{match['within']}', but lies in '{within}'"
    if match["name"] != name:
        yield f"defines {match['name']}"
    is_short = re.match(r"\s*=", source[match.end() :]) is not None
    if not is_short and not source.endswith(f"end {name};\n"):
        yield f"does not end with 'end {name};'"


def _check_order(folder: Path) -> Iterator[str]:
    files = {file.stem for file in folder.glob("*.mo")} - {"package"}
    folders = {file.parent.name for file in folder.glob("*/package.mo")}
    constants = set(_CONSTANT.findall((folder / "package.mo").read_text("utf-8")))
    order = (folder / "package.order").read_text("utf-8").splitlines()
    defined = files | folders | constants
    for name in sorted(defined - set(order)):
        yield f"package.order lacks {name}"
    for name in sorted(set(order) - defined):
        yield f"package.order has {name}, which does not exist"
    if len({name.casefold() for name in order}) != len(order):
        yield "package.order has names that differ only in case, or not at all"
    if files & folders:
        yield f"file and folder of the same name: {', '.join(sorted(files & folders))}"


def _check_texts(source: str, root: Path) -> Iterator[str]:
    for literal in _DOCUMENTATION.findall(source):
        if not literal.startswith("<html>"):
            continue
        document = _Html()
        document.feed(literal.replace('\\"', '"'))
        document.close()
        yield from document.problems
        if document.open:
            yield f"HTML leaves <{document.open[-1]}> open"
    for name, path in _URI.findall(source):
        if not _uri_exists(name, path, root):
            yield f"modelica://{name}{path} does not exist"


def _uri_exists(name: str, path: str, root: Path) -> bool:
    library, *classes = name.split(".")
    if path:
        return (root / library / path.lstrip("/")).exists()
    place = root / library
    if not place.is_dir():
        return library == "Modelica"  # which may not be installed here
    for i, part in enumerate(classes):
        if (place / part / "package.mo").exists():
            place /= part
            continue
        file = place / f"{part}.mo"
        # Inner classes of a file only have to be somewhere in the file; nesting is not checked.
        return file.exists() and all(
            re.search(rf"^ +(?:\w+ )*{inner}\b", file.read_text("utf-8"), re.MULTILINE)
            for inner in classes[i + 1 :]
        )
    return True


def _check_enumerations(source: str) -> Iterator[str]:
    for body in _ELEMENTS.findall(source):
        names = re.findall(r"(\w+)", _STRING.sub("", body))
        if not names or len({name.casefold() for name in names}) != len(names):
            yield f"enumeration without distinct elements: {', '.join(names)}"


class _Html(HTMLParser):
    """Finds HTML elements that are not closed in the right order."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.problems: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Remembers an open element."""
        if tag not in _VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        """Checks that an end tag closes the last open element."""
        if self.open and self.open[-1] == tag:
            self.open.pop()
        else:
            self.problems.append(f"HTML closes <{tag}>, which is not the last one that is open")

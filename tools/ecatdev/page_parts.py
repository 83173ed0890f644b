"""Parts of pages that are made from the sources: tables in Markdown, and what docstrings say."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator


def head(*names: str) -> Iterator[str]:
    """Yields the two lines at the top of a table."""
    yield row(*names)
    yield "|" + "---|" * len(names)


def row(*cells: str) -> str:
    """Returns a line of a table; empty cells have one space."""
    return f"| {' | '.join(cells)} |".replace("|  |", "| |").replace("|  |", "| |")


def paragraphs(kind: type) -> list[str]:
    """Returns the paragraphs in front of the attributes, each in one line."""
    text = (inspect.getdoc(kind) or "").partition("\n\nAttributes:")[0]
    return [" ".join(part.split()) for part in text.split("\n\n")]


def attributes(kind: type) -> dict[str, str]:
    """Returns what is said about each attribute, in one line: in the docstring, or with `#:`."""
    text = (inspect.getdoc(kind) or "").partition("\nAttributes:\n")[2]
    found = re.findall(r"^ {4}(\w+): (.*(?:\n {8}.*)*)", text, re.MULTILINE)
    return {name: " ".join(about.split()) for name, about in found} | _comments(kind)


def _comments(kind: type) -> dict[str, str]:
    """What comments that begin with `#:` say, above an attribute or behind it."""
    try:
        source = inspect.getsource(kind)
    except (OSError, TypeError):  # it was made while the program runs
        return {}
    found = {}
    for above, name, behind in re.findall(
        r"((?:^ {4}#: .*\n)*)^ {4}(\w+): (?:[^#\n]|#(?!:))*(?:#: (.*))?$", source, re.MULTILINE
    ):
        if text := behind or " ".join(above.replace("#:", "").split()):
            found[name] = text
    return found

"""Reads XML from untrusted sources, and keeps the line of each element.

A document type (<!DOCTYPE>) is refused: ESI and ENI files need none, and it could define entities
that expand without end or read other files. Size, depth and number of elements are limited.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat

from ecatd.model.errors import ConfigError

MAX_BYTES = 128 << 20
_MAX_DEPTH = 64
_MAX_ELEMENTS = 2_000_000
_CHUNK = 1 << 16
_DAMAGED = "the file may be damaged: get it again, or leave it out"


@dataclass(slots=True)
class Element:
    """An XML element.

    Attributes:
        tag: Name without a namespace prefix.
        path: The file, for messages.
        line: Line of its start tag.
        attributes: Attributes.
        text: Text directly in the element, without surrounding white space.
        children: Elements directly in the element.
    """

    tag: str
    path: str
    line: int
    attributes: dict[str, str] = field(default_factory=dict)
    text: str = ""
    children: list[Element] = field(default_factory=list)

    def fail(self, text: str) -> NoReturn:
        """Refuses the file because of this element.

        Raises:
            ConfigError: Always; the message begins with file and line.
        """
        raise ConfigError(f"{self.path}:{self.line}: {text}")

    def all(self, tag: str) -> Iterator[Element]:
        """Returns the children with this name."""
        return (child for child in self.children if child.tag == tag)

    def find(self, *tags: str) -> Element | None:
        """Finds the first child of the first name, its first child of the second, and so on."""
        here: Element | None = self
        for tag in tags:
            here = next(here.all(tag), None) if here else None
        return here

    def need(self, tag: str) -> Element:
        """Returns the first child with this name.

        Raises:
            ConfigError: There is no such child.
        """
        child = self.find(tag)
        return child if child else self.fail(f"<{self.tag}> has no <{tag}>")

    def text_of(self, *tags: str) -> str:
        """The text of a descendant (see `find`); empty if there is none."""
        found = self.find(*tags)
        return found.text if found else ""

    def name(self, tag: str = "Name") -> str:
        """The text of <Name>, if there are several languages that in English (LcId 1033)."""
        names = list(self.all(tag))
        english = [name for name in names if name.attributes.get("LcId") == "1033"]
        return next((name.text for name in (*english, *names) if name.text), "")

    def number(self, low: int = 0, high: int = 0xFFFFFFFF) -> int:
        """The text as a number: decimal, or hexadecimal after #x or 0x.

        Raises:
            ConfigError: The text is no number, or out of range.
        """
        return self._number(self.text, f"<{self.tag}>", low, high)

    def number_of(
        self, tag: str, default: int | None = None, low: int = 0, high: int = 0xFFFFFFFF
    ) -> int:
        """The number in a child; `default` if there is no such child, or it is empty.

        Raises:
            ConfigError: The text is no number or out of range, or the child is missing and there
                is no default.
        """
        child = self.need(tag) if default is None else self.find(tag)
        if child is None or (default is not None and not child.text):
            return 0 if default is None else default
        return child.number(low, high)

    def attribute(self, name: str, default: int = 0, low: int = 0, high: int = 0xFFFFFFFF) -> int:
        """The number in an attribute; `default` if there is no such attribute, or it is empty.

        Raises:
            ConfigError: The attribute is no number, or out of range.
        """
        text = self.attributes.get(name, "").strip()
        if not text:
            return default
        return self._number(text, f"{name} of <{self.tag}>", low, high)

    def flag(self, name: str) -> bool:
        """A boolean attribute; false if it is missing.

        Raises:
            ConfigError: The attribute is none of true, false, 1 and 0.
        """
        return self._flag(self.attributes.get(name, ""), f"{name} of <{self.tag}>")

    def flag_of(self, tag: str) -> bool:
        """The boolean in a child; false if there is no such child, or it is empty.

        Raises:
            ConfigError: The text is none of true, false, 1 and 0.
        """
        child = self.find(tag)
        return child is not None and child._flag(child.text, f"<{tag}>")

    def octets(self, most: int = 1 << 20) -> bytes:
        """The text as hexadecimal bytes.

        Raises:
            ConfigError: The text is not hexadecimal, or has more than `most` bytes.
        """
        try:
            data = bytes.fromhex(self.text)
        except ValueError:
            text = _short(self.text)
            self.fail(f"<{self.tag}> is '{text}': pairs of hexadecimal digits are allowed")
        if len(data) > most:
            self.fail(f"<{self.tag}> has {len(data)} bytes: at most {most} are allowed")
        return data

    def _flag(self, text: str, what: str) -> bool:
        word = text.strip().lower()
        if word not in ("", "0", "1", "true", "false"):
            self.fail(f"{what} is '{_short(word)}': true, false, 1 and 0 are allowed")
        return word in ("1", "true")

    def _number(self, text: str, what: str, low: int, high: int) -> int:
        digits = text.strip().lower()
        negative = digits.startswith("-")
        digits = digits.removeprefix("-")
        base = 16 if digits.startswith(("#x", "0x")) else 10
        try:
            if "_" in digits or not digits.isascii() or len(digits) > 40:
                raise ValueError
            value = int(digits[2:] if base == 16 else digits, base)
        except ValueError:
            self.fail(f"{what} is '{_short(text)}': a number such as 10 or #x0A is allowed")
        value = -value if negative else value
        if not low <= value <= high:
            self.fail(f"{what} is {text}: {low} to {high} are allowed")
        return value


def _short(text: str) -> str:
    return text if len(text) <= 40 else text[:37] + "..."


def read_xml(path: Path, wanted: Callable[[Element, int], bool]) -> Element:
    """Reads an XML file.

    Args:
        path: The file.
        wanted: Called with each new element and its depth (0 for the root); returns false if the
            element and everything in it is to be left out.

    Raises:
        ConfigError: The file cannot be read, is not well-formed or is beyond the limits.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ConfigError(f"{path}: the file has more than {MAX_BYTES >> 20} MiB")
        with path.open("rb") as file:
            return _Builder(str(path), wanted).read(iter(lambda: file.read(_CHUNK), b""))
    except OSError as error:
        raise ConfigError(f"cannot read '{path}': {error.strerror}") from error


class _Builder:
    """Builds the tree of elements while expat parses the file."""

    def __init__(self, path: str, wanted: Callable[[Element, int], bool]) -> None:
        self._path, self._wanted = path, wanted
        self._stack: list[Element] = []
        self._texts: list[list[str]] = []
        self._skipped = 0  # depth within an element that is left out
        self._count = 0
        self._root: Element | None = None
        self._parser = expat.ParserCreate()
        self._parser.buffer_text = True
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._text
        self._parser.StartDoctypeDeclHandler = self._doctype

    def read(self, chunks: Iterator[bytes]) -> Element:
        try:
            for chunk in chunks:
                self._parser.Parse(chunk, False)
            self._parser.Parse(b"", True)
        except expat.ExpatError as error:
            text = f"this is no XML: {expat.ErrorString(error.code)}; {_DAMAGED}"
            raise ConfigError(f"{self._path}:{error.lineno}: {text}") from None
        except (LookupError, ValueError) as error:  # errors of the encoding
            self._fail(f"this is no XML: {error}; {_DAMAGED}")
        assert self._root is not None
        return self._root

    def _fail(self, text: str) -> NoReturn:
        raise ConfigError(f"{self._path}:{self._parser.CurrentLineNumber}: {text}")

    def _doctype(self, *arguments: object) -> None:
        del arguments
        self._fail("a document type (<!DOCTYPE>) is not allowed: ESI and ENI files have none")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._count += 1
        depth = len(self._stack) + self._skipped
        if depth >= _MAX_DEPTH:
            self._fail(f"elements lie more than {_MAX_DEPTH} deep in each other")
        if self._count > _MAX_ELEMENTS:
            self._fail(f"the file has more than {_MAX_ELEMENTS} elements")
        if self._skipped:
            self._skipped += 1
            return
        element = Element(
            tag.rpartition(":")[2], self._path, self._parser.CurrentLineNumber, attributes
        )
        if not self._wanted(element, depth):
            self._skipped = 1
            return
        if self._stack:
            self._stack[-1].children.append(element)
        else:
            self._root = element
        self._stack.append(element)
        self._texts.append([])

    def _end(self, tag: str) -> None:
        del tag
        if self._skipped:
            self._skipped -= 1
            return
        self._stack.pop().text = "".join(self._texts.pop()).strip()

    def _text(self, text: str) -> None:
        if self._texts and not self._skipped:
            self._texts[-1].append(text)

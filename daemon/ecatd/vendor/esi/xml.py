"""Reads XML from untrusted sources, and keeps the line of each element.

What a file has beyond the limits (size, depth, number of elements) is refused, and so is a document
type with definitions (<!DOCTYPE x [...]>): ESI and ENI files need none, and it could define
entities that expand without end or read other files. `xml_text` decodes the bytes of a file, and
`findings` takes what is wrong in it and can be left out. `xml_references` knows `&ouml;`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat

from ecatd.base.errors import ConfigError
from ecatd.base.files import check_regular

from .findings import Findings, MalformedError
from .xml_references import References, as_written
from .xml_text import XmlText

MAX_BYTES = 128 << 20
_MAX_DEPTH = 64
_MAX_ELEMENTS = 2_000_000
_MAX_REFERENCES = 1_000_000
_DAMAGED = "the file may be damaged: get it again, or leave it out"
_YES, _NO = ("1", "true", "yes", "on"), ("", "0", "false", "no", "off")
_U32 = 0xFFFF_FFFF
LEFT_OUT = "it is left out"


@dataclass(slots=True)
class Element:
    """An XML element.

    Attributes:
        tag: Name without a namespace prefix.
        path: The file, for messages.
        line: Line of its start tag.
        findings: Takes what is wrong in the file and does not keep the rest from being used.
        attributes: Attributes.
        text: Text directly in the element, without surrounding white space.
        children: Elements directly in the element.
    """

    tag: str
    path: str
    line: int
    findings: Findings
    attributes: dict[str, str] = field(default_factory=dict)
    text: str = ""
    children: list[Element] = field(default_factory=list)

    def fail(self, text: str) -> NoReturn:
        """Says that this element is malformed.

        Raises:
            MalformedError: Always; the message begins with file and line.
        """
        raise MalformedError(self.path, self.line, text)

    def note(self, text: str, effect: str) -> None:
        """Says what is wrong with this element, and how it is used all the same."""
        self.findings.add(self.path, self.line, text, effect)

    @contextmanager
    def instead(self, effect: str = LEFT_OUT) -> Iterator[None]:
        """Ends the body at the first malformed element in it, and notes this with the effect."""
        try:
            yield
        except MalformedError as error:
            if self.findings.strict:
                raise
            self.findings.add(error.path, error.line, error.text, effect)

    def is_like(self, other: Element) -> bool:
        """Whether another element says the same, in another line."""
        return self is other or (
            (self.tag, self.attributes, self.text) == (other.tag, other.attributes, other.text)
            and len(self.children) == len(other.children)
            and all(map(Element.is_like, self.children, other.children))
        )

    def all(self, tag: str) -> Iterator[Element]:
        """Yields the children with this name; notes those that only look like it."""
        for child in self.children:
            if child.tag == tag:
                yield child
            elif len(child.tag) == len(tag) and child.tag.lower() == tag.lower():
                child.note(f"<{child.tag}> should be <{tag}>", LEFT_OUT)

    def find(self, *tags: str) -> Element | None:
        """Finds the child of the first name, its child of the second, and so on.

        If there are several, the first one counts, and others with other content are noted.
        """
        here: Element | None = self
        for tag in tags:
            here = here._first(tag) if here else None
        return here

    def _first(self, tag: str) -> Element | None:
        found = list(self.all(tag))
        for other in found[1:]:
            if not found[0].is_like(other):
                other.note(f"<{self.tag}> has another <{tag}> already", LEFT_OUT)
        return found[0] if found else None

    def has(self, tag: str) -> bool:
        """Whether there are children with this name."""
        return any(True for _ in self.all(tag))

    def need(self, tag: str) -> Element:
        """Returns the child with this name.

        Raises:
            MalformedError: There is no such child, or there are several with different texts.
        """
        return self._only(tag) or self.fail(f"<{self.tag}> has no <{tag}>")

    def _only(self, tag: str) -> Element | None:
        """The child with this name; None if there is none.

        Raises:
            MalformedError: There are several with different texts: nobody knows which counts.
        """
        found = list(self.all(tag))
        if not found:
            return None
        child = found[0]
        for other in found[1:]:
            if child.text != other.text:
                first, second = _short(child.text), _short(other.text)
                other.fail(f"<{self.tag}> has two <{tag}>, '{first}' and '{second}'")
        return child

    def text_of(self, *tags: str) -> str:
        """The text of the first such descendant (see `find`); empty if there is none."""
        here: Element | None = self
        for tag in tags:  # texts may be there in several languages
            here = next(here.all(tag), None) if here else None
        return here.text if here else ""

    def name(self, tag: str = "Name") -> str:
        """The text of <Name>, if there are several languages that in English (LcId 1033)."""
        names = list(self.all(tag))
        english = [name for name in names if name.given("LcId") == "1033"]
        return next((name.text for name in (*english, *names) if name.text), "")

    def number(self, low: int = 0, high: int = 0xFFFFFFFF) -> int:
        """The text as a number: decimal, or hexadecimal after #x or 0x.

        Raises:
            MalformedError: The text is no number, or out of range.
        """
        return self._number(self.text, f"<{self.tag}>", low, high)

    def number_of(
        self, tag: str, default: int | None = None, low: int = 0, high: int = 0xFFFFFFFF
    ) -> int:
        """The number in a child; `default` if there is no such child, or it is empty.

        Raises:
            MalformedError: The text is no number or out of range, or the child is missing and there
                is no default.
        """
        child = self.need(tag) if default is None else self._only(tag)
        if child is None or (default is not None and not child.text):
            return 0 if default is None else default
        return child.number(low, high)

    def number_or(self, tag: str, default: int, low: int = 0, high: int = 0xFFFFFFFF) -> int:
        """As `number_of`, but a malformed number is noted, and the default is used."""
        with self.instead(f"{default} is used"):
            return self.number_of(tag, default, low, high)
        return default

    def given(self, name: str, default: str = "") -> str:
        """The text of an attribute; `default` if there is none. One that looks like it is noted."""
        if name not in self.attributes:
            for other in self.attributes:
                if other.lower() == name.lower():
                    self.note(f"{other} of <{self.tag}> should be {name}", LEFT_OUT)
        return self.attributes.get(name, default)

    def attribute(self, name: str, default: int = 0, low: int = 0, high: int = 0xFFFFFFFF) -> int:
        """The number in an attribute; `default` if there is no such attribute, or it is empty.

        Raises:
            MalformedError: The attribute is no number, or out of range.
        """
        text = self.given(name).strip()
        if not text:
            return default
        return self._number(text, f"{name} of <{self.tag}>", low, high)

    def attribute_or(self, name: str, default: int, low: int = 0, high: int = 0xFFFFFFFF) -> int:
        """As `attribute`, but a malformed number is noted, and the default is used."""
        with self.instead(f"{default} is used"):
            return self.attribute(name, default, low, high)
        return default

    def switch(self, name: str, high: int) -> int:
        """As `attribute_or` with the default 0, but `true` and `false` are 1 and 0, too."""
        word = self.given(name).strip().lower()
        if word.isalpha() and word in _YES + _NO:
            return int(word in _YES)
        return self.attribute_or(name, 0, high=high)

    def flag(self, name: str) -> bool:
        """A boolean attribute; false if it is missing, or if it is none, which is noted."""
        return self._flag(self.given(name), f"{name} of <{self.tag}>")

    def flag_of(self, tag: str) -> bool:
        """The boolean in a child; false if there is no such child, or it is no boolean."""
        child = self.find(tag)
        return child is not None and child._flag(child.text, f"<{tag}>")

    def octets(self, most: int = 1 << 20) -> bytes:
        """The text as hexadecimal bytes.

        Raises:
            MalformedError: The text is not hexadecimal, or has more than `most` bytes.
        """
        digits = self.text.removeprefix("#x").removeprefix("0x").replace(",", " ")
        try:
            data = bytes.fromhex(digits)
        except ValueError:
            text = _short(self.text)
            self.fail(f"<{self.tag}> is '{text}': pairs of hexadecimal digits are allowed")
        if len(data) > most:
            self.fail(f"<{self.tag}> has {len(data)} bytes: at most {most} are allowed")
        return data

    def _flag(self, text: str, what: str) -> bool:
        word = text.strip().lower()
        if word not in _YES + _NO:
            self.note(
                f"{what} is '{_short(word)}': true, false, 1 and 0 are allowed", "it is false"
            )
        return word in _YES

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
        if (low, high) == (0, _U32) and -(1 << 31) <= value < 0:
            value += 1 << 32  # some tools write large numbers of 32 bits as negative ones
        if not low <= value <= high:
            self.fail(f"{what} is {text}: {low} to {high} are allowed")
        return value


def _short(text: str) -> str:
    return text if len(text) <= 40 else text[:37] + "..."


def read_xml(
    path: Path, wanted: Callable[[Element, int], bool], findings: Findings | None = None
) -> Element:
    """Reads an XML file.

    Args:
        path: The file.
        wanted: Called with each new element and its depth (0 for the root); returns false if the
            element and everything in it is to be left out.
        findings: Takes what is wrong with the file as a whole; also those of the elements.

    Raises:
        ConfigError: The file cannot be read, is not well-formed or is beyond the limits.
    """
    findings = Findings() if findings is None else findings
    try:
        if check_regular(path) > MAX_BYTES:
            raise ConfigError(f"{path}: the file has more than {MAX_BYTES >> 20} MiB")
        return _Builder(path, wanted, findings).read()
    except OSError as error:
        raise ConfigError(f"cannot read '{path}': {error.strerror}") from error


class _Builder:
    """Builds the tree of elements while expat parses the file."""

    def __init__(
        self, path: Path, wanted: Callable[[Element, int], bool], findings: Findings
    ) -> None:
        self._path, self._wanted, self._findings = str(path), wanted, findings
        self._text_of_file = XmlText(path, self._tell)
        self._stack: list[Element] = []
        self._texts: list[list[str]] = []
        self._cdata: list[str] | None = None
        self._references = References()
        self._skipped = 0  # depth within an element that is left out
        self._count = 0
        self._root: Element | None = None
        self._parser = expat.ParserCreate("utf-8")
        self._parser.buffer_text = True
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._text
        self._parser.StartCdataSectionHandler = self._cdata_begins
        self._parser.EndCdataSectionHandler = self._cdata_ends
        self._parser.StartDoctypeDeclHandler = self._doctype

    def read(self) -> Element:
        try:
            for chunk in self._references.hide(self._text_of_file.chunks()):
                if self._references.hidden > _MAX_REFERENCES:
                    self._fail(f"there are more than {_MAX_REFERENCES} faulty references with '&'")
                self._parser.Parse(chunk.encode(), False)
            self._parser.Parse(b"", True)
        except expat.ExpatError as error:
            line = error.lineno + self._text_of_file.first_line
            if self._root is None or self._stack:
                text = f"this is not XML: {expat.ErrorString(error.code)}; {_DAMAGED}"
                raise MalformedError(self._path, line, text) from None
            self._tell(line, f"something follows the end of <{self._root.tag}>", LEFT_OUT)
        assert self._root is not None
        self._references.note(self._tell)
        return self._root

    @property
    def _line(self) -> int:
        return self._parser.CurrentLineNumber + self._text_of_file.first_line

    def _tell(self, line: int, text: str, effect: str) -> None:
        self._findings.add(self._path, line, text, effect)

    def _fail(self, text: str) -> NoReturn:
        raise MalformedError(self._path, self._line, text)

    def _doctype(self, _name: str, _system: object, _public: object, definitions: bool) -> None:
        if definitions:
            self._fail("definitions in <!DOCTYPE> are not allowed: ESI and ENI files have none")

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
        name = tag.rpartition(":")[2]
        element = Element(name, self._path, self._line, self._findings, attributes)
        if not self._wanted(element, depth):
            self._skipped = 1
            return
        for key, text in attributes.items():
            attributes[key] = self._references.resolve(text, element.line)
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
        element, text = self._stack.pop(), "".join(self._texts.pop())
        element.text = self._references.resolve(text, element.line).strip()

    def _text(self, text: str) -> None:
        if self._cdata is not None:
            self._cdata.append(text)
        elif self._texts and not self._skipped:
            self._texts[-1].append(text)

    def _cdata_begins(self) -> None:
        self._cdata = []

    def _cdata_ends(self) -> None:
        text, self._cdata = as_written("".join(self._cdata or [])), None
        self._text(text)

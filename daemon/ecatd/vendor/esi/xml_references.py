"""Takes the references of XML files that XML itself does not define: `&ouml;`, or a bare `&`.

Vendors write texts as for a web page. XML knows five names (`&amp;` and the like) and numbers, and
its parser refuses a file with any other. So these are hidden from the parser, and come back in the
texts and attributes that are used: the names of HTML as their characters, all others as the file
has them. No definition of a file takes part in this, and nothing is expanded twice.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from html.entities import html5

from ecatd.base.sanitized_output import printable

_BEGIN, _END = "\ufdd0", "\ufdd1"
"""Around what follows the `&`. They are no characters (Unicode, chapter 23.7), and the text of a
file has none: `xml_text` leaves them out."""
_LONGEST = 64
_REFERENCE = re.compile(r"&(?:(#[0-9]{1,60}|#x[0-9a-fA-F]{1,60}|[^\W\d][\w.:-]{0,61});)?")
_HIDDEN = re.compile(f"{_BEGIN}([^{_END}]*){_END}")
_OF_XML = ("amp", "lt", "gt", "quot", "apos")
_SHOWN = 8

Tell = Callable[[int, str, str], None]
"""Takes what is wrong in a file: line, text, and how it is used."""


def as_written(text: str) -> str:
    """A text in which references mean nothing, as in CDATA: what was hidden in it comes back."""
    return _HIDDEN.sub(r"&\1", text)


class References:
    """The references of a file that XML does not define.

    Attributes:
        hidden: How many were hidden.
    """

    def __init__(self) -> None:
        self.hidden = 0
        self._html: dict[str, int] = {}  # each with the line where it is first used
        self._unknown: dict[str, int] = {}
        self._bare: dict[str, int] = {}

    def hide(self, parts: Iterable[str]) -> Iterator[str]:
        """Hides them in a text that comes in parts."""
        kept = ""
        for part in parts:
            text = kept + part
            at = text.rfind("&", max(0, len(text) - _LONGEST))
            end = len(text) if at < 0 or ";" in text[at:] else at  # the rest of it may follow
            kept = text[end:]
            yield self._hide(text[:end])
        yield self._hide(kept)

    def _hide(self, text: str) -> str:
        hidden = _REFERENCE.sub(_hidden, text)
        self.hidden += hidden.count(_BEGIN)
        return hidden

    def resolve(self, text: str, line: int) -> str:
        """The text that is meant.

        Args:
            text: A text or an attribute as the parser gives it.
            line: Where it is.
        """
        if _BEGIN not in text:
            return text
        return _HIDDEN.sub(lambda match: self._meant(match[1], line), text)

    def _meant(self, name: str, line: int) -> str:
        if name in html5:
            self._html.setdefault(f"&{name}", line)
            return html5[name]
        if name:
            self._unknown.setdefault(f"&{name}", line)
        else:
            self._bare.setdefault("&", line)
        return f"&{name}"

    def note(self, remark: Tell) -> None:
        """Tells what there was, each kind once."""
        if self._html:
            text = f"XML does not define {_listed(self._html)}, which are of HTML"
            remark(min(self._html.values()), text, "the characters that they mean are used")
        if self._unknown:
            text = f"nothing defines {_listed(self._unknown)}"
            remark(min(self._unknown.values()), text, "it is used as it is written")
        if self._bare:
            remark(min(self._bare.values()), "there is '&' in place of '&amp;'", "'&' is used")


def _hidden(match: re.Match[str]) -> str:
    name = match[1]
    if name and _is_of_xml(name):
        return match[0]
    return f"{_BEGIN}{name};{_END}" if name else _BEGIN + _END


def _is_of_xml(name: str) -> bool:
    if not name.startswith("#"):
        return name in _OF_XML
    code = int(name[2:], 16) if name.startswith("#x") else int(name[1:])
    if code < 0x20:
        return code in (0x09, 0x0A, 0x0D)
    if 0xD800 <= code < 0xE000 or 0xFDD0 <= code <= 0xFDEF or code in (0xFFFE, 0xFFFF):
        return False
    return code <= 0x10FFFF


def _listed(names: Iterable[str]) -> str:
    shown = sorted(names)
    more = len(shown) - _SHOWN
    text = ", ".join(f"'{printable(name)}'" for name in shown[:_SHOWN])
    return f"{text} and {more} more" if more > 0 else text

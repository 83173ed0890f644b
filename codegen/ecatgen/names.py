"""Makes Modelica identifiers from the texts that vendors write into their slaves.

Conventions of the Modelica Standard Library: classes begin with a capital letter, components with
a small one, words are joined in camel case. An underscore occurs only before a number: between two
numbers (`limit1_2`) and before the counter that keeps names unique (`EL3008_2`).
"""

from __future__ import annotations

import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Sequence
from functools import lru_cache

from ecatd.base.errors import UsageError

from .text import Code, identifier
from .words import WORDS

MAX_LENGTH = 48
"""Longest name made from a text, without the counter that may follow."""

FOREIGN_LIBRARIES = frozenset({"EtherCAT", "Modelica", "ModelicaServices", "Complex"})
"""Libraries that a generated library uses; it cannot have the name of one of them."""

FILES = frozenset(
    {"package", "Resources", "con", "prn", "aux", "nul"}
    | {f"{port}{n}" for port in ("com", "lpt") for n in range(1, 10)}
)
"""Names that no class can have, because its file name is taken already or forbidden in Windows."""

_LETTERS = str.maketrans(
    {"µ": "u", "μ": "u", "Ω": "Ohm", "°": " deg ", "%": " percent ", "ß": "ss"}
    | {"æ": "ae", "Æ": "Ae", "ø": "o", "Ø": "O", "ł": "l", "Ł": "L", "'": ""}
)


def library_name(name: str) -> Code:
    """Returns the name after checking that a Modelica library can have it.

    Raises:
        UsageError: The name is not a Modelica identifier, is too long, is a word of Modelica or C,
            or is the name of a library that the generated one uses.
    """
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) or len(name) > MAX_LENGTH:
        raise UsageError(
            f"'{name}' cannot be the name of a Modelica library: use letters, digits and _, a "
            f"letter first, at most {MAX_LENGTH} characters, for example TrollPlant"
        )
    if name in WORDS:
        raise UsageError(f"'{name}' is a word of the languages Modelica or C: choose another name")
    if name.casefold() in {library.casefold() for library in FOREIGN_LIBRARIES}:
        raise UsageError(f"'{name}' is the name of another Modelica library: choose another one")
    return identifier(name)


def class_name(text: str, fallback: str) -> str:
    """Returns a class name for a slave.

    The class name is the order number if the text begins with one, else all words of the text. The
    word EtherCAT is left out, since all slaves are EtherCAT slaves.

    Args:
        text: Name of the slave.
        fallback: Class name for texts without letters and digits.
    """
    first = _words(text.split(maxsplit=1)[0]) if text.strip() else []
    if first and re.fullmatch(r"[A-Za-z]+[0-9]+[A-Za-z0-9]*", first[0]):
        return _bounded(_join(_capital(word) for word in first))
    words = [_capital(w) for w in _even_case(_words(text)) if w.casefold() != "ethercat"]
    name = _bounded(_join(words))
    if not name:
        return fallback
    return name if name[0].isalpha() else "Slave" + name


@lru_cache(maxsize=4096)  # equal slaves have equal texts
def component_name(text: str, fallback: str = "") -> str:
    """Returns a component name; empty if neither text nor fallback has a letter or digit."""
    words = _even_case(_words(text)) or _words(fallback)
    if not words:
        return ""
    name = _bounded(_join([_small(words[0]), *map(_capital, words[1:])]))
    return name if name[0].isalpha() else "entry" + name


def instance_name(class_: str) -> str:
    """Returns the usual component name for a class: `el3008_2` for `EL3008_2`."""
    return _small(class_)


def connector_names(
    entries: Sequence[tuple[str, str, str]], reserved: Iterable[str] = ()
) -> list[Code]:
    """Makes names for the entries of one slave, which depend only on these entries.

    Args:
        entries: Name of the PDO, name of the entry, and a text for entries without any name.
        reserved: Names that the block uses for other things.

    The name of the entry is enough if it is unique in the slave and not reserved. Otherwise the
    name of the PDO comes before it: "Channel 1", "Input" gives `channel1Input`.
    """
    namespace = Namespace(reserved)
    short = [component_name(entry) for _, entry, _ in entries]
    seen = Counter(name.casefold() for name in short)
    return [
        namespace.take(
            name
            if name and seen[name.casefold()] == 1 and namespace.is_free(name)
            else component_name(f"{pdo} {entry}", fallback)
        )
        for name, (pdo, entry, fallback) in zip(short, entries, strict=True)
    ]


class Namespace:
    """The names of one scope. Upper and lower case are equal, as in many file systems.

    Args:
        reserved: Names that have another meaning in the scope. The words of Modelica and of C are
            always reserved, since both languages use the same names.
        suffix: The text that is added to a reserved name.
    """

    def __init__(self, reserved: Iterable[str] = (), suffix: str = "Entry") -> None:
        self._reserved = {name.casefold() for name in WORDS.union(reserved)}
        self._suffix = suffix
        self._taken: set[str] = set()
        self._counts: dict[str, int] = {}

    def is_free(self, name: str) -> bool:
        """Whether the name is neither reserved nor taken."""
        folded = name.casefold()
        return folded not in self._reserved and folded not in self._taken

    def take(self, name: str) -> Code:
        """Takes and returns the name; if it is not free, adds the suffix or a counter from 2 on."""
        if name.casefold() in self._reserved:
            name += self._suffix
        free, count = name, self._counts.get(name.casefold(), 1)
        while not self.is_free(free):
            count += 1
            free = f"{name}_{count}"
        self._counts[name.casefold()] = count
        self._taken.add(free.casefold())
        return identifier(free)


def _words(text: str) -> list[str]:
    plain = unicodedata.normalize("NFKD", text.translate(_LETTERS))
    plain = "".join(c for c in plain if not unicodedata.combining(c))
    return re.findall(r"[A-Za-z0-9]+", plain)


def _even_case(words: list[str]) -> list[str]:
    """Capitalizes words if all are in capitals and at least two of them consist of letters only."""
    if sum(word.isalpha() for word in words) > 1 and all(word.upper() == word for word in words):
        return [word.capitalize() for word in words]
    return words


def _small(word: str) -> str:
    """Makes the leading capitals of a word small, except a capital that begins the next word."""
    acronym = re.match(r"[A-Z]+(?![a-z])|[A-Z]", word)
    return word[: acronym.end()].lower() + word[acronym.end() :] if acronym else word


def _capital(word: str) -> str:
    return word[0].upper() + word[1:]


def _join(words: Iterable[str]) -> str:
    name = ""
    for word in words:
        name += "_" + word if name[-1:].isdigit() and word[:1].isdigit() else word
    return name


def _bounded(name: str) -> str:
    return name[:MAX_LENGTH].rstrip("_")

"""What a DBC file says, statement by statement: one that is wrong takes no other one with it."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from ..text import one_line
from .source import number, shown

_IGNORED = {
    *("BS_", "VERSION", "FILTER", "VAL_TABLE_", "SIG_GROUP_", "CAT_DEF_", "CAT_", "NS_DESC_"),
    *("EV_", "EV_DATA_", "ENVVAR_DATA_", "SGTYPE_", "SGTYPE_VAL_", "SIG_TYPE_REF_"),
    *("SIGTYPE_VALTYPE_", "BA_DEF_SGTYPE_", "BA_SGTYPE_", "BA_DEF_REL_", "BA_DEF_DEF_REL_"),
    *("BA_REL_", "BU_SG_REL_", "BU_EV_REL_", "BU_BO_REL_"),
}
_UNUSED = "VECTOR__INDEPENDENT_SIG_MSG"
"""Its signals belong to no message."""

CYCLE_TIME, FRAME_FORMAT = "GenMsgCycleTime", "VFrameFormat"
LONG_MESSAGE, LONG_SIGNAL = "SystemMessageLongSymbol", "SystemSignalLongSymbol"
LONG_NODE = "SystemNodeLongSymbol"
_USED = {CYCLE_TIME, FRAME_FORMAT, LONG_MESSAGE, LONG_SIGNAL, LONG_NODE}
"""Attributes that count here."""

NOBODY = "Vector__XXX"
"""The node that is none."""

_ALL = 20
"""Most statements that are named one by one if they cannot be understood."""

_NUMBER = r"([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?)"
_MESSAGE = re.compile(r"([0-9]{1,10})\s+(\w+)\s*:\s*([0-9]{1,6})(?:\s+(\w+))?")
_HEAD = re.compile(r"(\w+)(?:\s+(M|m[0-9]{1,10}M?))?\s*:")
_SIGNAL = re.compile(
    r"\s*([0-9]{1,10})\s*\|\s*([0-9]{1,10})\s*@\s*([01])\s*([-+])"
    rf"\s*\(\s*{_NUMBER}\s*,\s*{_NUMBER}\s*\)"
    r'\s*\[([^]|]*)\|([^]|]*)\]\s*""([\w\s,]*)'
)
_TYPE = re.compile(r"([0-9]{1,10})\s+(\w+)\s*:?\s*([0-9]{1,3})")
_CONDITION = re.compile(r"([0-9]{1,10})\s+(\w+)\s+(\w+)\s+([-0-9\s,]+)")
_RANGE = re.compile(r"\s*([0-9]{1,10})\s*-\s*([0-9]{1,10})\s*")
_SENDERS = re.compile(r"([0-9]{1,10})\s*:([\w\s,]*)")
_VALUES = re.compile(r'([0-9]{1,10})\s+(\w+)(?:\s([-+0-9.\s"]*))?')
_COMMENT = re.compile(r'(?:BO_\s+([0-9]{1,10})|SG_\s+([0-9]{1,10})\s+(\w+))\s*""')
_DEFINITION = re.compile(r'(?:BO_|SG_|BU_|EV_)?\s*""\s*(\w+)[^a-zA-Z]*')
_DEFAULT = re.compile(rf'""\s*(?:""|{_NUMBER})')
_ATTRIBUTE = re.compile(
    r'""\s*(?:BO_\s+([0-9]{1,10})|SG_\s+([0-9]{1,10})\s+(\w+)|BU_\s+(\w+))'
    rf'\s*(?:""|{_NUMBER})'
)

Key = tuple[int, str]
"""Number of a message, as it is in the file, and the name of a signal or an empty text."""


@dataclass(slots=True)
class Signal:
    """A signal, as it is in the file.

    Attributes:
        name: Its name.
        mark: `M` of a multiplexer, `m3` or `m3M` of what is multiplexed, else empty.
        start: Start bit.
        length: Bits.
        big_endian: Whether it is.
        signed: Whether it is.
        scale: The factor.
        offset: The offset.
        limits: Texts of minimum and maximum.
        unit: Its unit.
        receivers: Names of nodes.
    """

    name: str
    mark: str
    start: int
    length: int
    big_endian: bool
    signed: bool
    scale: float
    offset: float
    limits: tuple[str, str]
    unit: str
    receivers: list[str]


@dataclass(slots=True)
class Message:
    """A message, as it is in the file.

    Attributes:
        number: Its identifier, with bit 31 if that has 29 bits.
        name: Its name.
        length: Bytes of data.
        senders: Names of nodes.
        signals: Its signals.
        is_whole: Whether all of its signals that can be multiplexers were understood.
    """

    number: int
    name: str
    length: int
    senders: list[str]
    signals: list[Signal] = field(default_factory=list)
    is_whole: bool = True


@dataclass(slots=True)
class _Statement:
    """A statement.

    Attributes:
        keyword: Its first word.
        line: Number of the line where it begins.
        pieces: What follows; instead of each text in quotes, only the quotes.
        texts: These texts.
    """

    keyword: str
    line: int
    pieces: list[str] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)

    @property
    def code(self) -> str:
        code = " ".join("".join(self.pieces).split())
        return code.removeprefix(":").rstrip("; ").lstrip()


class Dbc:
    """A DBC file.

    Attributes:
        nodes: Names of the nodes.
        messages: The messages.
        comments: Comments of messages and signals.
        values: Names of the values of signals.
        types: Kinds of the numbers of signals, where they are no integers: 1 or 2.
        conditions: Multiplexers of signals, each with ranges of its values.
        left_out: A sentence for each statement that cannot be understood.
    """

    def __init__(self, text: str) -> None:
        self.nodes: list[str] = []
        self.messages: list[Message] = []
        self.comments: dict[Key, str] = {}
        self.values: dict[Key, dict[int, str]] = defaultdict(dict)
        self.types: dict[Key, int] = {}
        self.conditions: dict[Key, list[tuple[str, list[tuple[int, int]]]]] = defaultdict(list)
        self.left_out: list[str] = []
        self._senders: dict[int, list[str]] = defaultdict(list)
        self._choices: dict[str, list[str]] = {}
        self._defaults: dict[str, str] = {}
        self._attributes: dict[tuple[str, int | str, str], str] = {}
        self._lines: dict[Key, tuple[str, int]] = {}
        self._unused = Message(0, _UNUSED, 0, [])
        self._current: Message | None = None
        for statement in _statements(text):
            self._read(statement)
        self._finish()

    def attribute(self, name: str, of: int | str, signal: str = "") -> str:
        """An attribute of a message, a signal or a node; its default, or empty, if it has none."""
        value = self._attributes.get((name, of, signal), self._defaults.get(name, ""))
        choices = self._choices.get(name)
        if choices and value.isdecimal() and len(value) < 4 and int(value) < len(choices):
            return choices[int(value)]
        return value

    def _read(self, statement: _Statement) -> None:
        read = _READERS.get(statement.keyword)
        if statement.keyword in _IGNORED or (read and read(self, statement.code, statement)):
            return
        said = shown(f"{statement.keyword} {statement.code}")
        message = self._current if statement.keyword == "SG_" else None
        where = f" (message {message.name})" if message else ""
        if said:
            self._leave_out(f"line {statement.line}{where}: '{said}' cannot be understood")

    def _leave_out(self, sentence: str) -> None:
        self.left_out.append(one_line(sentence))

    def _finish(self) -> None:
        known = {
            (message.number, signal.name)
            for message in (*self.messages, self._unused)
            for signal in message.signals
        }
        for key, (keyword, line) in self._lines.items():
            if key not in known:
                signal = f"signal {shown(key[1])} of message {key[0]}"
                self._leave_out(f"line {line}: {keyword} is about {signal}, which is not there")
        more = len(self.left_out) - _ALL
        if more > 0:
            self.left_out[_ALL:] = [f"{more} more statements cannot be understood"]
        for message in self.messages:
            message.senders += self._senders.get(message.number, [])

    # Readers of statements: each returns whether it has understood its one.

    def _message(self, code: str, _: _Statement) -> bool:
        found = _MESSAGE.fullmatch(code)
        self._current = None  # signals that follow do not belong to the one before
        if found is None:
            return False
        sender = found[4] or NOBODY
        self._current = Message(
            int(found[1]), found[2], int(found[3]), [] if sender == NOBODY else [sender]
        )
        if self._current.name == _UNUSED:
            self._unused = self._current
        else:
            self.messages.append(self._current)
        return True

    def _signal(self, code: str, statement: _Statement) -> bool:
        head = _HEAD.match(code)
        found = _SIGNAL.fullmatch(code, head.end()) if head else None
        scale, offset = (number(found[5]), number(found[6])) if found else (None, None)
        message = self._current
        if message is None:
            return False
        if head is None or found is None or scale is None or offset is None:
            if head is None or (head[2] or "").endswith("M"):
                message.is_whole = False
            return False
        message.signals.append(
            Signal(
                name=head[1],
                mark=head[2] or "",
                start=int(found[1]),
                length=int(found[2]),
                big_endian=found[3] == "0",
                signed=found[4] == "-",
                scale=scale,
                offset=offset,
                limits=(found[7], found[8]),
                unit=statement.texts[0],
                receivers=_nodes(found[9]),
            )
        )
        return True

    def _node_names(self, code: str, _: _Statement) -> bool:
        self.nodes = list(dict.fromkeys((*self.nodes, *_nodes(code))))
        return re.fullmatch(r"[\w\s,]*", code) is not None

    def _more_senders(self, code: str, _: _Statement) -> bool:
        found = _SENDERS.fullmatch(code)
        if found is not None:
            self._senders[int(found[1])] += _nodes(found[2])
        return found is not None

    def _comment(self, code: str, statement: _Statement) -> bool:
        found = _COMMENT.fullmatch(code)
        if found is not None:
            self.comments[int(found[1] or found[2]), found[3] or ""] = statement.texts[0]
        return True  # others are about nodes and the like

    def _named_values(self, code: str, statement: _Statement) -> bool:
        found = _VALUES.fullmatch(code)
        if found is None:
            return re.match(r"[A-Za-z_]", code) is not None  # those of environment variables
        numbers = (found[3] or "").replace('""', " ").split()
        if len(numbers) != len(statement.texts) or not all(map(_WHOLE.fullmatch, numbers)):
            return False
        key = int(found[1]), found[2]
        self._lines.setdefault(key, (statement.keyword, statement.line))
        self.values[key] |= dict(zip(map(int, numbers), statement.texts, strict=True))
        return True

    def _type(self, code: str, statement: _Statement) -> bool:
        found = _TYPE.fullmatch(code)
        if found is not None:
            key = int(found[1]), found[2]
            self._lines.setdefault(key, (statement.keyword, statement.line))
            self.types[key] = int(found[3])
        return found is not None

    def _condition(self, code: str, statement: _Statement) -> bool:
        found = _CONDITION.fullmatch(code)
        ranges = [_RANGE.fullmatch(part) for part in found[4].split(",")] if found else [None]
        if found is None or None in ranges:
            return False
        key = int(found[1]), found[2]
        self._lines.setdefault(key, (statement.keyword, statement.line))
        self.conditions[key].append(
            (found[3], [(int(part[1]), int(part[2])) for part in ranges if part])
        )
        return True

    def _definition(self, code: str, statement: _Statement) -> bool:
        found = _DEFINITION.match(code)
        if found is not None and found[1] == "ENUM":
            self._choices[statement.texts[0]] = statement.texts[1:]
        return True

    def _default(self, code: str, statement: _Statement) -> bool:
        found = _DEFAULT.fullmatch(code)
        if found is not None:
            self._defaults[statement.texts[0]] = found[1] or statement.texts[-1]
        return found is not None

    def _attribute(self, code: str, statement: _Statement) -> bool:
        found = _ATTRIBUTE.fullmatch(code)
        if found is not None:
            owner = int(found[1] or found[2]) if found[1] or found[2] else found[4]
            value = found[5] or statement.texts[-1]
            self._attributes[statement.texts[0], owner, found[3] or ""] = value
            return True
        return statement.texts[:1] != [] and statement.texts[0] not in _USED  # or of the whole bus


_WHOLE = re.compile(r"[-+]?[0-9]{1,20}")
_READERS: dict[str, Callable[[Dbc, str, _Statement], bool]] = {
    "BU_": Dbc._node_names,
    "BO_": Dbc._message,
    "SG_": Dbc._signal,
    "BO_TX_BU_": Dbc._more_senders,
    "CM_": Dbc._comment,
    "VAL_": Dbc._named_values,
    "SIG_VALTYPE_": Dbc._type,
    "SG_MUL_VAL_": Dbc._condition,
    "BA_DEF_": Dbc._definition,
    "BA_DEF_DEF_": Dbc._default,
    "BA_": Dbc._attribute,
}
_WORDS = "|".join(sorted({*_READERS, *_IGNORED, "NS_"}, reverse=True))
_PIECE = re.compile(rf'"|//|(?:^|(?<=;))[ \t]*({_WORDS})(?![^\s:;"])', re.MULTILINE)


def _statements(text: str) -> Iterator[_Statement]:
    """Yields the statements; one begins at its first word, which begins a line or follows `;`."""
    current, line, counted, at = _Statement("", 1), 1, 0, 0
    while (found := _PIECE.search(text, at)) is not None:
        current.pieces.append(text[at : found.start()])
        at = found.end()
        if found[0] == '"':
            end = _end_of_text(text, at)
            current.pieces.append('""' if end < len(text) else '"')
            current.texts.append(text[at:end].replace('\\"', '"'))
            at = end + 1
        elif found[0] == "//":
            end = text.find("\n", at)
            at = end if end >= 0 else len(text)
        else:
            line += text.count("\n", counted, found.start(1))
            counted = found.start(1)
            begun = _Statement(found[1], line)
            if current.keyword == "NS_" and not _has_words(text, at):
                continue  # it is in the list of all words
            if current.keyword != "NS_":
                yield current
            current = begun
    current.pieces.append(text[at:])
    if current.keyword != "NS_":
        yield current


def _has_words(text: str, at: int) -> bool:
    """Whether anything follows on the line."""
    end = text.find("\n", at)
    return bool(text[at : end if end >= 0 else len(text)].strip())


def _end_of_text(text: str, at: int) -> int:
    """The place of the quotes that end a text; the end of everything if there are none."""
    end = text.find('"', at)
    while end > at and text[end - 1] == "\\":
        end = text.find('"', end + 1)
    return end if end >= 0 else len(text)


def _nodes(text: str) -> list[str]:
    return [name for name in re.split(r"[\s,]+", text) if name and name != NOBODY]

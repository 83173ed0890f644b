"""Requests as Zenoh queries: which fields are in the key, in the parameters and in the payload.

`requests/` says for each kind of request which fields are in its key. If everybody who may read may
make a request, its other fields are parameters of the query, as in `…?complete=1`. If it needs a
right, as every change does, they are the payload, a map. Gateway and clients both use this module,
so that they agree.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple
from urllib.parse import quote, unquote

from ecatd.base.addresses import INDEX_MOST, REGISTER_MOST, SUBINDEX_MOST, parse_number
from ecatd.base.errors import UsageError

from .operation import Request
from .parsing import KINDS, parse_request

ALL = "all"
"""In the key: all slaves."""
RIGHT_NAMES = tuple(
    dict.fromkeys(kind.key.split("/")[1] for kind in KINDS.values() if kind.key.startswith("rw/"))
)
"""Kinds of requests that need a right, as `gateway.user.write` names them: `state`, `sdo`, ..."""
_TRUE, _FALSE = ("1", "true"), ("0", "false")
_BEGIN_OF_NUMBER = frozenset("-0123456789")
_ADDRESSES = {"index": INDEX_MOST, "subindex": SUBINDEX_MOST, "address": REGISTER_MOST}
"""Fields that are addresses, with the largest of them."""


class Query(NamedTuple):
    """A request as a query.

    Attributes:
        key: The parts of the key below the bus. Names of slaves are percent-encoded.
        parameters: The text behind the `?` of a selector; may be empty.
        payload: The other fields of a request that needs a right, else None.
    """

    key: tuple[str, ...]
    parameters: str
    payload: dict[str, Any] | None


class _Template(NamedTuple):
    """What stands where in the query of one kind of request.

    Attributes:
        key: For each part of the key: its text, and the field that takes its place, or "".
        others: The fields that are not in the key.
    """

    key: tuple[tuple[str, str], ...]
    others: tuple[str, ...]

    @classmethod
    def of(cls, kind: type[Request]) -> _Template:
        parts = kind.key.split("/")
        key = tuple((part, part[1:-1] if part.startswith("{") else "") for part in parts)
        in_key = {field for _, field in key}
        return cls(key, tuple(name for name in kind.fields if name not in in_key))


_TEMPLATES = {kind.op: _Template.of(kind) for kind in KINDS.values()}
_BY_BEGIN: dict[tuple[str, ...], list[tuple[type[Request], _Template]]] = {}
"""The kinds of requests by the first two parts of their keys, which are never fields."""
for _kind in KINDS.values():
    _BY_BEGIN.setdefault(tuple(_kind.key.split("/")[:2]), []).append((_kind, _TEMPLATES[_kind.op]))


def needs_right(kind: type[Request]) -> bool:
    """Whether requests of this kind need a right: all that change something do."""
    return kind.key.startswith("rw/")


def to_query(request: Request) -> Query:
    """Makes a query of a request. Fields that are None are left out.

    Raises:
        UsageError: A field in the key is empty.
    """
    template = _TEMPLATES[request.op]
    key = tuple(
        [
            _to_text(field, getattr(request, field)) if field else text
            for text, field in template.key
        ]
    )
    others = {
        name: value for name in template.others if (value := getattr(request, name)) is not None
    }
    if needs_right(type(request)):
        return Query(key, "", others)
    texts = [f"{name}={_to_text(name, value)}" for name, value in others.items() if value]
    return Query(key, ";".join(texts), None)


def from_query(key: Sequence[str], parameters: str, payload: Mapping[str, Any]) -> Request:
    """Makes a request of a query, and checks it.

    Args:
        key: As in `Query`.
        parameters: As in `Query`.
        payload: As in `Query`; empty if there is none.

    Raises:
        UsageError: No request has this key, or a field is wrong.
    """
    kind = _kind_of(key)
    fields = kind.fields
    values: dict[str, Any] = dict(payload)
    if not needs_right(kind) and values:
        raise UsageError(f"'{'/'.join(key)}' takes parameters and no payload")
    if "op" in values:
        raise UsageError("'op' belongs in the key, not in the payload")
    template = _TEMPLATES[kind.op]
    known = () if needs_right(kind) else template.others
    for name, text in read_parameters(parameters, known).items():
        values[name] = _from_text(name, text, fields[name].types, "the query")
    for (_, name), text in zip(template.key, key, strict=True):
        if name:
            if name in values:
                raise UsageError(f"'{name}' belongs in the key, not in the payload")
            values[name] = _from_text(name, text, fields[name].types, "the key")
    return parse_request({**values, "op": kind.op})


def read_parameters(parameters: str, known: Sequence[str]) -> dict[str, str]:
    """Splits the parameters of a query.

    Raises:
        UsageError: One of them is not in `known`.
    """
    found = {}
    for item in filter(None, parameters.split(";")):
        name, _, value = item.partition("=")
        if name not in known:
            raise UsageError(
                f"'{name}' is not a parameter of this query: use {', '.join(known) or 'none'}"
            )
        found[name] = value
    return found


def read_flag(name: str, text: str) -> bool:
    """A parameter that is true or false.

    Raises:
        UsageError: It is neither of them.
    """
    if text not in _TRUE and text not in _FALSE:
        raise UsageError(f"'{name}={text}' in the query: use {name}=1 or {name}=0")
    return text in _TRUE


def _kind_of(key: Sequence[str]) -> type[Request]:
    for kind, template in _BY_BEGIN.get(tuple(key[:2]), ()):
        if len(template.key) == len(key) and all(
            field or part == text for (part, field), text in zip(template.key, key, strict=True)
        ):
            return kind
    raise UsageError(f"'{'/'.join(key)}' is not a key of this version")


def _to_text(name: str, value: Any) -> str:
    if value is None:
        return ALL
    if isinstance(value, bool):
        return "1" if value else "0"
    if name in _ADDRESSES:
        return f"0x{value:0{len(f'{_ADDRESSES[name]:X}')}X}"
    if isinstance(value, int):
        return str(value)
    if not value:
        raise UsageError(f"'{name}' is empty: give a name or a number")
    if value == ALL or value[0] in _BEGIN_OF_NUMBER:  # a name, which must not read as anything else
        return f"%{ord(value[0]):02X}{quote(value[1:], safe='')}"
    return quote(value, safe="")


def _from_text(name: str, text: str, types: frozenset[str], where: str) -> Any:
    if "bool" in types:
        return read_flag(name, text)
    if "None" in types and text == ALL:
        return None
    if name in _ADDRESSES:
        return parse_number(text, name, _ADDRESSES[name])
    if "int" in types:
        with suppress(ValueError):
            return int(text, 0)
        if "str" not in types:
            raise UsageError(f"{text[:40]!r} in {where} is not a valid {name}")
    return unquote(text)

"""Operations as Zenoh queries: which fields are in the key, in the parameters and in the payload.

The class of an operation says which fields are in its key. If everybody who may read may ask it,
its other fields are parameters of the query, as in `…?complete=1`. If it needs a right, as every
change does, they are the payload, a map. Gateway and clients both use this module, so they agree.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from typing import Any, NamedTuple
from urllib.parse import quote, unquote

from ecatd.base.addresses import parse_number
from ecatd.base.errors import UsageError

from .fields import Field, Limits, Verbatim
from .operation import Operation, needs_right

ALL = "all"
"""In the key: all slaves."""
_TRUE, _FALSE = ("1", "true"), ("0", "false")
_BEGIN_OF_NUMBER = frozenset("-0123456789")


class Query(NamedTuple):
    """An operation as a query."""

    #: The parts of the key below the bus. Names of slaves are percent-encoded.
    key: tuple[str, ...]
    parameters: str  #: The text behind the `?` of a selector; may be empty.
    #: The other fields of an operation that needs a right, else None.
    payload: dict[str, Any] | None


class _Template(NamedTuple):
    """What stands where in the query of one kind of operation."""

    #: For each part of the key: its text, and the field that takes its place, or "".
    key: tuple[tuple[str, str], ...]
    others: tuple[str, ...]  #: The fields that are not in the key.


_templates: dict[str, _Template] = {}


def _template(kind: type[Operation[Any]]) -> _Template:
    if kind.op not in _templates:
        _templates[kind.op] = _make_template(kind)
    return _templates[kind.op]


def _make_template(kind: type[Operation[Any]]) -> _Template:
    parts = kind.key.split("/")
    key = tuple((part, part[1:-1] if part.startswith("{") else "") for part in parts)
    in_key = {field for _, field in key}
    return _Template(key, tuple(name for name in kind.fields if name not in in_key))


@cache
def _by_begin() -> dict[tuple[str, ...], list[type[Operation[Any]]]]:
    """The operations by the first parts of their keys: two, or one if the second is a field."""
    from .catalog import OPERATIONS  # a client needs only its own operation

    found: dict[tuple[str, ...], list[type[Operation[Any]]]] = {}
    for kind in OPERATIONS.values():
        begin = kind.key.partition("/{")[0].split("/")[:2]
        found.setdefault(tuple(begin), []).append(kind)
    return found


def to_query(operation: Operation[Any]) -> Query:
    """Makes a query of an operation, without fields that are None or as by default.

    Raises:
        UsageError: A field in the key is empty.
    """
    kind = type(operation)
    template, fields = _template(kind), kind.fields
    key = tuple(
        [
            _to_text(field, getattr(operation, field), fields[field]) if field else text
            for text, field in template.key
        ]
    )
    others = {
        name: value for name in template.others if (value := getattr(operation, name)) is not None
    }
    if needs_right(kind):
        return Query(key, "", others)
    texts = [
        f"{name}={_to_text(name, value, fields[name])}"
        for name, value in others.items()
        if name in kind.needed or value != getattr(kind, name)
    ]
    return Query(key, ";".join(texts), None)


def from_query(key: Sequence[str], parameters: str, payload: Mapping[str, Any]) -> Operation[Any]:
    """Makes an operation of a query, and checks it.

    Args:
        key: As in `Query`.
        parameters: As in `Query`.
        payload: As in `Query`; empty if there is none.

    Raises:
        UsageError: No operation has this key, or a field is wrong.
    """
    from .catalog import parse

    kind = find_kind(key)
    fields = kind.fields
    values: dict[str, Any] = dict(payload)
    if not needs_right(kind) and values:
        raise UsageError(f"'{'/'.join(key)}' takes parameters and no payload")
    if "op" in values:
        raise UsageError("'op' belongs in the key, not in the payload")
    template = _template(kind)
    known = () if needs_right(kind) else template.others
    for name, text in _parameters(parameters, known).items():
        values[name] = _from_text(name, text, fields[name], "the query")
    for (_, name), text in zip(template.key, key, strict=True):
        if name:
            if name in values:
                raise UsageError(f"'{name}' belongs in the key, not in the payload")
            values[name] = _from_text(name, text, fields[name], "the key")
    return parse({**values, "op": kind.op})


def _parameters(parameters: str, known: Sequence[str]) -> dict[str, str]:
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


def find_kind(key: Sequence[str]) -> type[Operation[Any]]:
    """The kind of operation that has a key, given by its parts below the bus.

    Raises:
        UsageError: No operation has this key.
    """
    known = _by_begin()
    for kind in known.get(tuple(key[:2]), known.get(tuple(key[:1]), [])):
        parts = _template(kind).key
        if len(parts) == len(key) and all(
            field or part == text for (part, field), text in zip(parts, key, strict=True)
        ):
            return kind
    raise UsageError(f"'{'/'.join(key)}' is not a key of this version")


def _to_text(name: str, value: Any, field: Field) -> str:
    if value is None:
        return ALL
    if isinstance(value, bool):
        return "1" if value else "0"
    if digits := field.address_digits:
        return f"0x{value:0{digits}X}"
    if isinstance(value, int | float):
        return f"{value:.15g}" if isinstance(value, float) else str(value)
    if isinstance(field.rule, Verbatim):
        return str(value)
    if not value:
        raise UsageError(f"'{name}' is empty: give a name or a number")
    if value == ALL or value[0] in _BEGIN_OF_NUMBER:  # a name, which must not read as anything else
        return f"%{ord(value[0]):02X}{quote(value[1:], safe='')}"
    return quote(value, safe="")


def _from_text(name: str, text: str, field: Field, where: str) -> Any:
    types, rule = field.types, field.rule
    if "bool" in types:
        if text not in _TRUE and text not in _FALSE:
            raise UsageError(f"'{name}={text}' in {where}: use {name}=1 or {name}=0")
        return text in _TRUE
    if "None" in types and text == ALL:
        return None
    if isinstance(rule, Limits) and rule.is_address:
        return parse_number(text, name, rule.greatest)
    if "float" in types:
        with suppress(ValueError):
            return float(text)
        raise UsageError(f"{name}={text[:40]} in {where} is not a number")
    if "int" in types:
        with suppress(ValueError):
            return int(text, 0)
        if "str" not in types:
            raise UsageError(f"{text[:40]!r} in {where} is not a valid {name}")
    return text if isinstance(rule, Verbatim) else unquote(text)

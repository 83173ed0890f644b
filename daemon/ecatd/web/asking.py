"""What a page asks: one query of docs/zenoh-keys.md, checked before anything is asked."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from ecatd.base.errors import NotPermittedError, UsageError
from ecatd.client.identity import who
from ecatd.operations.operation import Operation, needs_right, on_behalf, right_of
from ecatd.operations.query import find_kind, from_query

_AS_BATCHES = ("trace", "history", "stream")
"""Operations whose values pages get in batches."""


def to_operation(
    key: str, parameters: Mapping[str, Any], payload: Mapping[str, Any], may: Collection[str]
) -> Operation[Any]:
    """Makes an operation of a query of a page.

    Args:
        key: As docs/zenoh-keys.md has it, from `ro` or `rw` on.
        parameters: Its parameters.
        payload: Its payload; bytes are hex strings.
        may: The rights of pages.

    Raises:
        UsageError: It is no such query.
        NotPermittedError: Pages have no right to it.
    """
    parts = key.split("/")
    kind = find_kind(parts)
    if kind.op in _AS_BATCHES or not kind.key.startswith(("ro/", "rw/")):
        raise UsageError(f"'{key}' is not for pages: ask for values with a message 'trace'")
    if needs_right(kind) and right_of(kind) not in may:
        right = right_of(kind)
        raise NotPermittedError(
            f"this page may not use the right '{right}': start `ecatctl web` with --allow {right}"
        )
    values = dict(payload)
    values.pop("id", None)
    for name, field in kind.fields.items():
        value = values.get(name)
        if "bytes" in field.types and isinstance(value, str):
            try:
                values[name] = bytes.fromhex(value)
            except ValueError:
                raise UsageError(f"'{name}' must be bytes as a hex string") from None
    texts = ";".join(f"{name}={_text(value)}" for name, value in parameters.items())
    # So the log and the audit tell what a person did in the browser from what a program did.
    return on_behalf(from_query(parts, texts, values), who(), "web page")


def _text(value: Any) -> str:
    return str(int(value)) if isinstance(value, bool) else str(value)

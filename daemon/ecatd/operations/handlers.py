"""Which method carries an operation out.

`handles` marks the method, and type checkers see that it returns the answer of its operation.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from inspect import isawaitable
from typing import Any, TypeVar

from ecatd.base.errors import UsageError

from .operation import Operation

A = TypeVar("A")
Op = TypeVar("Op", bound=Operation[Any])
S = TypeVar("S")

_MARK = "handles"


def handles(
    kind: type[Operation[A]],
) -> Callable[[Callable[[S, Op], A | Awaitable[A]]], Callable[[S, Op], A | Awaitable[A]]]:
    """Marks a method that carries out operations of a kind, at once or asynchronously."""

    def mark(
        method: Callable[[S, Op], A | Awaitable[A]],
    ) -> Callable[[S, Op], A | Awaitable[A]]:
        setattr(method, _MARK, kind)
        return method

    return mark


class Handlers:
    """The handlers of all operations that a process carries out.

    Args:
        owners: The objects whose methods are marked.
    """

    def __init__(self, *owners: object) -> None:
        self._methods: dict[type[Operation[Any]], Callable[[Any], Any]] = {
            kind: getattr(owner, name)
            for owner in owners
            for name, method in vars(type(owner)).items()
            if (kind := getattr(method, _MARK, None)) is not None
        }

    def __contains__(self, kind: type[Operation[Any]]) -> bool:
        return kind in self._methods

    async def answer(self, operation: Operation[A]) -> A:
        """Carries an operation out.

        Raises:
            UsageError: Nobody here does so.
            EcatError: As its handler.
        """
        method = self._methods.get(type(operation))
        if method is None:
            raise UsageError(f"this process cannot answer {operation.op}")
        found = method(operation)
        answer: A = await found if isawaitable(found) else found
        return answer

"""Carries out a change once, also if it arrives twice.

A client that gets no answer may ask again with the same `id`. The bus server keeps the answers, and
not the gateway, so that this holds also if another gateway has been started meanwhile.
"""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Callable, Coroutine
from typing import Any

KEPT = 256
"""Answers that are kept for each user. Those that are still to come are kept beyond that."""

Answer = asyncio.Task[dict[str, Any]]


class Once:
    """The answers to changes, by user and `id`."""

    def __init__(self) -> None:
        self._answers: dict[str, OrderedDict[str, Answer]] = {}

    async def answer(
        self,
        user: str,
        identity: str,
        carry_out: Callable[[], Coroutine[Any, Any, dict[str, Any]]],
    ) -> dict[str, Any]:
        """Returns the answer to a change, which is carried out if it has not come before.

        Args:
            user: Whose change it is.
            identity: Its `id`.
            carry_out: Carries it out.

        Raises:
            EcatError: The change was refused or has failed, now or before.
        """
        answers = self._answers.setdefault(user, OrderedDict())
        if identity not in answers:
            answers[identity] = task = asyncio.create_task(carry_out())
            task.add_done_callback(_note_error)
            self._forget(answers)
        # A client that goes away ends only its waiting.
        return await asyncio.shield(answers[identity])

    def close(self) -> None:
        """Ends all changes that are under way."""
        for answers in self._answers.values():
            for task in answers.values():
                task.cancel()

    @staticmethod
    def _forget(answers: OrderedDict[str, Answer]) -> None:
        """Forgets the oldest answers of a user, but none that is still to come."""
        done = [identity for identity, task in answers.items() if task.done()]
        for identity in done[: max(0, len(answers) - KEPT)]:
            del answers[identity]


def _note_error(task: Answer) -> None:
    """Takes note of an error that nobody waits for any more; asyncio would complain of it."""
    if not task.cancelled():
        task.exception()

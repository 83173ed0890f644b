"""Runs conversations with many slaves at the same time.

A slave takes a message, works on it, and answers later, so asking one slave after the other would
be slow. Here each slave has its own conversation: a generator that yields the next accesses to the
memory of the slave. Each round collects the accesses of all conversations, and packs them into as
few frames as possible. Accesses that belong together, such as a write of a message and a read of
the sync managers after it, share a frame.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Generator, Sequence
from typing import TypeAlias, TypeVar

from ecatd.base.coroutine_steps import Steps, finish
from ecatd.base.errors import EcatError, StateError

from ..frames.datagrams import Answer, Datagram, Datagrams

T = TypeVar("T")

Conversation: TypeAlias = Generator[list[Datagram], list[Answer], T]
"""A conversation with one slave. It yields the next datagrams to the slave, in order, and receives
their answers by `send`. An empty list means that it waits, for the slave or for its turn. Its
return value is the result."""

_PAUSE_S = 0.0002
"""Seconds between two rounds while all conversations wait."""

_NAMED = 5
"""Most errors in one message."""

_ROUNDS = 16
"""Most rounds between two yields of conversations that never wait."""

_LOOKING = 2
"""Rounds between two waits of a conversation that looks for an answer and finds none."""


def run_conversations(
    registers: Datagrams, conversations: Sequence[Conversation[T]]
) -> Steps[tuple[dict[int, T], dict[int, EcatError]]]:
    """Runs all conversations at the same time, and yields whenever all of them wait.

    If they never do, it yields every `_ROUNDS` rounds, so that other work goes on. It yields true
    if slaves have answered since the last time. Then the next step should come soon.

    Returns:
        The results, and the errors of failed ones, both by their numbers in `conversations`.
    """
    found: dict[int, T] = {}
    failed: dict[int, EcatError] = {}
    due: list[tuple[int, list[Answer] | None]] = [
        (number, None) for number in range(len(conversations))
    ]
    rounds = 0
    try:
        while due:
            datagrams: list[Datagram] = []
            counts: list[tuple[int, int]] = []  # of each conversation: its number and datagrams
            for number, answers in due:
                conversation = conversations[number]
                try:
                    wanted = next(conversation) if answers is None else conversation.send(answers)
                except StopIteration as end:
                    found[number] = end.value
                except EcatError as error:
                    failed[number] = error
                else:
                    counts.append((number, len(wanted)))
                    datagrams += wanted
            if not counts:
                break
            rounds += 1
            if not datagrams or rounds > _ROUNDS:
                yield rounds > _LOOKING  # with more rounds, an answer was read and a request sent
                rounds = 0
            received = registers.exchange(datagrams, repeat=False)
            ends = itertools.accumulate(count for _, count in counts)
            due = [
                (number, received[end - count : end])
                for (number, count), end in zip(counts, ends, strict=True)
            ]
    finally:
        for (
            conversation
        ) in conversations:  # unfinished conversations must leave the queues of their slaves
            conversation.close()
    return found, failed


def run_conversation(registers: Datagrams, conversation: Conversation[T]) -> Steps[T]:
    """Runs one conversation; returns its result, and raises its errors."""
    found, failed = yield from run_conversations(registers, [conversation])
    if failed:
        raise failed[0]
    return found[0]


def converse(
    registers: Datagrams,
    conversations: Sequence[Conversation[T]],
    cancelled: Callable[[], bool] = lambda: False,
) -> list[T]:
    """Runs all conversations at the same time, to their ends; blocks.

    Args:
        registers: Access to the registers of the slaves.
        conversations: The conversations, each with another slave.
        cancelled: Called repeatedly while waiting; when it returns true, `StateError` is raised.

    Returns:
        The result of each conversation.

    Raises:
        EcatError: Conversations failed; the message contains their errors. The others have ended
            normally.
    """
    found, failed = finish(
        _unless(cancelled, run_conversations(registers, conversations)), _PAUSE_S
    )
    if failed:
        raise _all_of([failed[number] for number in sorted(failed)])
    return [found[number] for number in range(len(conversations))]


def _unless(cancelled: Callable[[], bool], steps: Steps[T]) -> Steps[T]:
    while True:
        if cancelled():
            raise StateError("stopped while slaves were being read")
        try:
            yield next(steps)
        except StopIteration as end:
            result: T = end.value
            return result


def _all_of(errors: list[EcatError]) -> EcatError:
    if len(errors) == 1:
        return errors[0]
    texts = [str(error) for error in errors[:_NAMED]]
    if len(errors) > _NAMED:
        texts.append(f"and {len(errors) - _NAMED} slaves more")
    return StateError("; ".join(texts))

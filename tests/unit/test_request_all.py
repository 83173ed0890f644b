"""Many requests at once: in order, ahead while answers come soon, one by one while they do not."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from typing import Any

from ecatd.base.errors import NoAnswerError
from ecatd.client.session import Session
from ecatd.operations.objects import DescribeObject
from ecatd.operations.operation import Operation


class Answering(Session):
    """A session without a daemon: slave 1 is slow, object 7 has no answer."""

    def __init__(self) -> None:
        self.timeout = 0.64  # an answer after 0.02 s comes late
        self.open = self.most_open = 0

    def _send(self, operation: Operation[Any]) -> tuple[tuple[str, ...], Iterable[Any]]:
        assert isinstance(operation, DescribeObject)
        self.open += 1
        self.most_open = max(self.most_open, self.open)
        return ("ro",), [operation]

    def _answer(self, key: tuple[str, ...], replies: Iterable[Any]) -> Any:
        (operation,) = replies
        self.open -= 1
        if operation.slave == 1:
            time.sleep(0.03)
        if operation.index == 7:
            raise NoAnswerError("silent")
        return operation.index


def test_answers_come_in_order() -> None:
    asked: list[int] = []

    def wanted() -> Iterator[DescribeObject]:
        for index in range(30):
            asked.append(index)
            yield DescribeObject(1 if 10 <= index < 20 else 0, index)

    session = Answering()
    answers = session.request_all(wanted())
    assert next(answers) == 0
    assert asked == [0]  # what is wanted next may depend on what has come
    found = [0, *answers]
    assert isinstance(found[7], NoAnswerError)
    assert [*found[:7], *found[8:]] == [*range(7), *range(8, 30)]
    assert session.most_open == 8


def test_a_slow_slave_is_asked_for_one_thing_at_a_time() -> None:
    session = Answering()
    assert [*session.request_all(DescribeObject(1, index) for index in range(4))] == [*range(4)]
    assert session.most_open == 1

"""The queue of the worker, and the turns of those who wait for slaves."""

import asyncio
import threading
from collections.abc import Callable
from typing import Any

import pytest

from ecatd.bus.steps import Steps
from ecatd.bus.worker import Worker
from ecatd.model.errors import BusyError, EcatError, StateError


async def settle() -> None:
    """Lets tasks go as far as they come by themselves."""
    for _ in range(5):
        await asyncio.sleep(0)


def test_a_full_queue_is_told_and_empties() -> None:
    async def use() -> None:
        worker, go, lock = Worker(), threading.Event(), asyncio.Lock()
        waiting: list[asyncio.Task[Any]] = [
            asyncio.create_task(worker.run(go.wait)) for _ in range(63)
        ]
        waiting.append(asyncio.create_task(worker.request(until(go.is_set), lock)))
        await settle()
        with pytest.raises(BusyError, match="busy: 64 mailbox requests are waiting") as caught:
            await worker.run(go.wait)
        assert isinstance(EcatError.from_reply(caught.value.to_reply()), BusyError)
        with pytest.raises(BusyError):
            await worker.request(until(go.is_set), lock)
        waiting.pop(5).cancel()  # one that is given up makes room at once
        await settle()
        waiting.append(asyncio.create_task(worker.run(go.wait)))
        go.set()
        await asyncio.gather(*waiting)
        assert await worker.run(lambda: 7) == 7
        worker.close()

    asyncio.run(use())


def until(condition: Callable[[], bool]) -> Steps[str]:
    """Waits for something, and tells."""
    while not condition():
        yield
    return "done"


def test_a_request_that_waits_holds_up_nobody() -> None:
    async def use() -> list[str]:
        worker, came = Worker(), threading.Event()
        slow = asyncio.create_task(worker.request(until(came.is_set), asyncio.Lock()))
        steps = asyncio.create_task(worker.run_steps(until(came.is_set)))
        await asyncio.sleep(0.02)
        quick = await worker.request(until(lambda: True), asyncio.Lock())
        assert await worker.run(lambda: slow.done() or steps.done()) is False
        came.set()
        found = [quick, await slow, await steps]
        worker.close()
        return found

    assert asyncio.run(use()) == ["done"] * 3


def test_those_who_want_to_be_alone_are() -> None:
    async def use() -> None:
        worker, alone, inside = Worker(), asyncio.Lock(), [0, 0]

        def steps() -> Steps[None]:
            inside[0] += 1
            for _ in range(3):
                inside[1] = max(inside)
                yield
            inside[0] -= 1

        await asyncio.gather(*[worker.request(steps(), alone) for _ in range(5)])
        assert inside == [0, 1]
        worker.close()

    asyncio.run(use())


def test_errors_come_to_those_who_asked() -> None:
    def wrong() -> Steps[None]:
        yield
        raise StateError("no")

    async def use() -> None:
        worker = Worker()
        for asked in (worker.request(wrong(), asyncio.Lock()), worker.run_steps(wrong())):
            with pytest.raises(StateError, match=r"^no$"):
                await asked
        worker.close()

    asyncio.run(use())


def test_a_worker_that_is_closed_in_the_middle() -> None:
    async def use() -> None:
        worker = Worker()
        waiting = asyncio.create_task(worker.request(until(lambda: False), asyncio.Lock()))
        await asyncio.sleep(0.02)
        await asyncio.to_thread(worker.close)
        with pytest.raises((StateError, asyncio.CancelledError)):
            await waiting
        with pytest.raises(StateError, match=r"^the bus is being stopped$"):
            await worker.run(lambda: 7)

    asyncio.run(use())

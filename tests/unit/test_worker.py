"""The worker: who waits for a slave lets others have their turn."""

import asyncio
import threading
from collections.abc import Callable

import pytest

from conftest import naming
from ecatd.base.coroutine_steps import Steps
from ecatd.base.errors import StateError
from ecatd.master.worker import Worker


def until(condition: Callable[[], bool]) -> Steps[str]:
    """Waits for something, and tells."""
    while not condition():
        yield
    return "done"


def test_a_request_that_waits_holds_up_nobody() -> None:
    async def use() -> list[str]:
        worker, came = Worker(), threading.Event()
        slow = [asyncio.create_task(worker.request(until(came.is_set))) for _ in range(5)]
        steps = asyncio.create_task(worker.run_steps(until(came.is_set)))
        await asyncio.sleep(0.02)
        quick = await worker.request(until(lambda: True))
        assert await worker.run(lambda: any(task.done() for task in (*slow, steps))) is False
        came.set()
        found = [quick, *[await task for task in slow], await steps]
        worker.close()
        return found

    assert asyncio.run(use()) == ["done"] * 7


def test_a_turn_ends_when_somebody_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    """However long turns are, and also after one that waited has been given up."""
    monkeypatch.setattr("ecatd.master.worker._TURN", 3600.0)

    async def use() -> None:
        worker, came = Worker(), threading.Event()
        slow = asyncio.create_task(worker.request(until(came.is_set)))
        await asyncio.sleep(0.02)
        given_up = asyncio.create_task(worker.run(lambda: 7))
        await asyncio.sleep(0)
        given_up.cancel()
        assert await worker.run(lambda: 8) == 8
        assert not slow.done()
        came.set()
        assert await slow == "done"
        worker.close()

    asyncio.run(use())


def test_errors_come_to_those_who_asked() -> None:
    def wrong() -> Steps[None]:
        yield
        raise StateError("no")

    async def use() -> None:
        worker = Worker()
        for asked in (worker.request(wrong()), worker.run_steps(wrong())):
            with pytest.raises(StateError, match=r"^no$"):
                await asked
        worker.close()

    asyncio.run(use())


def test_a_worker_that_is_closed_in_the_middle() -> None:
    async def use() -> None:
        worker = Worker()
        waiting = asyncio.create_task(worker.request(until(lambda: False)))
        await asyncio.sleep(0.02)
        await asyncio.to_thread(worker.close)
        with pytest.raises((StateError, asyncio.CancelledError)):
            await waiting
        with pytest.raises(StateError, match=naming("stopped")):
            await worker.run(lambda: 7)

    asyncio.run(use())

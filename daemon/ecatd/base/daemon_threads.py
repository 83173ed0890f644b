"""Runs calls that may take long, such as the look-up of a name, beside the event loop."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

T = TypeVar("T")


async def in_daemon_thread(call: Callable[[], T]) -> T:
    """Runs a call in a thread that cannot delay the end of this process; raises what it raises."""
    answer: Future[T] = Future()
    answer.set_running_or_notify_cancel()  # who no longer waits leaves the call running

    def run() -> None:
        try:
            answer.set_result(call())
        except Exception as error:
            answer.set_exception(error)

    threading.Thread(target=run, daemon=True).start()
    return await asyncio.wrap_future(answer)

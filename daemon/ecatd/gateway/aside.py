"""Runs calls that may take long, such as the look-up of a name, beside the event loop."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import TypeVar

T = TypeVar("T")


async def aside(call: Callable[[], T]) -> T:
    """Runs a call in a thread that cannot delay the end of this process; raises what it raises."""
    loop = asyncio.get_running_loop()
    answer: asyncio.Future[T] = loop.create_future()

    def tell(how: Callable[[], None]) -> None:
        if not answer.done():
            how()

    def run() -> None:
        how: Callable[[], None]
        try:
            found = call()
            how = lambda: answer.set_result(found)  # noqa: E731
        except Exception as error:
            failed = error
            how = lambda: answer.set_exception(failed)  # noqa: E731
        with suppress(RuntimeError):  # the loop has ended
            loop.call_soon_threadsafe(tell, how)

    threading.Thread(target=run, daemon=True).start()
    return await answer

"""Calls that block, such as requests over Zenoh, in threads that hold up nobody's end."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeVar

A = TypeVar("A")


async def in_thread(call: Callable[[], A]) -> A:
    """Makes a call in a thread of its own. The end of the process does not wait for it.

    Callers limit how many there are. A call of which the caller was cancelled goes on in vain.
    """
    loop = asyncio.get_running_loop()
    future: asyncio.Future[A] = loop.create_future()

    def settle(setter: Callable[[Any], None], value: Any) -> None:
        def put() -> None:
            if not future.done():
                setter(value)

        with suppress(RuntimeError):  # the loop has ended
            loop.call_soon_threadsafe(put)

    def run() -> None:
        try:
            answer = call()
        except Exception as error:
            settle(future.set_exception, error)
        else:
            settle(future.set_result, answer)

    threading.Thread(target=run, daemon=True).start()
    return await future

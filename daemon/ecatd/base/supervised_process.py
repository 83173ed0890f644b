"""The link between the service and a child process, on the side of the child.

The service writes lines of JSON to the child's stdin: first the settings, later `{"ping": 1}` or
changed settings. The child writes lines to its stdout, each with a word and a text:

- `starting` regularly while it starts, if that may take long;
- `ready` once it serves;
- `failed` with the reason;
- `alive` with a JSON document, as the answer to a ping;
- `changed` when it uses the changed settings, or with the reason why it cannot;
- `log` with the levels of the log, when a request has changed them.

`ecatd.service.child` is the other side.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import sys
import traceback
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any

from .errors import EcatError
from .log import Log
from .notify import notify

_STARTING_S = 2.0
"""Seconds between two lines that say that the start goes on."""

_WATCHDOG_S = 1.0
"""Seconds between two messages to the service manager."""

_LINE_MAX = 1 << 26
"""Most bytes of the settings."""

HANG_S = 10.0
"""Seconds without an answer after which a process counts as hung. A process that only waits for a
busy processor or a slow slave answers much earlier."""


def read_settings() -> dict[str, Any]:
    """Returns the settings, which are the first line of stdin. Further lines come after `ready`.

    Ends this process if the service was killed before it wrote them.
    """
    try:
        settings: dict[str, Any] = json.loads(sys.stdin.buffer.readline())
    except ValueError:
        sys.exit(0)
    return settings


def report(word: str, text: str = "") -> None:
    """Writes a line to the service; does nothing if the service has been killed."""
    with contextlib.suppress(BrokenPipeError):
        os.write(sys.stdout.fileno(), f"{word} {text}\n".encode())


async def report_starting() -> None:
    """Tells the service regularly that the start goes on, until it is cancelled."""
    while True:
        await asyncio.sleep(_STARTING_S)
        report("starting")


async def answer_pings(
    alive: Callable[[], Awaitable[dict[str, Any]]],
    change: Callable[[dict[str, Any]], Awaitable[None]] | None = None,
) -> None:
    """Answers the service until its end of the pipe is closed.

    Args:
        alive: Checks that this process does its work, and returns the answer to the ping. If it
            waits for too long, the service takes this process for hung.
        change: Takes over changed settings. If it cannot use them, it changes nothing and raises
            `EcatError`.
    """
    reader = asyncio.StreamReader(limit=_LINE_MAX)
    loop = asyncio.get_running_loop()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    while line := await reader.readline():
        message = json.loads(line)
        if "ping" in message:
            report("alive", json.dumps(await alive()))
        elif change is not None:
            try:
                await change(message)
            except EcatError as error:
                report("changed", str(error))
            else:
                report("changed")


async def feed_watchdog(alive: Callable[[], Awaitable[dict[str, Any]]]) -> None:
    """Tells the service manager regularly that this process works, if it is a service of its own.

    Args:
        alive: As of `answer_pings`.
    """
    while True:
        await alive()
        notify("WATCHDOG=1", wait=False)
        await asyncio.sleep(_WATCHDOG_S)


def stop_signals(*more: signal.Signals) -> asyncio.Event:
    """Returns an event that the signals which end a process set, and `more` of them."""
    stop = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGQUIT, *more):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    return stop


async def work_until(stop: asyncio.Event, work: Coroutine[Any, Any, None]) -> None:
    """Works until `stop` is set, or the work ends: it does when the service was killed.

    Raises what has ended the work.
    """
    working = asyncio.create_task(work)
    working.add_done_callback(lambda _: stop.set())
    await stop.wait()
    if working.done():
        working.result()
    working.cancel()


def run(
    work: Coroutine[Any, Any, None], name: str, log: Log, cause: Callable[[], str] = lambda: ""
) -> int:
    """Runs a process to its end; returns the exit code, and logs what has ended it.

    Args:
        work: What it does.
        name: What the log calls it, with an article: "the gateway".
        log: The log.
        cause: A possible cause of an error, for the end of the message; empty: none.
    """
    try:
        asyncio.run(work)
    except EcatError as error:
        log.error(f"{name.removeprefix('the ')}: {error}{cause()}")
        return error.exit_code
    except Exception as error:
        log.error(f"defect in {name}: {error!r}{cause()}")
        log.debug(traceback.format_exc())
        return EcatError.exit_code
    return 0
